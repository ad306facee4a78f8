"""Plots of fits, derivatives, references and differences, and the labels of all plots."""

from dataclasses import replace
from itertools import combinations, pairwise

import clothsim as cs
import numpy as np
import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("scipy")
pytest.importorskip("xarray")

from clothsim.viewing.plots.fit import value_with_error
from clothsim.viewing.plots.points import distant_points
from clothsim.viewing.plots.style import label_lines, separate_ticks
from colors import check_lines
from matplotlib import pyplot

TIMES = np.linspace(0.1, 0.8, 8)
SCENE = cs.Scene(cs.Cloth((4, 4), (0.5, 0.5), 0.2, 60.0, 0.02, 0.05))


@pytest.fixture(autouse=True)
def _close():
    yield
    pyplot.close("all")


@pytest.fixture(scope="module")
def data():
    x = cs.simulate(SCENE, 0.8, rtol=1e-8, times=TIMES).x[1:]
    return x + np.random.default_rng(0).normal(0, 1e-3, x.shape)


def texts(axes):
    return [text.get_text() for text in axes.texts]


def boxes(labels):
    return [label.get_window_extent() for label in labels if label.get_text()]


def test_points_of_a_motion_are_far_from_each_other():
    grid = np.stack(np.meshgrid(np.arange(5.0), np.arange(5.0), [0.0]), axis=-1).reshape(25, 3)
    x = grid + np.zeros((6, 1, 1))
    x[:, :, 2] += np.linspace(0, 1, 6)[:, None] * np.linspace(0.5, 1, 25)
    x[:, 24, 2] += np.linspace(0, 3, 6)  # which moves most
    assert distant_points(x) == [(24, 2), (0, 2), (20, 2)]
    x[:4, 0] = np.nan  # seldom measured
    x[:, 20] = x[0, 20]  # still
    chosen = distant_points(x)
    assert len(chosen) == 3 and not {0, 20} & {k for k, _ in chosen}
    assert distant_points(np.full((3, 4, 3), np.nan)) == []
    assert [k for k, _ in distant_points(np.zeros((3, 1, 3)))] == [0]


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (60.2134, 0.3412, "60.21 \u00b1 0.34 N/m"),
        (35_123.4, 1200.0, "35123 \u00b1 1200 N/m"),
        (2.0034e-6, 3.1e-8, "(2.003 \u00b1 0.031)e-6 N/m"),
        (0.003, 0.016, "0.003 \u00b1 0.016 N/m"),
        (60.2134, np.nan, "60.2134 N/m, error unknown"),
        (np.nan, np.nan, "unknown"),
    ],
)
def test_a_value_has_the_digits_of_its_error(value, error, text):
    assert value_with_error(value, error, "N/m") == text


def test_a_fit_draws_data_residuals_values_and_correlations(data):
    result = cs.fit(SCENE, TIMES, data, ["stiffness", "drag"], sigma=1e-3)
    motion, residuals, values, correlation = result.plot()
    check_lines(motion)
    labels = [text.get_text() for text in motion.get_legend().get_texts()]
    assert labels[0] == "x of point (3, 3)" and len(labels) == 3
    assert residuals.get_ylabel() == "measured less fitted [mm]"
    (bars,) = values.containers
    spans = np.array([segment[:, 0] for segment in bars[2][0].get_segments()])
    errors = [result.errors[name] / result.values[name] for name in ("stiffness", "drag")]
    np.testing.assert_allclose(spans, np.outer(errors, [-100, 100]))
    names = [text.get_text() for text in values.get_yticklabels()]
    assert names[0] == "stiffness\n" + value_with_error(
        result.values["stiffness"], result.errors["stiffness"], "N/m"
    )
    assert values.get_xlabel() == "error [% of the value or scale]"
    assert texts(correlation)[0] == "1.00" and texts(correlation)[1] == texts(correlation)[2]


def test_a_fit_of_a_single_parameter_has_no_empty_panel(data):
    result = cs.fit(SCENE, TIMES, data, ["stiffness"], sigma=1e-3)
    assert len(result.plot()) == 3
    with pytest.raises(ValueError, match="ax must be None or axes of matplotlib, 3 of them"):
        result.plot(pyplot.subplots(2, 2)[1])


def test_a_fit_says_why_a_value_is_unknown(data):
    result = cs.fit(SCENE, TIMES, data, ["stiffness"], sigma=1e-3)
    report = {**result.report, "reasons": {"stiffness": "ends at its bound"}}
    values = {"stiffness": np.nan}
    unknown = replace(
        result, values=values, errors=values, covariance=np.full((1, 1), np.nan), report=report
    )
    panels = unknown.plot()
    assert texts(panels[2]) == ["ends at its bound"] and len(panels) == 3
    assert [text.get_text() for text in panels[2].get_yticklabels()] == ["stiffness\nunknown"]


