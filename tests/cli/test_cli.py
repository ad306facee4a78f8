"""The command line: output, JSON, exit codes and one-line errors."""

import json
import re
import subprocess
import sys

import clothsim as cs
import numpy as np
import pytest
from clothsim.cli import COMMANDS
from commands import run


@pytest.mark.parametrize("command", [[], *([name] for name in COMMANDS)], ids=str)
def test_help_has_at_most_80_columns_in_a_wide_terminal(capsys, monkeypatch, command):
    monkeypatch.setenv("COLUMNS", "200")
    code, out, err = run(capsys, *command, "--help")
    assert (code, err) == (0, "")
    assert out.startswith(" ".join(["usage: clothsim", *command]))
    assert max(map(len, out.splitlines())) <= 80
    if command:
        assert "--json" in out


def _strict(text):
    """`text` as JSON for any reader, which knows no NaN."""
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


@pytest.mark.parametrize(
    "command",
    [
        "run paper_static --duration 0.3 --dt 1e-3",
        "run oscillator --duration 0.1",
        "scene paper_moving",
        "stability --scene oscillator --stiffness 100 1000 --dt 0.01 1 --cells 2 3 --steps 20",
        "sweep paper_swing --stiffness 35000,1e12 --dt 1e-3 --duration 0.01 --metric error,energy_gained",
        "work-precision oscillator --duration 0.2 --method rk4 --windows 1 --out OUT",
        "work-precision oscillator --duration 0.2 --method rk4 --windows 1 --fastest --errors 1e-3,1e-30",
        "live paper_swing --out OUT/live.html",
    ],
)
def test_every_command_prints_strict_json(capsys, tmp_path, command):
    pytest.importorskip("xarray")
    code, out, _ = run(capsys, *command.replace("OUT", str(tmp_path)).split(), "--json")
    assert code == 0 and _strict(out)


def test_an_unknown_number_is_null_beside_its_reason(capsys):
    _, out, _ = run(capsys, "run", "paper_static", "--duration", "0.3", "--dt", "1e-3", "--json")
    report = _strict(out)
    assert report["energy"]["gained"] is None and "a sphere responded" in report["energy"]["reason"]
    assert report["error_estimate"]["rms"] is None


def test_the_text_of_a_run_has_the_examined_measures(capsys):
    """And the energies where a sphere responded."""
    options = ("--duration", "0.3")
    _, out, _ = run(capsys, "run", "paper_static", *options, "--dt", "1e-3")
    shown = dict(line.split("  ", 1) for line in out.splitlines())
    assert not {"tolerance", "chaotic"} & set(shown)
    assert shown["energy, start"].strip().startswith("kinetic 0 J") and "kinetic" in shown["energy, end"]
    assert shown["energy, gained"].strip() == "a sphere responded, and responses change the energy"
    _, out, _ = run(capsys, "run", "paper_swing", "--duration", "0.05")
    assert re.search(r"tolerance +0.001 m by default, reached\n", out)
    _, out, _ = run(capsys, "run", "paper_swing", "--duration", "0.05", "--rtol", "1e-4")
    assert re.search(r"tolerance +asked 0.0001 m, reached yes\n", out)


def test_a_scene_is_printed_as_a_file_to_edit(capsys, tmp_path):
    code, out, err = run(
        capsys, "scene", "paper_static", "--response", "continuous", "--friction", "0.3", "--stiffness", "2e4"
    )
    assert (code, err) == (0, "")
    path = tmp_path / "my.toml"
    path.write_text(out.replace("mass = 512.0", "mass = 500.0"))
    scene, ready = cs.load_scene(path), cs.scenes.paper_static()
    (sphere,) = ready.spheres
    sphere = sphere.replace(response="continuous", friction=0.3)
    assert scene == ready.replace(cloth=ready.cloth.replace(stiffness=2e4, mass=500.0), spheres=sphere)
    code, out, _ = run(capsys, "stability", "--scene", path, "--cells", 2, 2, "--steps", 10, "--json")
    assert code == 0 and json.loads(out)["limit"]


