"""Fits: values within their errors, and NaN with a reason where data does not determine one."""

import clothsim as cs
import numpy as np
import pytest

pytest.importorskip("scipy")
pytest.importorskip("xarray")

import fit as benchmark  # benchmarks/fit.py

TIMES = np.linspace(0.1, 1, 10)
CLOTH = cs.Cloth((4, 4), (0.5, 0.5), 0.2, 60.0, 0.02, 0.05)
SCENE = cs.Scene(CLOTH, cs.Sphere((9, 9, 9), 0.1))
EXACT = cs.simulate(SCENE, 1.0, rtol=1e-8, times=TIMES).x[1:]
NOISE = np.random.default_rng(0).normal(0, 1e-3, EXACT.shape)
DATA = EXACT + NOISE


def softer(**changes):
    return SCENE.replace(cloth=CLOTH.replace(**changes))


def test_deviations_are_as_large_as_stated():
    """The benchmark in small; `python benchmarks/fit.py` is the whole."""
    scatter, (reached, told, starts) = benchmark.judge(4, 5, 1, 0)
    deviations = np.concatenate([*scatter.values()])
    assert len(deviations) == 80 and 0.8 < np.std(deviations) < 1.25
    assert reached + told == starts


@pytest.mark.parametrize("sigma", [1e-3, None])
def test_a_start_off_by_ten_finds_the_same(sigma):
    over = ("stiffness", "damping", "drag")
    found = cs.fit(SCENE, TIMES, DATA, over, sigma=sigma)
    far = cs.fit(softer(stiffness=6.0, damping=0.2, drag=0.5), TIMES, DATA, over, sigma=sigma)
    assert [*found.values] == [*over] and found.report["reason"] == ""
    for name, true in zip(over, (60.0, 0.02, 0.05)):
        assert abs(found.values[name] - true) < 3 * found.errors[name]
        assert far.values[name] == pytest.approx(found.values[name], rel=1e-4)
    assert found.report["sigma"] == pytest.approx(1e-3, rel=0.1)
    assert (
        np.isnan(found.report["chi_square"])
        if sigma is None
        else 0.8 < found.report["chi_square"] < 1.2
    )
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), [*found.errors.values()])
    np.testing.assert_allclose(found.residuals, DATA - found.run.x[1:], atol=1e-12)
    assert (
        found.scene.cloth.stiffness == found.values["stiffness"] and found.run.scene == found.scene
    )
    assert {"evaluations", "jacobians", "condition", "wall_time", "starts", "correlation"} <= {
        *found.report
    }
    assert "stiffness" in repr(found) and "+-" in repr(found)


def test_some_points_at_some_times():
    data = DATA[:, [-1, 2], [-1, 3]].copy()
    data[3:5, 0] = np.nan
    found = cs.fit(softer(stiffness=90.0), TIMES, data, ["stiffness"], points=[(-1, -1), (2, 3)])
    whole = cs.fit(softer(stiffness=90.0), TIMES, DATA, ["stiffness"])
    assert (
        abs(found.values["stiffness"] - 60)
        < 4 * found.errors["stiffness"]
        > 4 * whole.errors["stiffness"]
    )
    assert (
        np.isnan(found.residuals[3:5, 0]).all() and np.isfinite(found.residuals).sum() == 2 * 30 - 6
    )


def test_exact_data_gives_the_true_values():
    found = cs.fit(softer(stiffness=20.0, drag=0.2), TIMES, EXACT, ["stiffness", "drag"])
    assert found.report["reason"] == ""
    assert abs(found.values["stiffness"] - 60) < max(3 * found.errors["stiffness"], 1e-3)
    assert found.values["drag"] == pytest.approx(0.05, rel=1e-4)


