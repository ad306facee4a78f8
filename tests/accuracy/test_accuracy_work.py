"""Error against cost: the measurements."""

import math
from dataclasses import replace

import clothsim as cs
import numpy as np
import pytest
from clothsim.accuracy import Method, work
from clothsim.accuracy.work import is_on_pareto_front, method_of_integrator

pytest.importorskip("xarray", reason="work_precision returns an xarray.Dataset")

DURATION = 0.1
SHAPE = (6, 7)


@pytest.fixture(scope="module")
def scene():
    return cs.Scene(cs.Cloth(SHAPE, mass=21.0, damping=20.0))


@pytest.fixture(scope="module")
def solution(scene):
    return cs.reference(scene, DURATION)


@pytest.fixture(scope="module")
def data(scene, solution):
    return cs.work_precision(
        scene,
        DURATION,
        ["rk4", "semi_implicit_euler"],
        precisions=["double", "single"],
        dts=[2e-2, 1e-3, 5e-4],
        windows=2,
        reference=solution,
    )


@pytest.fixture
def recorder(solution):
    """Return a method with the rms error setting^4, and the list of its calls.

    They take 1 ms / setting, and 0.1 ms more each.
    """
    calls = []

    def solve(scene, duration, setting):
        calls.append(setting)
        x = solution.x[-1].copy()
        x[2, 3, 0] += setting**4 * math.sqrt(math.prod(SHAPE))
        return x, solution.v[-1].copy(), round(10 / setting), 1e-3 / setting + 1e-4 * len(calls)

    return Method("known", solve, library="nobody"), calls


def test_errors_evaluations_and_drift_are_those_of_the_runs(data, scene, solution):
    assert data["rms_error"].dims == ("solver", "level")
    assert data["solver"].values.tolist() == [
        "rk4 double",
        "rk4 single",
        "semi_implicit_euler double",
        "semi_implicit_euler single",
    ]
    assert data["setting"][0].values.tolist() == [2e-2, 1e-3, 5e-4]
    run = cs.simulate(scene, DURATION, 1e-3)
    distance = np.linalg.norm(run.x[-1] - solution.x[-1], axis=-1)
    row = data.sel(solver="rk4 double", level=1)
    assert float(row["max_error"]) == pytest.approx(distance.max(), rel=1e-9, abs=0)
    assert float(row["rms_error"]) == pytest.approx(
        math.sqrt((distance**2).mean()), rel=1e-9, abs=0
    )
    assert float(row["force_evaluations"]) == 400
    drift = (
        run.report["energy"]["end"]["total"]
        - cs.energy(scene, solution.x[-1], solution.v[-1])["total"]
    )
    assert float(row["energy_drift"]) == pytest.approx(drift, rel=1e-9, abs=0)
    ratio = data["rms_error"].sel(solver="rk4 double")
    assert 14 < float(ratio[1] / ratio[2]) < 18  # order 4
    ratio = data["rms_error"].sel(solver="semi_implicit_euler double")
    assert 1.9 < float(ratio[1] / ratio[2]) < 2.1  # order 1


def test_an_unstable_run_has_an_infinite_error_and_no_time(data):
    row = data.sel(solver="rk4 double", level=0)
    assert float(row["rms_error"]) == math.inf == float(row["max_error"])
    assert math.isnan(row["wall_time"]) and math.isnan(row["energy_drift"])
    assert not row["pareto"]


def test_the_energy_drift_of_an_undamped_scene_is_the_change_of_energy():
    scene = cs.scenes.oscillator()
    table = cs.work_precision(scene, 1.0, ["rk4"], dts=[0.02], windows=1)
    x, v = cs.step(scene, scene.initial_position, scene.initial_velocity, 0.02, 50)
    change = cs.energy(scene, x, v)["total"] - 0.5
    assert float(table["energy_drift"][0, 0]) == pytest.approx(change, rel=1e-6, abs=0)


