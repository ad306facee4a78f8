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
def test_every_command_has_help(capsys, command):
    code, out, err = run(capsys, *command, "--help")
    assert (code, err) == (0, "")
    assert out.startswith(" ".join(["usage: clothsim", *command]))
    if command:
        assert "--json" in out


def _strict(text):
    """Return `text` as JSON for any reader, which knows no NaN."""
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


@pytest.mark.parametrize(
    "command",
    [
        "run paper_static --duration 0.3 --dt 1e-3",
        "run oscillator --duration 0.1",
        "live paper_swing --out OUT/live.html",
        "info",
    ],
)
def test_every_command_prints_strict_json(capsys, tmp_path, command):
    code, out, _ = run(capsys, *command.replace("OUT", str(tmp_path)).split(), "--json")
    report = _strict(out)
    assert code == 0 and report
    if command.startswith("run paper_static"):
        assert (
            report["energy"]["gained"] is None
            and "a sphere responded" in report["energy"]["reason"]
        )


def test_a_scene_is_changed_and_saved_as_a_file_to_edit(capsys, tmp_path):
    path = tmp_path / "my.toml"
    changes = (
        "--set sphere_response=reflect --set gravity=(0,-1,0) --set stiffness_shear=2e4 "
        "--set shape=(16,16)"
    )
    command = f"run paper_static {changes} --dt 1e-3 --duration 0.005 --save-scene {path}"
    code, out, err = run(capsys, command)
    assert (code, err) == (0, "") and out.endswith(f"Written: {path}\n")
    scene = cs.load_scene(path)
    assert (scene.cloth.shape, scene.gravity, scene.spheres[0].response) == (
        (16, 16),
        (0, -1, 0),
        "reflect",
    )
    assert scene.cloth.family_stiffness == {"structural": 35_000.0, "shear": 2e4}
    saved = tmp_path / "run.npz"
    assert run(capsys, f"run {path} --dt 1e-3 --duration 0.005 --out {saved}")[0] == 0
    assert cs.load_run(saved).scene == scene
    assert (
        run(capsys, "run", "1e6 m away", "--dt", "1e-3", "--duration", "0.005", "--out", saved)[0]
        == 0
    )
    assert cs.load_run(saved).scene == cs.scenes.hard_cases()["1e6 m away"].scene


def test_a_missing_file_is_code_1(capsys):
    code, _, err = run(capsys, "run none.toml")
    assert (
        code == 1
        and err.startswith("clothsim run: error: ")
        and "none.toml" in err
        and err.count("\n") == 1
    )


def test_info(capsys):
    config = cs.build_config()
    code, out, _ = run(capsys, "info", "--json")
    assert code == 0
    facts = json.loads(out)
    assert facts.pop("graphics_adapters")
    assert facts == json.loads(json.dumps(config))
    code, out, _ = run(capsys, "info")
    assert code == 0
    for name in ("version", "compiler", "flags", "instruction_set", "eigen", "xsimd"):
        (line,) = (line for line in out.splitlines() if line.startswith(f"{name}:"))
        assert line.endswith(str(config[name]))


def test_run_saves_the_result_of_simulate(capsys, tmp_path):
    path = tmp_path / "swing.npz"
    options = (
        "--duration 0.01 --dt 5e-4 --every 4 --threads 1 --integrator velocity_verlet "
        "--kernel gather"
    )
    code, out, err = run(capsys, f"run paper_swing {options} --json --out", path)
    assert (code, err) == (0, "")
    report = json.loads(out)
    options = {"integrator": "velocity_verlet", "kernel": "gather", "threads": 1}
    assert {name: report[name] for name in options} == options and report["steps"] == 20
    expected = cs.simulate(cs.scenes.paper_swing(), 0.01, dt=5e-4, every=4, **options)
    saved = cs.load_run(path)
    assert np.array_equal(saved.t, expected.t) and len(saved.t) == 6
    assert np.array_equal(saved.x, expected.x) and np.array_equal(saved.v, expected.v)
    assert report["energy"]["end"] == expected.report["energy"]["end"]


def test_run_prints_the_run_as_text(capsys):
    code, out, _ = run(
        capsys, "run", "oscillator", "--duration", "0.1", "--precision", "single", "--dt", "1e-3"
    )
    assert code == 0
    expected = str(cs.simulate(cs.scenes.oscillator(), 0.1, dt=1e-3, precision="single"))
    printed_lines, expected = (
        re.sub(r"\d[\d.,e-]* (us|ms|s|steps/s)", "", text) for text in (out.rstrip(), expected)
    )
    assert printed_lines == expected and len(printed_lines.splitlines()) > 3


@pytest.mark.parametrize(
    "arguments, named",
    [
        (("run",), "SCENE"),
        (("run", "no_such_scene"), "no_such_scene"),
        (("run", "1e6 m awy"), "'1e6 m away'"),
        (("run", "paper_swing", "--set", "shape"), "--set must be NAME=VALUE"),
        (
            ("run", "paper_swing", "--set", "dt=1e-3"),
            "--set must name an argument of the scene, got 'dt'",
        ),
        (("run", "paper_swing", "--out", "no/such/folder/x.npz"), "--out"),
        (("run", "paper_swing", "--duration", "1e6", "--out", "a.h5"), "--out must end in .npz"),
        (("reproduce", "--experiment", "6"), "--experiment"),
    ],
)
def test_wrong_input_is_code_2_and_one_line(capsys, arguments, named):
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("clothsim") and ": error: " in err
    assert named in err and err.count("\n") == 1


