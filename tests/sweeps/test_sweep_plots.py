"""The bar of a sweep, and the pictures of its results."""

import io
import sys

import clothsim as cs
import numpy as np
import pytest
from clothsim.viewing.plots import sweep as plots

pytest.importorskip("xarray")
pytest.importorskip("zarr")
plt = pytest.importorskip("matplotlib.pyplot")


def terminal_of(monkeypatch):
    """Return a function that makes a terminal and returns what it gets."""
    screen = io.StringIO()
    screen.isatty = lambda: True
    monkeypatch.setattr(sys, "stderr", screen)
    return screen


def test_the_bar_shows_members_rate_and_time_left(monkeypatch):
    terminal = terminal_of(monkeypatch)
    cs.sweep(cs.scenes.hanging(shape=(6, 7)), {"dt": [1e-3, 5e-2]}, duration=0.3)
    last = terminal.getvalue().split("\r")[-1]
    assert "sweep: 100%" in last and "2/2 [" in last and "<00:00, " in last and "member/s]" in last


@pytest.fixture(scope="module")
def swept():
    scene = cs.scenes.hanging(shape=(6, 7))
    return cs.sweep(
        scene,
        {"stiffness": np.geomspace(500, 5e4, 4), "dt": [1e-3, 2e-3, 4e-3, 3e-2]},
        duration=0.3,
        metrics=["error", "largest_stretch"],
        progress=False,
    )


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def test_a_fan_over_tolerances():
    scene = cs.Scene(cs.Cloth((5, 5), mass=1.0, stiffness=200.0, damping=0.2))
    over = {"rtol": [1e-3, 1e-5, 1e-15], "stiffness": [100.0, 200.0]}
    swept = cs.sweep(scene, over, duration=0.1, metrics="error", progress=False)
    axes = swept.clothsim.plot()
    assert axes.get_xlabel() == "rtol" and axes.get_xscale() == axes.get_yscale() == "log"
    lines = {line.get_label(): line for line in axes.get_lines()}
    assert np.array_equal(lines["200"].get_ydata(), swept.error.sel(stiffness=200.0).sortby("rtol"))
    assert "order 4" not in lines
    unsure = (swept.error < swept.reference_error).values.sum()
    assert unsure > 0 and "below the\nreference's own" in lines


def test_the_convergence_fan(swept):
    axes = swept.clothsim.plot()
    lines = {line.get_label(): line for line in axes.get_lines()}
    for stiffness in swept.stiffness.values:
        line = lines[f"{stiffness:.4g}"]
        assert np.array_equal(
            line.get_ydata(), swept.error.sel(stiffness=stiffness), equal_nan=True
        )
        assert np.array_equal(line.get_xdata(), swept.dt)
    slope = np.diff(np.log(lines["order 4"].get_ydata())) / np.diff(np.log(swept.dt.values))
    assert slope == pytest.approx([4, 4, 4], rel=1e-9)
    assert axes.get_xscale() == axes.get_yscale() == "log"
    assert (
        axes.get_xlabel() == "dt [s]"
        and axes.get_legend().get_title().get_text() == "stiffness [N/m]"
    )
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    assert (
        left < swept.dt.min() < swept.dt.max() < right
        and low < swept.error.min() < swept.error.max() < high
    )
    assert high / low < 1e3 * swept.error.max() / swept.error.min()
    crosses = sum(len(line.get_xdata()) for line in axes.get_lines() if line.get_marker() == "x")
    assert crosses == int((swept.status == 2).sum()) > 0


def test_a_fan_of_many_lines_has_a_colour_bar(swept):
    many = swept.isel(stiffness=[0] * 12).assign_coords(stiffness=np.geomspace(500, 5e4, 12))
    many.stiffness.attrs = swept.stiffness.attrs
    axes = many.clothsim.plot()
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["order 4"] and axes.figure.axes[1].get_ylabel() == "stiffness [N/m]"
    lines = [line for line in axes.get_lines() if line.get_marker() == "o"]
    assert len({tuple(line.get_color()) for line in lines if len(line.get_xdata()) == 4}) == 12


def test_cells_of_named_values_are_whole():
    scene = cs.scenes.oscillator()
    over = {"integrator": ["semi_implicit_euler", "velocity_verlet", "rk4"], "stiffness": [50, 99]}
    swept = cs.sweep(scene, over, duration=0.1, dt=0.01, progress=False)
    axes = swept.clothsim.plot()
    mesh = axes.collections[0]
    assert mesh.colorbar.ax.get_ylabel() == "largest stretch [%]"
    corners = mesh.get_coordinates().reshape(-1, 2)
    assert corners.min(axis=0).tolist() == [-0.5, 25.5] == [axes.get_xlim()[0], axes.get_ylim()[0]]
    assert corners.max(axis=0).tolist() == [2.5, 123.5]
    status = swept.clothsim.plot("heatmap", variable="status")
    assert [text.get_text() for text in status.get_legend().get_texts()] == ["done"]


