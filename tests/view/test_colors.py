"""Lines of all figures can be told apart, by readers of any colour vision too."""

from itertools import combinations

import clothsim as cs
import numpy as np
import pytest
from clothsim.base import plots
from clothsim.paper import paper_plots
from clothsim.stability import measure_map
from clothsim.viewing import sweep_plots
from clothsim.viewing.page import SHADING

pytest.importorskip("matplotlib")
pytest.importorskip("xarray")

import matplotlib
import xarray
from colors import LEAST, check_lines, distance, lab
from matplotlib import pyplot


def test_distances_are_those_of_the_literature():
    assert distance("#000000", "#ffffff") == pytest.approx(100, abs=0.01)
    # Red and green of equal luminance: a deuteranope has little left.
    assert distance("#c00000", "#606000") < 25 < np.linalg.norm(lab(np.array([0.5, 0, 0])) - lab(np.array([0.1, 0.1, 0])))


def test_the_palette_is_that_of_every_figure_and_page():
    assert min(distance(a, b) for a, b in combinations(plots.COLORS, 2)) >= LEAST
    assert SHADING["colors"] == plots.COLORS
    styles = [tuple(map(str, plots.style(k).values())) for k in range(72)]
    assert len(set(styles)) == 72


@pytest.fixture(autouse=True)
def no_display():
    matplotlib.use("Agg")
    yield
    pyplot.close("all")


def test_curves_of_a_run_have_names_at_their_ends():
    run = cs.simulate(cs.scenes.paper_static(), 0.3, dt=1e-3, fps=50)
    for log in (False, True):
        energy, stretch, penetration, contacts = run.plot(log=log).axes
        assert len(check_lines(energy)) == 4 and len(check_lines(penetration)) == 2
        assert energy.get_legend() is None
        assert {text.get_text() for text in energy.texts} == {"total", "kinetic", "elastic", "gravity"}
        heights = sorted(text.xyann[1] * energy.bbox.height / energy.figure.dpi for text in energy.texts)
        assert min(np.diff(heights)) > 0.15  # inches
    assert energy.get_yscale() == "symlog" and contacts.get_yscale() == "symlog"
    with pytest.raises(TypeError, match="log must be"):
        run.plot(log="y")


def made_up_work():
    """All methods in both precisions, and two adaptive ones."""
    names = [*cs.integrators(), "dopri5 adaptive", "dop853 adaptive"]
    solvers = [(name, precision) for name in names for precision in ("double", "single")]
    cost = np.outer(1 + np.arange(len(solvers)), [1e-3, 1e-2])
    return xarray.Dataset(
        {
            "wall_time": (("solver", "level"), cost),
            "rms_error": (("solver", "level"), 1e-9 / cost),
            "force_evaluations": (("solver", "level"), 1e5 * cost),
            "pareto": (("solver", "level"), cost == cost.min()),
        },
        {
            "solver": [" ".join(one) for one in solvers],
            "integrator": ("solver", [name for name, _ in solvers]),
            "precision": ("solver", [precision for _, precision in solvers]),
            "library": ("solver", ["clothsim"] * len(solvers)),
            "control": ("solver", ["rtol" if "adaptive" in name else "dt" for name, _ in solvers]),
        },
        {"reference_error_estimate_rms": 1e-12, "duration": 0.5},
    )


def test_work_precision_draws_itself_on_two_axes():
    data = made_up_work()
    axes = data.clothsim.plot()
    lines = check_lines(axes[1])
    assert {text.get_text() for text in axes[1].texts} >= {line.get_label() for line in lines}
    assert len(lines) == 20 and len(axes) == 2 and axes[0].figure.axes == list(axes)
    colors = {line.get_label().split()[0]: line.get_color() for line in lines}
    assert len(set(colors.values())) == 8
    given = pyplot.subplots(1, 2)[1]
    assert data.clothsim.plot(ax=given)[1] is given[1]
    with pytest.raises(ValueError, match="ax must be None or axes of matplotlib, 2 of them"):
        data.clothsim.plot(ax=given[0])
    with pytest.raises(ValueError, match="kind must be None"):
        data.clothsim.plot("heatmap")


def test_a_convergence_draws_its_errors_order_and_floor():
    found = cs.convergence(cs.scenes.oscillator(damping=2.0), 0.5, [0.2, 0.01, 0.005, 0.0025])
    axes = found.plot()
    errors, hollow, order, floor = check_lines(axes)
    assert errors.get_ydata().tolist() == found.rms.tolist() and errors.get_xdata().tolist() == found.dt.tolist()
    assert order.get_label() == f"order {found.order:.2f}" and len(order.get_xdata()) == 3
    np.testing.assert_allclose(order.get_ydata(), found.rms[1:], rtol=0.05)
    assert hollow.get_xdata().tolist() == [found.dt[0]] and floor.get_ydata().tolist() == found.floor.tolist()
    data = found.to_xarray()
    assert data["rms"].values.tolist() == found.rms.tolist() and data.attrs["order"] == found.order
    assert data["dt"].attrs == {"units": "s"} and data.attrs["duration"] == 0.5


def test_a_stability_map_draws_what_the_command_draws():
    found = measure_map(cs.scenes.oscillator(), [100.0, 10_000.0], [0.02, 0.2, 0.3])
    axes = found.to_xarray().clothsim.plot()
    stable, unstable, limit, guarantee = check_lines(axes)
    assert len(stable.get_xdata()) == 3 == len(unstable.get_xdata())
    assert limit.get_ydata().tolist() == found.limit.tolist()
    assert guarantee.get_ydata().tolist() == found.guarantee.tolist()
    with pytest.raises(ValueError, match="dataset must be of sweep, stability_map or work_precision"):
        sweep_plots.plot(xarray.Dataset({"a": 1.0}))


def test_a_fan_of_all_methods_has_lines_that_differ():
    over = {"dt": [0.02, 0.01], "integrator": list(cs.integrators())}
    scene = cs.scenes.oscillator()
    ds = cs.sweep(scene, over, duration=0.1, metrics="error", threads=1, progress=False)
    assert len(check_lines(ds.clothsim.plot.convergence())) >= 9


def test_figures_of_the_paper_have_lines_that_differ(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(paper_plots, "save", lambda figure, path: drawn.append(figure))
    window = {"steps_per_second": 40_000.0, "lower_quartile": 39_000.0, "upper_quartile": 41_000.0}
    rows = [{"method": m, "windows": [{k: m * v for k, v in window.items()}] * 3} for m in (1, 2)]
    paper_plots.methods({"rows": rows, "frame_steps": 2000, "window_frames": 10}, tmp_path)
    kinds = [
        {"kind": k, "precision": p, "threads": t, "speedup": 2.0, "runs": [1e4, 2e4]}
        for k in "ab"
        for p in "ds"
        for t in (1, 2)
    ]
    paper_plots.speedup({"rows": kinds}, tmp_path)
    (nine,), (ten,) = (figure.axes for figure in drawn)
    assert len(check_lines(nine)) == 2 and len(check_lines(ten)) == 8
    # The axis holds the data alone: 19.5 to 41 frames/s, and not the paper's 350.
    low, high = nine.get_ylim()
    assert 15 < low < 19.5 and 41 < high < 45
    names = [text.get_text() for text in ten.texts]
    assert len(names) == 8 and "a, d, 1 thread (2.0x)" in names and "b, s, 2 threads (2.0x)" in names
