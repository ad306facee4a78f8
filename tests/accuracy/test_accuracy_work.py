"""Error against cost: the measurements, their tables and pictures, and the search for settings."""

import csv
import json
import math
from dataclasses import dataclass, field

import clothsim as cs
import numpy as np
import pytest
from clothsim.accuracy import fastest, methods
from clothsim.accuracy import work_table as tables
from clothsim.accuracy.front import Front, Row, cheapest
from clothsim.accuracy.measured import Measured, pareto
from clothsim.accuracy.methods import Outcome, own_methods
from clothsim.cli import main

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
        scene, DURATION, ["rk4", "semi_implicit_euler"], dts=[2e-2, 1e-3, 5e-4], windows=2, reference=solution
    )


@dataclass
class Known:
    """A method with the rms error setting^4; calls take 1 ms / setting, and 0.1 ms more each."""

    solution: cs.Reference
    name: str = "known"
    library: str = "nobody"
    precision: str = "double"
    threads: int | None = None
    control: str = "dt"
    calls: list = field(default_factory=list)

    def settings(self, scene, duration):
        return [0.5, 0.25]

    def solve(self, scene, duration, setting):
        self.calls.append(setting)
        x = self.solution.x[-1].copy()
        x[2, 3, 0] += setting**4 * math.sqrt(math.prod(SHAPE))
        seconds = 1e-3 / setting + 1e-4 * len(self.calls)
        return Outcome(x, self.solution.v[-1].copy(), round(10 / setting), seconds)


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
    one = data.sel(solver="rk4 double", level=1)
    assert float(one["max_error"]) == pytest.approx(distance.max(), rel=1e-9, abs=0)
    assert float(one["rms_error"]) == pytest.approx(math.sqrt((distance**2).mean()), rel=1e-9, abs=0)
    assert float(one["force_evaluations"]) == 400
    drift = run.report["energy"]["end"]["total"] - cs.energy(scene, solution.x[-1], solution.v[-1])["total"]
    assert float(one["energy_drift"]) == pytest.approx(drift, rel=1e-9, abs=0)
    ratio = data["rms_error"].sel(solver="rk4 double")
    assert 14 < float(ratio[1] / ratio[2]) < 18  # order 4
    ratio = data["rms_error"].sel(solver="semi_implicit_euler double")
    assert 1.9 < float(ratio[1] / ratio[2]) < 2.1  # order 1


def test_an_unstable_run_has_an_infinite_error_and_no_time(data):
    one = data.sel(solver="rk4 double", level=0)
    assert float(one["rms_error"]) == math.inf == float(one["max_error"])
    assert math.isnan(one["wall_time"]) and math.isnan(one["energy_drift"])
    assert not one["pareto"]


def test_the_energy_drift_of_an_undamped_scene_is_the_change_of_energy():
    scene = cs.scenes.oscillator()
    found = cs.work_precision(scene, 1.0, ["rk4"], precisions=["double"], dts=[0.02], windows=1)
    x, v = cs.step(scene, scene.initial_position, scene.initial_velocity, 0.02, 50)
    change = cs.energy(scene, x, v)["total"] - 0.5
    assert float(found["energy_drift"][0, 0]) == pytest.approx(change, rel=1e-6, abs=0)


def test_a_users_method_and_the_least_of_its_times(scene, solution):
    known = Known(solution)
    found = cs.work_precision(scene, DURATION, [known], windows=3, reference=solution)
    assert sorted(known.calls) == [0.25] * 4 + [0.5] * 4
    assert found["rms_error"][0].values == pytest.approx([0.5**4, 0.25**4], rel=1e-9, abs=0)
    # The first run of each is not timed; the least of the others is one of calls 3 and 4.
    least = found["wall_time"][0].values * DURATION - 1e-3 / found["setting"][0].values
    assert sorted(least) == pytest.approx([3e-4, 4e-4], rel=1e-9, abs=0)
    assert not found["pareto"].any() and found["pareto_all"].all()


def test_finer_settings_are_left_out_after_a_long_run(scene, solution):
    known = Known(solution)
    found = cs.work_precision(scene, DURATION, [known], windows=1, longest=2e-3, reference=solution)
    assert known.calls == [0.5, 0.5]
    assert found.sizes["level"] == 1


