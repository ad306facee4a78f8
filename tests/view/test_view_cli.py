"""Commands that draw and play a run."""

import json

import clothsim as cs
import pytest
from clothsim.cli import main

pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    run = cs.simulate(cs.scenes.paper_static(), 0.2, dt=1e-3, every=20)
    return str(run.save(tmp_path_factory.mktemp("run") / "run.npz"))


@pytest.mark.parametrize(
    ("options", "name", "begin"),
    [
        ([], "run.png", b"\x89PNG"),
        (["--kind", "picture"], "run.png", b"\x89PNG"),
        (["--out", "run.svg"], "run.svg", b"<?xml"),
        (["--out", "run.html"], "run.html", b"<!DOCTYPE html>"),
        (["--out", "run.webp"], "run.webp", b"RIFF"),
    ],
)
def test_plot_draws_a_run_by_the_suffix(saved, tmp_path, capsys, options, name, begin):
    pytest.importorskip("PIL")
    options = [str(tmp_path / o) if o.startswith("run.") else o for o in options]
    if "--out" not in options:
        options += ["--out", str(tmp_path / name)]
    assert main(["plot", saved, *options, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"picture": str(tmp_path / name)}
    assert (tmp_path / name).read_bytes().startswith(begin)


def test_pictures_and_curves_differ(saved, tmp_path):
    for kind in ("curves", "picture"):
        assert main(["plot", saved, "--kind", kind, "--out", str(tmp_path / f"{kind}.png")]) == 0
    assert (tmp_path / "curves.png").read_bytes() != (tmp_path / "picture.png").read_bytes()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--kind", "heatmap"], "must be curves or picture for a run"),
        (["--metric", "error"], "--metric is for a sweep"),
        (["--out", "nowhere/a.png"], "existing folder"),
        (["--kind", "curves", "--out", "a.html"], "does not go with .html"),
    ],
)
def test_options_that_do_not_fit_a_run_are_refused(saved, capsys, monkeypatch, tmp_path, options, words):
    monkeypatch.chdir(tmp_path)
    assert main(["plot", saved, *options]) == 2
    assert words in capsys.readouterr().err


def test_kinds_of_a_run_are_refused_for_a_sweep(tmp_path, capsys):
    assert main(["plot", str(tmp_path / "a.zarr"), "--kind", "curves"]) == 2
    assert "is for a run" in capsys.readouterr().err


def test_an_argument_that_is_no_run_is_named(tmp_path, capsys):
    assert main(["plot", str(tmp_path / "none.npz")]) == 1
    assert "none.npz" in capsys.readouterr().err


def test_run_opens_the_page_that_it_writes(tmp_path, capsys, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda url: opened.append(url) or True)
    page = tmp_path / "run.html"
    options = ["--duration", "0.1", "--dt", "1e-3", "--view"]
    assert main(["run", "paper_static", *options, "--html", str(page), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["files"] == [str(page)]
    assert '"t":[0.0,0.0166666667,' in page.read_text()  # 60 frames a second
    assert opened == [page.as_uri()]
    assert main(["run", "oscillator", *options]) == 0 and len(opened) == 2


def test_no_browser_is_said_with_the_page(capsys, monkeypatch):
    monkeypatch.setattr("webbrowser.open", lambda url: False)
    assert main(["run", "oscillator", "--duration", "0.1", "--dt", "1e-3", "--view"]) == 1
    assert "no web browser was found: open /" in capsys.readouterr().err