def test_unstable_run_is_code_1_and_one_line(capsys):
    code, out, err = run(capsys, "run", "paper_swing", "--dt", "0.01", "--duration", "3")
    assert (code, out) == (1, "")
    warning, error = err.splitlines()
    assert warning.startswith("clothsim run: warning: dt = 0.01 s is above 0.00116 s")
    assert error.startswith("clothsim run: error: unstable at step") and "stability limit" in error


def test_missing_extra_is_code_1_and_names_the_remedy(capsys, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "PIL", None)
    code, out, err = run(
        capsys, "run", "oscillator", "--duration", "0.1", "--film", tmp_path / "a.gif"
    )
    assert (code, out) == (1, "") and not list(tmp_path.iterdir())
    assert "pip install 'clothsim[plot]'" in err and err.count("\n") == 1


def test_interrupt_is_code_130(capsys, monkeypatch):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt("at t = 0.1 s")

    monkeypatch.setattr(cs, "simulate", interrupted)
    code, _, err = run(capsys, "run", "paper_swing")
    assert code == 130 and err == "clothsim run: error: interrupted; at t = 0.1 s\n"


@pytest.mark.parametrize("as_json", [pytest.param(False, marks=pytest.mark.slow), True])
def test_reproduce_prints_table_and_folder(capsys, monkeypatch, tmp_path, as_json):
    pytest.importorskip("matplotlib")
    import clothsim.paper as module

    small = module.Settings(runs=2, speedup_steps=5, dt=(2e-4, 2e-4, 2e-4))
    monkeypatch.setattr(module, "QUICK", small)
    options = ["--json"] if as_json else []
    code, out, _ = run(
        capsys,
        "reproduce",
        "--quick",
        "--experiment",
        4,
        "--threads",
        1,
        "--out",
        tmp_path,
        *options,
    )
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
    process = subprocess.run(
        [sys.executable, "-m", "clothsim", "info", "--json"], capture_output=True, check=True
    )
    assert json.loads(process.stdout)["version"] == cs.__version__


def test_reader_that_leaves_early_is_no_error():
    process = subprocess.Popen(
        [sys.executable, "-m", "clothsim", "info"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    process.stdout.close()
    assert process.stderr.read() == b""
    process.stderr.close()
    assert process.wait() == 0


def test_run_exports_a_film_without_a_choice_of_frames(capsys, tmp_path):
    arguments = ("run", "paper_static", "--duration", "0.1", "--dt", "1e-3")
    code, out, err = run(capsys, *arguments, "--export", tmp_path / "a.pc2")
    assert (code, err) == (0, "")
    assert out.endswith(f"Written: {tmp_path / 'a.pc2'}\nWritten: {tmp_path / 'a.obj'}\n")
    x = np.frombuffer((tmp_path / "a.pc2").read_bytes(), "<f4", offset=32).reshape(-1, 1024, 3)
    assert len(x) == 7  # 60 frames a second


def test_run_checks_the_export_before_it_simulates(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(cs, "simulate", lambda *_, **__: pytest.fail("simulated"))
    code, _, err = run(capsys, "run", "paper_swing", "--export", tmp_path / "a.fbx")
    assert code == 2 and "--export must end in one of .usd" in err and err.count("\n") == 1
    code, _, err = run(capsys, "run", "oscillator", "--export", tmp_path / "a.obj")
    assert code == 2 and "needs a surface" in err
    code, _, err = run(capsys, "run", "paper_swing", "--film", tmp_path / "a.avi")
    assert code == 2 and "--film must end in one of .gif, .webp, .mp4" in err
    monkeypatch.setattr("clothsim.viewing.animation.which", lambda name: None)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    code, _, err = run(capsys, "run", "paper_swing", "--film", tmp_path / "a.mp4")
    assert code == 1 and "needs ffmpeg, which is neither on the PATH nor" in err


def test_run_writes_a_page_a_picture_and_a_film(capsys, tmp_path):
    image = pytest.importorskip("PIL.Image")
    page, film, picture = tmp_path / "a.html", tmp_path / "a.webp", tmp_path / "a.png"
    arguments = ("run", "paper_static", "--duration", "0.1", "--dt", "1e-3", "--json")
    code, out, err = run(capsys, *arguments, "--html", page, "--film", film, "--picture", picture)
    assert (code, err) == (0, "")
    assert json.loads(out)["files"] == [str(page), str(picture), str(film)]
    saved = tmp_path / "b.npz"
    code, out, err = run(capsys, *arguments[:-1], "--html", page, "--out", saved)
    assert out.endswith(f"Written: {saved}\nWritten: {page}\n") and picture.read_bytes().startswith(
        b"\x89PNG"
    )
    assert '"t":[0.0,0.0166666667,' in page.read_text(encoding="utf-8")  # 60 frames a second
    assert page.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert image.open(film).n_frames == 4  # 0.1 s at 30 frames a second, both ends