def test_pareto():
    rms = np.array([[1e-3, 1e-4, np.inf], [1e-3, 1e-5, 1e-9]])
    cost = np.array([[1.0, 3.0, 0.1], [2.0, 3.0, np.nan]])
    assert pareto(rms, cost).tolist() == [[True, False, False], [False, True, False]]


def test_cheapest_finds_the_setting_and_asks_little():
    asked = []

    def error(dt):
        asked.append(dt)
        return math.inf if dt > 0.3 else dt**4

    found = cheapest(error, 1.0, 1e-6, 1e-12)
    assert 0.97e-3 < found <= 1e-3
    assert len(asked) < 20
    assert cheapest(error, 0.1, 1e-6, 1.0) == 0.1
    assert cheapest(error, 1.0, 1e-2, 1e-12) is None


@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
def test_the_fastest_are_found_with_each_method_at_its_cheapest_setting(scene, solution):
    found = fastest(
        scene, DURATION, [1e-7, 1e-10], methods=["rk4", "dop853"], precisions=["double"], windows=2, reference=solution
    )
    assert found.errors == (1e-7, 1e-10)
    for error in found.errors:
        rows = found.at(error)
        assert "rk4" in {row.result.method.name for row in rows}
        times = [found.wall_time(row) for row in rows]
        assert times == sorted(times)
        for row in rows:
            assert row.result.rms <= error
            # The search ends within 3 % of a setting that fails; how the steps divide the duration
            # makes the error jump, so not all larger ones do.
            more = [factor * row.result.setting for factor in (1.01, 1.02, 1.03, 1.05)]
            name = row.result.method.name
            assert max(_error(scene, solution, name, dt) for dt in more) > error
    # Where the run stands it, a setting is above what is guaranteed for any state.
    coarsest = {row.result.method.name: row.result.setting for row in found.at(1e-7)}
    assert all(dt > cs.max_stable_dt(scene, name) for name, dt in coarsest.items())


def _error(scene, solution, integrator, dt):
    try:
        run = cs.simulate(scene, DURATION, dt, integrator=integrator)
    except cs.UnstableError:
        return math.inf
    return solution.error_of(run.x[-1])["rms"]


def _front_of(*entries):
    """A `Front` over 0.5 s with (error, name, library, seconds)."""
    rows = []
    for error, name, library, seconds in entries:
        method = Known(None, name=name, library=library)
        result = Measured(method, 1e-3, error / 2, error, 100, 0.0, 0.0, [seconds, 2 * seconds])
        rows.append(Row(error, result))
    rows.sort(key=lambda row: (-row.error, row.result.fastest))
    errors = tuple(sorted({row.error for row in rows}, reverse=True))
    return Front(cs.scenes.oscillator(), 0.5, errors, tuple(rows))


def test_the_statement_names_the_fastest_the_next_and_the_best_peer():
    found = _front_of(
        (1e-6, "rk4", "clothsim", 0.010),
        (1e-6, "dop853", "clothsim", 0.004),
        (1e-6, "DOP853", "SciPy", 0.044),
        (1e-6, "rk4", "numba", 0.030),
    )
    (one,) = found.statement()
    assert one["fastest"] == "dop853 double" and one["next"] == "rk4 double"
    assert one["wall_time"] == pytest.approx(0.008, rel=1e-12, abs=0)
    assert one["next_ratio"] == pytest.approx(2.5, rel=1e-12, abs=0)
    assert one["peer"] == "rk4 double" and one["peer_ratio"] == pytest.approx(7.5, rel=1e-12, abs=0)
    text = str(found)
    assert "dop853 double" in text and "7.50x" in text


def test_csv_and_picture(data, tmp_path):
    table, *pictures = tables.write_runs(data, tmp_path / "runs")
    lines = table.read_text().splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert len(rows) == 12 and tuple(rows[0]) == tables.COLUMNS
    assert float(rows[1]["rms_error"]) == float(data["rms_error"][0, 1])
    assert rows[0]["rms_error"] == "inf" and rows[1]["solver"] == "rk4 double"
    assert any(line.startswith("# duration: 0.1") for line in lines)
    pytest.importorskip("matplotlib")
    (path,) = pictures
    assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" and path.stat().st_size > 20_000