def test_options_change_the_scene_of_a_run(capsys, tmp_path):
    path = tmp_path / "run.npz"
    options = ("--dt", "1e-3", "--duration", "0.005", "--out", path)
    changes = "--damping 20 --drag 0.5 --gravity 0;-1;0 --set sphere_center_y=-0.6 --set stiffness_shear=2e4"
    assert run(capsys, f"run paper_static {changes}", *options)[0] == 0
    scene = cs.load_run(path).scene
    assert (scene.cloth.damping, scene.cloth.drag, scene.gravity) == (20, 0.5, (0, -1, 0))
    assert scene.spheres[0].center == (0.5, -0.6, 0.5) and scene.cloth.family_stiffness["shear"] == 2e4
    assert run(capsys, "run", "1e6 m away", *options)[0] == 0
    assert cs.load_run(path).scene == cs.scenes.hard_cases()["1e6 m away"].scene


@pytest.mark.parametrize("command", ["run none.toml", "plot none.npz", "export none.npz a.obj"])
def test_a_missing_file_is_said_in_words(capsys, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    code, _, err = run(capsys, *command.split())
    name = command.split()[1]
    assert code == 1 and err == f"clothsim {command.split()[0]}: error: there is no file '{name}'\n"


def test_warnings_are_printed_above_the_bar(capsys, monkeypatch):
    """tqdm clears its bars, writes the line, and draws the bars again."""
    tqdm = pytest.importorskip("tqdm")
    lines = []
    monkeypatch.setattr(tqdm.tqdm, "write", lambda text, file: lines.append(text))
    run(capsys, "run", "paper_swing", "--dt", "1.2e-3", "--duration", "0.01")
    assert len(lines) == 1 and lines[0].startswith("clothsim run: warning: dt = 0.0012 s is above")


def test_version(capsys):
    assert run(capsys, "--version") == (0, f"clothsim {cs.__version__}\n", "")


def test_info(capsys):
    config = cs.build_config()
    code, out, _ = run(capsys, "info", "--json")
    assert code == 0
    shown = json.loads(out)
    assert shown.pop("graphics_adapters")
    assert shown == json.loads(json.dumps(config))
    code, out, _ = run(capsys, "info")
    assert code == 0
    for name in ("version", "compiler", "flags", "instruction_set", "eigen", "xsimd"):
        (line,) = (line for line in out.splitlines() if line.startswith(f"{name}:"))
        assert line.endswith(str(config[name]))


def test_run_saves_the_result_of_simulate(capsys, tmp_path):
    path = tmp_path / "swing.npz"
    code, out, err = run(capsys, "run paper_swing --duration 0.01 --dt 1e-3 --every 2 --threads 1 --json --out", path)
    assert (code, err) == (0, "")
    report = json.loads(out)
    assert report["steps"] == 10
    expected = cs.simulate(cs.scenes.paper_swing(), 0.01, dt=1e-3, every=2, threads=1)
    saved = cs.load_run(path)
    assert np.array_equal(saved.t, expected.t) and len(saved.t) == 6
    assert np.array_equal(saved.x, expected.x) and np.array_equal(saved.v, expected.v)
    assert report["energy"]["end"] == expected.report["energy"]["end"]


def test_every_is_seconds_where_it_is_no_whole_number(capsys, tmp_path):
    path = tmp_path / "swing.npz"
    options = ("--duration", "0.01", "--dt", "1e-3", "--every", "5e-3", "--out", path)
    assert run(capsys, "run", "paper_swing", *options)[0] == 0
    assert cs.load_run(path).t == pytest.approx([0, 0.005, 0.01])


def test_run_prints_the_report_as_text(capsys):
    code, out, _ = run(capsys, "run", "oscillator", "--duration", "0.1", "--precision", "single")
    assert code == 0
    shown = dict(line.split("  ", 1) for line in out.splitlines())
    assert shown["precision"].strip() == "single"
    assert int(shown["steps"]) >= 1
    assert re.fullmatch(r" +[\d.e-]+ s", shown["dt"])
    assert re.match(r" *kinetic \S+ J, elastic \S+ J, gravity \S+ J, force 0 J, total \S+ J$", shown["energy, end"])
    assert max(len(number) for number in re.findall(r"\d+", out)) <= 9, "digits are for --json"


@pytest.mark.parametrize(
    "arguments, named",
    [
        ((), "COMMAND"),
        (("nothing",), "nothing"),
        (("run",), "SCENE"),
        (("run", "no_such_scene"), "no_such_scene"),
        (("run", "1e6 m awy"), "did you mean '1e6 m away'?"),
        (("run", "paper_swing", "--radius", "1"), "sphere_radius needs a sphere"),
        (("run", "paper_swing", "--shape", "4y4"), "--shape must be like 32x32"),
        (("run", "paper_swing", "--set", "dt=1e-3"), "--set must name an argument of the scene, got 'dt'"),
        (("scene", "paper_swing", "--set", "stifness=1"), "did you mean 'stiffness'?"),
        (("run", "paper_swing", "--duration", "soon"), "--duration"),
        (("run", "paper_swing", "--duration", "-1"), "duration"),
        (("run", "paper_swing", "--dt", "nan"), "dt"),
        (("run", "paper_swing", "--every", "often"), "--every"),
        (("run", "paper_swing", "--every", "0"), "every"),
        (("run", "paper_swing", "--every", "1"), "for each step give step, for each second 1.0"),
        (("run", "paper_swing", "--every", "2", "--fps", "30"), "not allowed with"),
        (("run", "paper_swing", "--fps", "0"), "fps"),
        (("run", "paper_swing", "--precision", "half"), "--precision"),
        (("run", "paper_swing", "--threads", "0"), "--threads"),
        (("run", "paper_swing", "--out", "no/such/folder/x.npz"), "--out"),
        (("run", "paper_swing", "--duration", "1e6", "--out", "a.h5"), "--out must end in .npz"),
        (("reproduce", "--experiment", "6"), "--experiment"),
        (("reproduce", "--threads", "two"), "--threads"),
        (("info", "--colour"), "--colour"),
        (("bench", "--quick"), "bench is a script of a clone now: python benchmarks/bench"),
        (("contact",), "python benchmarks/contact"),
        (("work-precision", "--peers"), "--peers is a script of a clone now: python benchmarks/peers"),
    ],
)
def test_wrong_input_is_code_2_and_one_line(capsys, arguments, named):
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("clothsim") and ": error: " in err
    assert named in err and err.count("\n") == 1


@pytest.mark.parametrize(
    "command", [("reproduce", "--quick"), ("work-precision", "paper_swing"), ("stability",)], ids=lambda command: command[0]
)
@pytest.mark.parametrize("below", ["", "made/by/it"])
def test_a_file_in_place_of_the_folder_is_refused_before_any_measurement(capsys, monkeypatch, tmp_path, command, below):
    for measures in ("simulate", "work_precision", "stability_map", "Stepper"):
        monkeypatch.delattr(cs, measures)
    file = tmp_path / "file"
    file.write_text("kept")
    code, out, err = run(capsys, *command, "--out", file / below)
    assert (code, out) == (2, "")
    assert "out must be a folder" in err and str(file) in err and err.count("\n") == 1
    assert file.read_text() == "kept"


def test_unstable_run_is_code_1_and_one_line(capsys):
    code, out, err = run(capsys, "run", "paper_swing", "--dt", "0.01", "--duration", "3")
    assert (code, out) == (1, "")
    warning, error = err.splitlines()
    assert warning.startswith("clothsim run: warning: dt = 0.01 s is above 0.00116 s")
    assert error.startswith("clothsim run: error: unstable at step") and "stability limit" in error


def test_missing_extra_is_code_1_and_names_the_remedy(capsys, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    code, out, err = run(capsys, "reproduce", "--quick", "--out", tmp_path / "new")
    assert (code, out) == (1, "") and not (tmp_path / "new").exists()
    assert "pip install 'clothsim[plot]'" in err and err.count("\n") == 1


def test_interrupt_is_code_130(capsys, monkeypatch):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt("3 of 9 members are in a.zarr")

    monkeypatch.setattr(cs, "sweep", interrupted)
    code, _, err = run(capsys, "sweep", "paper_swing")
    assert code == 130 and err == "clothsim sweep: error: interrupted; 3 of 9 members are in a.zarr\n"


@pytest.mark.parametrize("as_json", [pytest.param(False, marks=pytest.mark.slow), True])
def test_reproduce_prints_table_and_folder(capsys, monkeypatch, tmp_path, as_json):
    pytest.importorskip("matplotlib")
    import clothsim.paper as module

    small = module.Settings(runs=2, speedup_steps=5, timing_dt=2e-4, gpu_sizes=(16,), gpu_batches=(), gpu_seconds=0.01)
    monkeypatch.setattr(module, "QUICK", small)
    options = ["--json"] if as_json else []
    code, out, _ = run(capsys, "reproduce", "--quick", "--experiment", 4, "--threads", 1, "--out", tmp_path, *options)
    assert code == 0
    if as_json:
        report = json.loads(out)
        assert report["folder"] == str(tmp_path)
        assert list(report["experiments"]) == ["4"]
    else:
        assert (tmp_path / "report.txt").read_text() in out
        assert out.splitlines()[-1].startswith(f"Report folder: {tmp_path}")
    assert (tmp_path / "index.html").exists()


def test_module_is_the_command():
    done = subprocess.run([sys.executable, "-m", "clothsim", "info", "--json"], capture_output=True, check=True)
    assert json.loads(done.stdout)["version"] == cs.__version__


def test_reader_that_leaves_early_is_no_error():
    process = subprocess.Popen([sys.executable, "-m", "clothsim", "info"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.close()
    assert process.stderr.read() == b""
    process.stderr.close()
    assert process.wait() == 0


def test_export_writes_the_files_and_names_them(capsys, tmp_path):
    saved = cs.simulate(cs.scenes.paper_swing(), 0.1, dt=1e-3, every=0.02).save(tmp_path / "swing")
    code, out, err = run(capsys, "export", saved, tmp_path / "a.ply", "--fps", "50", "--z-up")
    assert (code, err) == (0, "")
    assert out == f"Written: {tmp_path / 'a_0001.ply'} and 5 more beside it\n"
    code, out, err = run(capsys, "export", saved, tmp_path / "b.mdd", "--fps", "stored", "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["files"] == [str(tmp_path / "b.mdd"), str(tmp_path / "b.obj")]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("a.fbx",), "path must end in one of .usd, .usda"),
        (("a.obj", "--fps", "fast"), "argument --fps: must be a number or \"stored\", got 'fast'"),
        (("a.obj", "--fps", "-1"), "fps must be a finite number > 0"),
    ],
)
def test_export_refuses_wrong_input_in_one_line(capsys, tmp_path, arguments, message):
    saved = cs.simulate(cs.scenes.paper_swing(), 0.1, dt=1e-3, every=0.02).save(tmp_path / "swing")
    name, *others = arguments
    code, out, err = run(capsys, "export", saved, tmp_path / name, *others)
    assert (code, out) == (2, "") and message in err and err.count("\n") == 1
    assert [file.name for file in tmp_path.iterdir()] == ["swing.npz"]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (
            ("--dt", "5e-4", "--integrator", "velocity_verlet", "--kernel", "gather", "--strict"),
            {"integrator": "velocity_verlet", "kernel": "gather", "strict": True},
        ),
        (("--rtol", "1e-4", "--integrator", "dop853"), {"integrator": "dop853", "tolerance": {"asked": 1e-4}}),
        (("--rtol", "1e-4", "--atol", "1e-5"), {"tolerance": {"asked": 1.1e-4}}),
    ],
)
def test_run_hands_on_how_to_integrate(capsys, arguments, expected):
    code, out, err = run(capsys, "run", "paper_swing", "--duration", "0.01", *arguments, "--json")
    assert (code, err) == (0, "")
    report = json.loads(out)
    if "tolerance" in expected:
        asked = expected.pop("tolerance")["asked"]
        assert report["tolerance"]["asked"] == pytest.approx(asked, rel=1e-12)
    assert {name: report[name] for name in expected} == expected


def test_run_exports_a_film_without_a_choice_of_frames(capsys, tmp_path):
    arguments = ("run", "paper_static", "--duration", "0.1", "--dt", "1e-3", "--z-up")
    code, out, err = run(capsys, *arguments, "--export", tmp_path / "a.pc2")
    assert (code, err) == (0, "")
    assert out.endswith(f"Written: {tmp_path / 'a.pc2'} and 1 more beside it\n")
    times = [k / 60 for k in range(6)] + [0.1]
    expected = cs.simulate(cs.scenes.paper_static(), 0.1, dt=1e-3, every=1 / 60)
    assert expected.t.tolist() == pytest.approx(times)
    x = np.frombuffer((tmp_path / "a.pc2").read_bytes(), "<f4", offset=32).reshape(-1, 1024, 3)
    assert len(x) == 7  # 0.1 s is a whole number of frames
    np.testing.assert_allclose(x[:, :, 2], expected.x.reshape(7, 1024, 3)[:, :, 1], atol=1e-6)


def test_run_checks_the_export_before_it_simulates(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(cs, "simulate", lambda *_, **__: pytest.fail("simulated"))
    code, _, err = run(capsys, "run", "paper_swing", "--export", tmp_path / "a.fbx")
    assert code == 2 and "--export must end in one of .usd" in err and err.count("\n") == 1
    code, _, err = run(capsys, "run", "oscillator", "--export", tmp_path / "a.obj")
    assert code == 2 and "needs a surface" in err
    code, _, err = run(capsys, "run", "paper_swing", "--z-up")
    assert code == 2 and "--z-up needs --export" in err
    code, _, err = run(capsys, "run", "paper_swing", "--film", tmp_path / "a.avi")
    assert code == 2 and "--film must end in one of .gif, .webp, .mp4" in err
    code, _, err = run(capsys, "run", "paper_swing", "--html", tmp_path / "missing" / "a.html")
    assert code == 2 and "--html must be in an existing folder" in err
    monkeypatch.setattr("clothsim.viewing.animation.which", lambda name: None)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    code, _, err = run(capsys, "run", "paper_swing", "--gif", tmp_path / "a.mp4")
    assert code == 1 and "needs ffmpeg, which is neither on the PATH nor" in err


def test_run_writes_a_page_and_a_film(capsys, tmp_path):
    image = pytest.importorskip("PIL.Image")
    page, film = tmp_path / "a.html", tmp_path / "a.webp"
    arguments = ("run", "paper_static", "--duration", "0.1", "--dt", "1e-3", "--json")
    code, out, err = run(capsys, *arguments, "--html", page, "--gif", film)
    assert (code, err) == (0, "")
    assert json.loads(out)["files"] == [str(page), str(film)]
    saved = tmp_path / "b.npz"
    code, out, err = run(capsys, *arguments[:-1], "--html", page, "--out", saved)
    assert out.endswith(f"Written: {saved}\nWritten: {page}\n")
    assert page.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert image.open(film).n_frames == 4  # 0.1 s at 30 frames a second, both ends
