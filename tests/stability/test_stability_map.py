"""The stability map and `clothsim stability`."""

import json
import sys

import clothsim as cs
import numpy as np
import pytest
from clothsim.cli import main
from clothsim.stability import measure_map

SCENE = cs.Scene(cs.Cloth((6, 7), mass=21.0, damping=20.0), gravity=(0, 0, 0))
STIFFNESS = np.geomspace(1e3, 1e7, 3)


def steps_around(scene, stiffness, factors):
    limits = [
        cs.max_stable_dt(scene.replace(cloth=scene.cloth.replace(stiffness=k)), x=scene.initial_position) / 0.97
        for k in stiffness
    ]
    return np.sort(np.outer(limits, factors).ravel())


def test_prediction_and_measurement_agree_within_a_few_percent_of_the_limit():
    dt = steps_around(SCENE, STIFFNESS, (0.8, 0.97, 1.03, 1.3))
    found = measure_map(SCENE, STIFFNESS, dt, steps=500)
    assert found.stable.shape == found.predicted.shape == (3, 12)
    assert 0 < found.stable.sum() < found.stable.size
    np.testing.assert_array_equal(found.stable, found.predicted)
    assert (found.guarantee < found.limit).all()
    for k, limit, guarantee in zip(STIFFNESS, found.limit, found.guarantee):
        one = SCENE.replace(cloth=SCENE.cloth.replace(stiffness=k))
        assert guarantee == cs.max_stable_dt(one)
        assert cs.max_stable_dt(one, x=one.initial_position) == pytest.approx(0.97 * limit, rel=1e-12, abs=0)


def test_threads_and_spheres_make_no_difference():
    dt = steps_around(SCENE, STIFFNESS, (0.9, 1.1))
    ball = SCENE.replace(spheres=cs.Sphere((0.5, 0.0, 0.5), 0.3, cs.Linear((0, 9.0, 0)), response="ray", offset="edge"))
    maps = [measure_map(SCENE, STIFFNESS, dt, steps=300, threads=n).stable for n in (1, 2)]
    maps.append(measure_map(ball, STIFFNESS, dt, steps=300).stable)
    np.testing.assert_array_equal(maps[0], maps[1])
    np.testing.assert_array_equal(maps[0], maps[2])


def test_the_dataset_is_labelled():
    pytest.importorskip("xarray")
    dt = [1e-5, 1e-1]
    data = cs.stability_map(SCENE, STIFFNESS, dt, steps=50)
    assert dict(data.sizes) == {"stiffness": 3, "dt": 2}
    assert set(data.data_vars) == {"stable", "predicted", "limit", "guarantee"}
    assert data.stable.sel(dt=1e-5).all() and not data.stable.sel(dt=1e-1).any()
    assert data.dt.attrs["units"] == data.limit.attrs["units"] == "s"
    assert data.attrs["integrator"] == "rk4"


SMALL = ("stability", "--scene", "oscillator", "--cells", "3", "5", "--steps", "200")


def test_the_command_prints_a_table(capsys):
    assert main(SMALL) == 0
    out = capsys.readouterr().out.splitlines()
    assert out[0].split()[-3:] == ["1e+02", "3.2e+04", "1e+07"]
    steps = [float(line.split()[0]) for line in out[1:6]]
    assert steps == sorted(steps, reverse=True)
    assert out[1].split()[1:] == ["x", "x", "x"] and out[5].split()[1:] == ["o", "o", "o"]
    # One spring and one mass: omega dt = sqrt(8), guaranteed and at rest.
    for line, name in ((out[6], "predicted limit"), (out[7], "guaranteed")):
        assert line.startswith(name)
        found = [float(cell) for cell in line.removeprefix(name).split()]
        np.testing.assert_allclose(found, np.sqrt(8 / np.geomspace(1e2, 1e7, 3)), rtol=5e-3)
    assert "0 of 15 cells" in out[8]


def test_the_command_writes_picture_and_csv(capsys, tmp_path):
    pytest.importorskip("matplotlib")
    from matplotlib.image import imread

    folder = tmp_path / "made" / "by it"
    assert main([*SMALL, "--out", str(folder), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    rows = (folder / "stability.csv").read_text().splitlines()
    assert rows[0] == "stiffness,dt,stable,predicted,limit,guarantee" and len(rows) == 16
    assert [int(row.split(",")[2]) for row in rows[1:]] == np.ravel(found["stable"]).tolist()
    picture = imread(folder / "stability.png")
    red = (picture[..., 0] > 0.7) & (picture[..., 2] < 0.3)
    blue = (picture[..., 2] > 0.6) & (picture[..., 0] < 0.3)
    assert red.sum() > 100 and blue.sum() > 100
    # Stable runs lie below unstable ones.
    assert np.argwhere(blue)[:, 0].mean() > np.argwhere(red)[:, 0].mean()


def test_the_table_needs_no_extra(capsys, monkeypatch, tmp_path):
    for name in ("xarray", "matplotlib", "tqdm"):
        monkeypatch.setitem(sys.modules, name, None)
    assert main(SMALL) == 0
    capsys.readouterr()
    assert main([*SMALL, "--out", str(tmp_path)]) == 1
    assert "pip install 'clothsim[plot]'" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments, named",
    [
        (("--out", __file__), "--out must be a folder"),
        (("--integrator", "implicit_midpoint"), "--dt must be given"),
        (("--hard-cases",), "--scene does not go with --hard-cases"),
    ],
)
def test_wrong_options_of_the_command(capsys, arguments, named):
    assert main([*SMALL, *arguments]) == 2
    err = capsys.readouterr().err
    assert named in err and err.count("\n") == 1


def hard_cases(monkeypatch, *names):
    cases = cs.scenes.hard_cases()
    chosen = {name: cases[name] for name in names}
    monkeypatch.setattr(cs.scenes, "hard_cases", lambda: chosen)
    return chosen


@pytest.mark.parametrize("as_json", [False, True])
def test_the_command_runs_the_hard_cases(capsys, monkeypatch, as_json):
    names = ("dt at 1.05 of the limit", "a point at the exact centre")
    chosen = hard_cases(monkeypatch, *names)
    assert main(["stability", "--hard-cases", *(["--json"] if as_json else [])]) == 0
    out = capsys.readouterr().out
    if as_json:
        results = json.loads(out)
        assert [(r["case"], r["precision"]) for r in results] == [
            (name, precision) for name in names for precision in ("double", "single")
        ]
        assert all(r["passed"] and len(r["figures"]) > 1 for r in results)
    else:
        assert all(case.expected in out and case.why in out for case in chosen.values())
        assert out.splitlines()[-1] == "4 of 4 runs as expected"


@pytest.mark.parametrize("option", ["--out x", "--cells 2 2", "--dt 1e-3 1e-2", "--precision single"])
def test_hard_cases_take_no_option_of_the_map(capsys, option):
    assert main(["stability", "--hard-cases", *option.split()]) == 2
    assert f"{option.split()[0]} does not go with --hard-cases" in capsys.readouterr().err


def test_a_hard_case_that_fails_is_code_1(capsys, monkeypatch):
    import dataclasses

    chosen = hard_cases(monkeypatch, "dt at 1.05 of the limit", "a point at the exact centre")
    name, case = next(iter(chosen.items()))
    chosen[name] = dataclasses.replace(case, dt=case.dt / 2)
    assert main(["stability", "--hard-cases"]) == 1
    captured = capsys.readouterr()
    assert "FAIL  double" in captured.out and "2 of 4 runs as expected" in captured.out
    assert captured.err == f"clothsim stability: error: not as expected: {name}\n"