def test_a_users_method_and_the_least_of_its_times(scene, solution, recorder):
    method, calls = recorder
    table = cs.work_precision(
        scene, DURATION, [method], dts=[0.25, 0.5], windows=3, reference=solution
    )
    assert sorted(calls) == [0.25] * 4 + [0.5] * 4
    assert table["rms_error"][0].values == pytest.approx([0.5**4, 0.25**4], rel=1e-9, abs=0)
    # The first run of each is not timed; the least of the others is row of calls 3 and 4.
    least = table["wall_time"][0].values * DURATION - 1e-3 / table["setting"][0].values
    assert sorted(least) == pytest.approx([3e-4, 4e-4], rel=1e-9, abs=0)
    assert table["pareto"].all() and table["library"].item() == "nobody"


def test_the_largest_error_over_the_frames_and_the_spread_of_the_times(scene):
    solution = cs.reference(scene, DURATION, every=DURATION / 4)
    ends = []
    seconds = iter([9.0, 1.0, 1.0, 1.0, 1e-3, 2e-3, 5e-3])

    def solve(scene, duration, setting):
        ends.append(duration)
        x = solution.x[round(4 * duration / DURATION)].copy()
        x[2, 3, 0] += (4e-3 if duration < 0.6 * DURATION else 1e-3) * math.sqrt(math.prod(SHAPE))
        return x, solution.v[-1], 1, next(seconds)

    table = cs.work_precision(
        scene, DURATION, [Method("known", solve)], dts=[0.5], windows=3, reference=solution
    )
    assert ends == pytest.approx([DURATION, *solution.t[1:-1], *[DURATION] * 3])
    assert float(table["rms_error"][0, 0]) == pytest.approx(1e-3)
    assert float(table["frames_rms_error"][0, 0]) == pytest.approx(4e-3)
    assert float(table["wall_time"][0, 0]) == pytest.approx(1e-3 / DURATION)
    assert float(table["wall_time_spread"][0, 0]) == pytest.approx(
        2e-3 / DURATION
    )  # of 1.5 and 3.5 ms


@pytest.mark.parametrize("control", ["dt", "rtol"])
def test_default_settings_of_a_users_method(scene, solution, recorder, control, monkeypatch):
    monkeypatch.setattr(work, "_LONGEST", math.inf)
    method, calls = recorder
    cs.work_precision(
        scene, DURATION, [replace(method, control=control)], windows=1, reference=solution
    )
    coarsest = min(0.95 * cs.max_stable_dt(scene), DURATION / 4)
    settings = coarsest / 2 ** np.arange(7) if control == "dt" else 10.0 ** -np.arange(3, 14)
    np.testing.assert_allclose(calls[: len(settings)], settings)


def test_finer_settings_are_left_out_after_a_long_run(scene, solution, recorder, monkeypatch):
    monkeypatch.setattr(work, "_LONGEST", 2e-3)
    method, calls = recorder
    table = cs.work_precision(
        scene, DURATION, [method], dts=[0.5, 0.25], windows=1, reference=solution
    )
    assert calls == [0.5, 0.5]
    assert np.isnan(table["setting"][0, 1]) and np.isfinite(table["wall_time"][0, 0])


def test_pareto():
    rms = np.array([[1e-3, 1e-4, np.inf], [1e-3, 1e-5, 1e-9]])
    cost = np.array([[1.0, 3.0, 0.1], [2.0, 3.0, np.nan]])
    assert is_on_pareto_front(rms, cost).tolist() == [[True, False, False], [False, True, False]]


def test_a_tolerance_below_rounding_ends(scene, monkeypatch):
    method = method_of_integrator("dopri5 adaptive", "single")
    spent = []
    simulate = work.simulate
    monkeypatch.setattr(
        work, "simulate", lambda *a, **k: spent.append(simulate(*a, **k)) or spent[-1]
    )
    method.solve(scene, DURATION, 1e-13)
    assert spent[0].report["force_evaluations"] <= 3020
    assert "smallest tolerance" in spent[0].report["error_estimate"]["reason"]


def test_five_methods_in_double_are_compared_by_default():
    methods = work._list_methods(None, ["double"], None, None)
    assert len(methods) == 5 and {"rk4", "dop853 adaptive"} < {method.name for method in methods}
