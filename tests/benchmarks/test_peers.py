"""Solvers of other programs on clothsim's scenes, and the script that puts them beside its integrators."""

import clothsim as cs
import numpy as np
import pytest
from peers import solvers as peers
from peers.__main__ import main

DURATION = 0.1
SCENE = cs.Scene(cs.Cloth((6, 7), mass=21.0, damping=20.0))


@pytest.fixture(scope="module")
def solution():
    return cs.reference(SCENE, DURATION)


def test_peers_refuse_unknown_features():
    cloth = SCENE.cloth
    heavy = SCENE.replace(cloth=cloth.replace(mass=np.linspace(1, 2, 42).reshape(6, 7)))
    assert peers.refused(SCENE) is None
    assert "uniform mass" in peers.refused(heavy)
    assert "spheres" in peers.refused(cs.scenes.paper_static())


def test_peers_that_are_not_installed_are_named(monkeypatch, capsys):
    monkeypatch.setattr(peers, "find_spec", lambda name: None)
    found, missing = peers.installed_peers(SCENE)
    assert found == []
    assert missing == [f"{name} is not installed" for name in ("numba", "scipy", "diffrax")]
    pytest.importorskip("xarray")
    main(["oscillator", "--duration", "0.2", "--method", "rk4", "--windows", "1", "--errors", "1e-3"])
    out, err = capsys.readouterr()
    assert "0.001" in out and "rk4" in out and "Not measured: numba is not installed" in err


def _close(method, setting, solution, bound):
    x, v, evaluations, seconds = method.solve(SCENE, DURATION, setting)
    assert seconds > 0 and evaluations > 10
    assert solution.error_of(x)["rms"] < bound
    assert abs(v - solution.v[-1]).max() < 1e4 * bound


@pytest.mark.peers
def test_numba_peers_solve_the_scene(solution):
    _close(peers.numba_rk4(), 5e-4, solution, 2e-10)
    _close(peers.scipy("DOP853"), 1e-9, solution, 1e-9)
    _close(peers.scipy("RK45"), 1e-7, solution, 1e-7)


@pytest.mark.peers
def test_diffrax_peers_solve_the_scene(solution):
    _close(peers.diffrax("Tsit5", 6), 1e-7, solution, 1e-7)
    _close(peers.diffrax("Dopri8", 13), 1e-9, solution, 1e-9)