def test_places_and_directions():
    moved = DATA + (0, 0, 0)
    found = cs.fit(
        SCENE.replace(gravity=(1.0, -8.0, 0)),
        TIMES,
        moved,
        ["gravity_x", "gravity_y", "pin0_x"],
        sigma=1e-3,
    )
    for name, true in (("gravity_x", 0.0), ("gravity_y", -9.80665), ("pin0_x", 0.0)):
        assert abs(found.values[name] - true) < 3.5 * found.errors[name] < 0.1


def test_what_the_data_does_not_determine_is_no_number():
    names = ["stiffness", "mass", "drag", "damping"]
    found = cs.fit(
        SCENE, TIMES, DATA, names, sigma=1e-3
    )  # all four times a factor give the same motion
    assert (
        np.isnan([*found.values.values(), *found.errors.values()]).all()
        and found.report["condition"] > 1e6
    )
    assert found.report["reason"].startswith(
        "stiffness, mass, drag, damping: only combinations are determined: the condition"
    )
    found = cs.fit(SCENE, TIMES, DATA, ["stiffness", "sphere_radius"], sigma=1e-3)
    assert np.isfinite(found.errors["stiffness"]) and np.isnan(found.values["sphere_radius"])
    assert found.report["reasons"] == {
        "stiffness": "",
        "sphere_radius": "has no effect on what was measured",
    }
    assert (
        np.isnan(found.covariance[1]).all()
        and np.isnan(found.covariance[:, 1]).all()
        and found.covariance[0, 0] > 0
    )
    found = cs.fit(
        softer(damping=1e-6),
        TIMES,
        DATA[:, -1:, -1:].reshape(10, 1, 3),
        ["damping"],
        [(-1, -1)],
        0.3,
    )
    assert np.isnan(found.values["damping"]) and found.report["reasons"]["damping"]


def test_a_bound_is_no_value():
    found = cs.fit(softer(stiffness=30.0), TIMES, DATA, {"stiffness": (10, 40.0)})
    assert (
        np.isnan(found.values["stiffness"])
        and found.report["reasons"]["stiffness"] == "ends at its bound"
    )
    assert found.scene.cloth.stiffness == pytest.approx(40.0, rel=1e-3)
    found = cs.fit(softer(stiffness=30.0), TIMES, DATA, {"stiffness": (10, 90.0)})
    assert abs(found.values["stiffness"] - 60) < 3 * found.errors["stiffness"]


@pytest.mark.parametrize("sigma", [1e-3, None])
def test_the_motion_of_another_cloth_is_told(sigma, monkeypatch):
    monkeypatch.setattr("clothsim.accuracy.fit._STARTS", 1)
    found = cs.fit(softer(springs=("structural",)), TIMES, DATA, ["drag"], sigma=sigma)
    assert found.report["starts"] == 2 and np.isnan(found.errors["drag"])
    assert (
        "chi-square is" if sigma else "residuals at neighbouring times have a correlation"
    ) in found.report["reason"]


def test_after_a_contact_nothing_is_fitted(monkeypatch):
    monkeypatch.setattr("clothsim.accuracy.fit._STARTS", 0)
    scene = SCENE.replace(spheres=cs.Sphere((0.25, -0.3, 0.25), 0.2))
    data = cs.simulate(scene, 1.0, dt=1e-3, times=TIMES).x[1:]
    found = cs.fit(scene, TIMES, data, ["stiffness"])
    assert np.isnan(found.values["stiffness"])
    assert (
        "the cloth meets a sphere" in found.report["reason"]
        and "give only the times before" in found.report["reason"]
    )


def test_it_draws_itself():
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    found = cs.fit(SCENE, TIMES, DATA, ["stiffness", "drag", "sphere_radius"], sigma=1e-3)
    curves, residuals, matrix = found.plot()
    assert len(curves.lines) == 6 and residuals.get_ylabel() == "measured less fitted [mm]"
    assert [one.get_text() for one in matrix.get_xticklabels()] == [
        "stiffness",
        "drag",
        "sphere_radius (unknown)",
    ]
    matplotlib.pyplot.close(curves.figure)
