"""Lines of all figures can be told apart, by readers of any colour vision too."""

from itertools import combinations

import clothsim as cs
import numpy as np
import pytest
from clothsim.viewing.page import SHADING
from clothsim.viewing.plots import style

pytest.importorskip("matplotlib")
pytest.importorskip("xarray")
pytest.importorskip("clothsim.sweeps.accessor")  # registers Dataset.clothsim

import xarray
from colors import LEAST, check_lines, distance
from matplotlib import pyplot


def test_the_palette_is_that_of_every_figure_and_page():
    assert min(distance(a, b) for a, b in combinations(style.COLORS, 2)) >= LEAST
    assert SHADING["colors"] == style.COLORS
    styles = [tuple(map(str, style.line_style(k).values())) for k in range(72)]
    assert len(set(styles)) == 72


def made_up_work():
    """Return rows of all methods in both precisions, and two adaptive ones."""
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
    assert (
        len(lines) == data.sizes["solver"] and len(axes) == 2 and axes[0].figure.axes == list(axes)
    )
    looks = {line.get_label().split()[0]: (line.get_color(), line.get_marker()) for line in lines}
    assert len({color for color, _ in looks.values()}) == 8
    few = data.isel(solver=[0, 10, 19]).copy(deep=True)
    few["rms_error"][:2] = 1e-8  # the second line goes on where the first ends
    for panel in few.clothsim.plot():
        named = [line for line in panel.lines if not line.get_label().startswith("_")]
        assert [looks[line.get_label().split()[0]] for line in named] == [
            (n.get_color(), n.get_marker()) for n in named
        ]
        ends = [n.get_transform().transform(n.get_xydata()) for n in named]
        ink = np.concatenate([np.linspace(*two, 200) for two in ends])
        boxes = [
            text.get_window_extent()
            for text in panel.texts
            if text.get_text() in {n.get_label() for n in named}
        ]
        assert len(boxes) == 3 and not any(box.count_contains(ink) for box in boxes)
        assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))
    # A half of the errors is below that of the reference.
    data.attrs["reference_error_estimate_rms"] = float(data["rms_error"].median())
    hollow = [
        line for line in data.clothsim.plot()[1].lines if line.get_markerfacecolor() == "white"
    ]
    errors = np.concatenate([line.get_ydata() for line in hollow])
    assert (
        len(errors) == data.sizes["solver"]
        and errors.max() < data.attrs["reference_error_estimate_rms"]
    )
    given = pyplot.subplots(1, 2)[1]
    assert data.clothsim.plot(ax=given)[1] is given[1]
    with pytest.raises(ValueError, match="ax must be None or axes of matplotlib, 2 of them"):
        data.clothsim.plot(ax=[*given, given[0]])
    (alone,) = data.clothsim.plot(ax=given[:1])  # against wall time alone
    assert alone is given[0] and alone.get_xlabel().startswith("wall time")
    with pytest.raises(ValueError, match="kind must be None"):
        data.clothsim.plot("heatmap")


def test_a_convergence_draws_its_errors_order_and_floor():
    found = cs.convergence(cs.scenes.oscillator(damping=2.0), 0.5, [0.2, 0.01, 0.005, 0.0025])
    axes = found.plot()
    errors, hollow, order, floor = check_lines(axes)
    assert (
        errors.get_ydata().tolist() == found.rms.tolist()
        and errors.get_xdata().tolist() == found.dt.tolist()
    )
    assert order.get_label() == f"order {found.order:.2f}" and len(order.get_xdata()) == 3
    np.testing.assert_allclose(order.get_ydata(), found.rms[1:], rtol=0.05)
    assert (
        hollow.get_xdata().tolist() == [found.dt[0]]
        and floor.get_ydata().tolist() == found.floor.tolist()
    )