def test_the_stability_map(swept):
    axes = swept.clothsim.plot("stability")
    (mesh,) = axes.collections
    assert np.array_equal(mesh.get_array(), swept.status.values.T)
    (line,) = (line for line in axes.get_lines() if line.get_label() == "guaranteed\nstable dt")
    assert np.array_equal(line.get_ydata(), swept.max_stable_dt.isel(dt=0))
    assert np.array_equal(line.get_xdata(), swept.stiffness)


def test_heat_maps(swept):
    axes = swept.clothsim.plot("heatmap", variable="largest_stretch", x="dt", y="stiffness")
    mesh = axes.collections[0]
    percent = 100 * swept.largest_stretch
    assert np.array_equal(np.ma.filled(mesh.get_array(), np.nan), percent, equal_nan=True)
    assert mesh.colorbar.ax.get_ylabel() == "largest stretch [%]"
    scaled = (
        swept.assign(largest_stretch=swept.largest_stretch**8)
        .clothsim.plot("heatmap", variable="largest_stretch")
        .collections[0]
    )
    assert isinstance(scaled.norm, plt.matplotlib.colors.LogNorm)  # more than two decades
    line = swept.isel(dt=0).clothsim.plot("heatmap").get_lines()[0]
    assert np.array_equal(line.get_ydata(), swept.error.isel(dt=0))
    corners = {"corners": lambda run: run.x[-1, 0], "height": lambda run: run.x[-1, ..., 1].mean()}
    framed = cs.sweep(
        cs.scenes.hanging(), {"dt": [1e-3, 2e-3]}, duration=0.01, metrics=corners, progress=False
    )
    axes = framed.clothsim.plot("heatmap")  # it takes one number a member
    assert np.array_equal(axes.get_lines()[0].get_ydata(), framed.height)
    assert plots.suggest_kind(swept.drop_vars("error")) == "stability"
    assert plots.suggest_kind(swept.isel(dt=[0]).drop_vars("error")) == "heatmap"
    renamed = swept.drop_vars("error").assign(energy_drift=swept.largest_stretch)
    for metric in ("largest_stretch", "penetration", "sag"):  # the more telling one comes later
        renamed[metric] = swept.largest_stretch * 1
        axes = renamed.isel(dt=[0]).clothsim.plot()
        assert axes.get_ylabel().startswith(metric.replace("_", " "))
    assert plots.suggest_kind(renamed) == "heatmap"
    renamed["sag"] = renamed.sag * np.nan  # of scenes that do not rest
    assert renamed.isel(dt=[0]).clothsim.plot().get_ylabel().startswith("penetration")


def test_a_heat_map_marks_errors_below_the_reference(swept):
    swept = swept.assign(reference_error=swept.reference_error * 0 + float(swept.error.median()))
    axes = swept.clothsim.plot("heatmap", variable="error", x="dt", y="stiffness")
    (mesh,) = axes.collections
    unsure = (swept.error < swept.reference_error).transpose("stiffness", "dt").values
    drawn = ~np.ma.getmaskarray(np.ma.masked_invalid(mesh.get_array()))
    assert (
        unsure.any()
        and not drawn[unsure].any()
        and drawn.sum() == np.isfinite(swept.error).sum() - unsure.sum()
    )
    for panels in (axes, swept.isel(stiffness=0).clothsim.plot("heatmap", variable="error")):
        (hollow,) = (line for line in panels.get_lines() if line.get_label() == plots.UNSURE)
        expected = unsure if panels is axes else unsure[0]
        assert len(hollow.get_xdata()) == expected.sum() and hollow.get_markerfacecolor() == "white"


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (lambda ds: plots.draw_error(ds.drop_vars("error")), "needs the metric 'error'"),
        (lambda ds: plots.draw_stability(ds.isel(stiffness=0)), "beside dt"),
        (lambda ds: plots.draw_heatmap(ds, "eror"), "'error'"),
        (lambda ds: plots.draw_heatmap(ds.expand_dims(mass=[1, 2])), "two dimensions"),
        (lambda ds: ds.clothsim.plot("pie"), "kind must be"),
    ],
)
def test_pictures_that_cannot_be(swept, draw, message):
    with pytest.raises(ValueError, match=message):
        draw(swept)