def test_the_command(tmp_path, capsys):
    options = "oscillator --duration 0.2 --method rk4 --precision double --windows 1 --out"
    arguments = ["work-precision", *options.split(), str(tmp_path / "out")]
    assert main(arguments) == 0
    text = capsys.readouterr().out
    assert "rk4 double" in text and "oscillator.csv" in text
    assert (tmp_path / "out" / "oscillator.csv").exists()
    assert main([*arguments, "--json"]) == 0
    runs = json.loads(capsys.readouterr().out)["runs"]
    assert len(runs) == 7 and runs[0]["solver"] == "rk4 double"
    assert main([*arguments[:-2], "--fastest"]) == 0
    assert "next method" in capsys.readouterr().out
    assert main([*arguments[:-2], "--fastest", "--errors", "1e-3,2e-6", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [one["error"] for one in found] == [1e-3, 2e-6]
    assert main([*arguments[:-2], "--fastest", "--errors", "1e-3 2e-6"]) == 2
    assert "--errors must be numbers with commas" in capsys.readouterr().err
    assert main([*arguments, "--errors", "1e-3"]) == 2
    assert "--errors needs --fastest" in capsys.readouterr().err
    assert main([*arguments, "--bend"]) == 2
    assert "--bend does not go with oscillator" in capsys.readouterr().err
    (tmp_path / "file").write_text("")
    assert main([*arguments[:-1], str(tmp_path / "file")]) == 2
    assert main(["work-precision", "paper_static", "--duration", "0.4"]) == 2
    assert "chaotic" in capsys.readouterr().err


@pytest.mark.parametrize("arguments, option", [("--fastest --out x", "--out")])
def test_the_command_ignores_no_option(capsys, arguments, option):
    assert main(["work-precision", *arguments.split()]) == 2
    assert f"{option} does not go with --fastest" in capsys.readouterr().err


def test_a_tolerance_below_rounding_ends(scene, monkeypatch):
    (method,) = own_methods(["dopri5 adaptive"], ["single"])
    spent = []
    simulate = methods.simulate
    monkeypatch.setattr(methods, "simulate", lambda *a, **k: spent.append(simulate(*a, **k)) or spent[-1])
    monkeypatch.setattr(methods, "_MOST_EVALUATIONS", 3000)
    method.solve(scene, DURATION, 1e-13)
    assert spent[0].report["force_evaluations"] <= 3020
    assert "smallest tolerance" in spent[0].report["error_estimate"]["reason"]
    monkeypatch.setattr(methods, "_MOST_EVALUATIONS", 500)
    method.solve(scene, DURATION, 1e-13)
    assert spent[1].report["force_evaluations"] <= 520
    assert "max_evaluations" in spent[1].report["error_estimate"]["reason"]


def test_bad_arguments(scene, solution):
    options = {"reference": solution}
    with pytest.raises(ValueError, match="methods must be one of .*did you mean 'rk4'"):
        cs.work_precision(scene, DURATION, ["rk5"], **options)
    with pytest.raises(ValueError, match="at least one method"):
        cs.work_precision(scene, DURATION, [], **options)
    with pytest.raises(ValueError, match=r"precisions\[0\]"):
        cs.work_precision(scene, DURATION, ["rk4"], precisions=["half"], **options)
    with pytest.raises(ValueError, match=r"dts\[0\]"):
        cs.work_precision(scene, DURATION, ["rk4"], dts=[-1.0], **options)
    with pytest.raises(ValueError, match="windows"):
        cs.work_precision(scene, DURATION, ["rk4"], windows=0, **options)
    with pytest.raises(TypeError, match="scene"):
        cs.work_precision(None, DURATION)


def test_own_methods_by_default_are_all_in_both_precisions():
    names = {(m.name, m.precision) for m in own_methods()}
    for name, one in cs.integrators().items():
        for precision in ("double", "single"):
            assert (name, precision) in names
            assert ((f"{name} adaptive", precision) in names) == one.adaptive


def test_one_name_is_no_sequence_of_methods(scene):
    with pytest.raises(TypeError, match=r"^methods must be a sequence of names and methods, got 'rk4' \(str\)"):
        cs.work_precision(scene, 0.05, methods="rk4")
