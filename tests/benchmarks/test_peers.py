"""Solvers of other programs on clothsim's scenes, and the script that puts them beside its own."""

import clothsim as cs
import numpy as np
import pytest
from peers import solvers as peers
from peers.__main__ import best, fastest, main

DURATION = 0.1
SCENE = cs.Scene(cs.Cloth((6, 7), mass=21.0, damping=20.0))


@pytest.fixture(scope="module")
def solution():
    return cs.reference(SCENE, DURATION)


def test_peers_that_are_not_installed_are_named(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(peers, "find_spec", lambda name: None)
    methods, missing = peers.installed_peers(SCENE)
    assert methods == []
    assert missing == [f"{name} is not installed" for name in ("numba", "scipy", "diffrax")]
    pytest.importorskip("xarray")
    image = pytest.importorskip("matplotlib.image")
    options = [
        "--method",
        "rk4",
        "--windows",
        "1",
        "--errors",
        "1e-3",
        "--out",
        str(tmp_path / "speed.png"),
    ]
    main(["oscillator", "--duration", "0.2", *options])
    out, err = capsys.readouterr()
    assert "0.001" in out and "rk4" in out and "Not measured: numba is not installed" in err
    assert f"clothsim {cs.__version__} (" in out and "numpy " in out
    assert image.imread(tmp_path / "speed.png").shape[1] == 1400


def runs():
    """Return two solvers of clothsim and two of others.

    The second of each pair has one run that counts, or none.
    """
    xarray = pytest.importorskip("xarray")
    names = ["a", "b", "c", "d"]
    time = np.array([[1.0, 4.0], [2.0, 3.0], [5.0, 6.0], [7.0, np.nan]])
    error = np.array([[1e-3, 1e-9], [1e-2, 1e-6], [1e-3, 1e-6], [1e-3, np.inf]])
    columns = {
        "wall_time": time,
        "rms_error": error,
        "frames_rms_error": 2 * error,
        "wall_time_spread": time / 20,
    }
    columns |= {"setting": time, "force_evaluations": 1e3 * time, "pareto": time < 0}
    labels = dict.fromkeys(("solver", "integrator"), ("solver", names))
    labels |= {
        "library": ("solver", ["clothsim"] * 2 + ["other"] * 2),
        "control": ("solver", ["dt"] * 4),
    }
    labels |= {"precision": ("solver", ["double"] * 4), "level": [0, 1]}
    return xarray.Dataset(
        {key: (("solver", "level"), value) for key, value in columns.items()}, labels
    )


def test_the_figure_has_the_front_of_clothsim_and_the_best_peers():
    lines = best(runs())
    assert lines.solver.values.tolist() == ["clothsim", "c"]
    assert lines.wall_time[0].values.tolist() == [1.0, 3.0, 4.0]
    assert lines.rms_error[0].values.tolist() == [1e-3, 1e-6, 1e-9]


def test_a_row_has_spread_both_errors_and_the_ratio():
    own_row, other_row = fastest(runs(), [1e-6])
    assert own_row[1:] == ("clothsim", "b", "3", "3", "5%", "1.0e-06", "2.0e-06", "3000", "")
    assert other_row[1:] == ("other", "c", "6", "6", "5%", "1.0e-06", "2.0e-06", "6000", "2.0")


def _close(method, setting, solution, bound):
    x, v, evaluations, seconds = method.solve(SCENE, DURATION, setting)
    assert seconds > 0 and evaluations > 10
    assert solution.error_of(x)["rms"] < bound
    assert abs(v - solution.v[-1]).max() < 1e4 * bound


def test_the_default_call_is_timed_with_its_estimate(solution):
    _close(peers.default_call(), 1e-7, solution, 1e-7)
    *_, evaluations, _ = peers.default_call().solve(SCENE, DURATION, 1e-7)
    run = cs.simulate(SCENE, DURATION, rtol=1e-7)
    assert evaluations == run.report["force_evaluations"] > run.report["solution_evaluations"]


@pytest.mark.peers
def test_numba_peers_solve_the_scene(solution):
    _close(peers.numba_rk4(), 5e-4, solution, 2e-10)
    _close(peers.scipy("DOP853"), 1e-9, solution, 1e-9)
    _close(peers.scipy("RK45"), 1e-7, solution, 1e-7)


@pytest.mark.peers
def test_diffrax_peers_solve_the_scene(solution):
    _close(peers.diffrax("Tsit5", 6), 1e-7, solution, 1e-7)
    _close(peers.diffrax("Dopri8", 13), 1e-9, solution, 1e-9)