def test_derivatives_are_drawn_over_time_and_points():
    slopes = cs.sensitivity(SCENE, TIMES, of=["stiffness.shear", "drag", "gravity_x"])
    panels = slopes.clothsim.plot()
    assert panels.shape == (3, 2)
    length = np.linalg.norm(slopes.dx.values, axis=-1)  # (parameters, times, rows, columns)
    for k, (name, unit) in enumerate(
        (("stiffness.shear", "N/m"), ("drag", "N s/m"), ("gravity_x", "m/s^2"))
    ):
        over_time, over_points = panels[k]
        largest, error = check_lines(over_time)
        assert over_time.get_ylabel() == f"[m per {unit}]"
        assert over_time.get_title("left") == f"d x / d {name}"
        np.testing.assert_array_equal(largest.get_ydata(), length[k].max(axis=(1, 2)))
        np.testing.assert_array_equal(error.get_ydata(), slopes.error.values[k])
        last = length[k].max(axis=(1, 2)).argmax()
        np.testing.assert_array_equal(over_points.images[0].get_array(), length[k, last])
        assert over_points.images[0].colorbar.ax.get_ylabel() == f"[m per {unit}]"
    axes = pyplot.subplots(3, 2)[1]
    assert (slopes.clothsim.plot(ax=axes) == axes).all()


def test_derivatives_that_are_zero_or_not_known_have_a_text():
    times = [0.1, 0.2, 0.3]
    slopes = cs.sensitivity(SCENE.replace(spheres=cs.Sphere((9, 9, 9))), times, ["sphere_radius"])
    ((over_time, over_points),) = slopes.clothsim.plot()
    assert [line.get_label() for line in check_lines(over_time)] == ["error"]
    assert texts(over_points) == ["no effect on any point"]
    slopes["dx"] *= np.nan
    slopes["error"] *= np.nan
    slopes["reason"] = ("parameter", ["a sphere responds after the step that begins at 0.01 s"])
    ((over_time, over_points),) = slopes.clothsim.plot()
    assert over_time.get_title("left").startswith("d x / d sphere_radius\na sphere responds")
    assert texts(over_points) == ["not known at any time"]


def test_a_reference_draws_its_motion_and_its_error():
    solution = cs.reference(SCENE, 0.2, every=0.05)
    motion, error = solution.plot()
    assert len(check_lines(motion)) == 3
    lines = {line.get_label(): line.get_ydata() for line in check_lines(error)}
    for name, key in (("bound, largest", "max"), ("bound, rms", "rms")):
        np.testing.assert_array_equal(lines[name][1:], solution.error_bound[key][1:])
    assert error.get_yscale() == "log" and error.get_ylabel() == "error [m]"
    ends = cs.reference(SCENE, 0.2).plot()[1]
    assert all(np.isfinite(line.get_ydata()).sum() == 1 for line in check_lines(ends))


def test_a_difference_draws_itself():
    coarse, fine = (cs.simulate(SCENE, 0.3, dt=dt, fps=20) for dt in (5e-3, 2.5e-3))
    apart = cs.difference(coarse, fine[1:])
    axes = apart.plot()
    largest, rms = check_lines(axes)
    np.testing.assert_array_equal(largest.get_ydata(), apart["max"])
    np.testing.assert_array_equal(rms.get_ydata(), apart["rms"])
    assert axes.get_yscale() == "log" and axes.get_ylabel() == "distance of the mass points [m]"
    assert axes.get_legend().get_title().get_text() == "1 frame without a partner"
    assert "rms" in repr(apart) and len(repr(apart)) < 100
    same = cs.difference(coarse, coarse).plot(pyplot.subplots()[1])
    assert same.get_yscale() == "linear" and not same.get_legend().get_title().get_text()


def test_long_labels_of_a_narrow_axis_do_not_overlap():
    axes = pyplot.subplots(figsize=(3, 3), layout="constrained")[1]
    axes.set_xticks(range(4), ["semi_implicit_euler", "velocity_verlet", "rk4", "dopri5"])
    separate_ticks(axes)
    axes.figure.draw_without_rendering()
    assert {label.get_rotation() for label in axes.get_xticklabels()} == {30.0}
    wide = pyplot.subplots(figsize=(12, 3), layout="constrained")[1]
    wide.set_xticks(range(4), ["semi_implicit_euler", "velocity_verlet", "rk4", "dopri5"])
    separate_ticks(wide)
    assert {label.get_rotation() for label in wide.get_xticklabels()} == {0.0}
    spans = sorted((box.x0, box.x1) for box in boxes(wide.get_xticklabels()))
    assert all(a[1] < b[0] for a, b in pairwise(spans))


def test_labels_of_many_lines_do_not_overlap():
    axes = pyplot.subplots(figsize=(5, 5), layout="constrained")[1]
    x = np.geomspace(1, 100, 5)
    for k in range(14):
        axes.loglog(x, 1e-3 * 3.0 ** (k % 7) * x ** -(1 + k // 7), label=f"method number {k}")
    axes.set_xlim(1, 1e4)  # room for labels
    label_lines(axes)
    axes.figure.draw_without_rendering()
    spans = boxes(axes.texts)
    assert len(spans) == 14
    assert not any(a.overlaps(b) for a, b in combinations(spans, 2))
    assert all(axes.bbox.count_contains(box.corners()) == 4 for box in spans)
