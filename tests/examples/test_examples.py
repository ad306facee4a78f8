"""Every example runs to its end, is short, prints something, and writes a picture or film."""

import runpy
import sys
from pathlib import Path

import pytest

plt = pytest.importorskip("matplotlib.pyplot")

FOLDER = Path(__file__).parents[2] / "examples"
SCRIPTS = sorted(FOLDER.glob("*.py"))
NEEDS = {"blender": "pxr", "fit": "scipy"}


def test_there_are_sixteen():
    assert len(SCRIPTS) >= 16


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_example(path, tmp_path, monkeypatch, capsys):
    assert len(path.read_text(encoding="utf8").splitlines()) < 40
    if path.stem in NEEDS:
        pytest.importorskip(NEEDS[path.stem])
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(path)])
    runpy.run_path(str(path), run_name="__main__")
    plt.close("all")
    assert capsys.readouterr().out.strip()
    pictures = list(tmp_path.iterdir())
    assert pictures
    for picture in pictures:
        assert picture.name.startswith(path.stem) and picture.suffix in (".png", ".webp")


def test_the_example_of_orders_is_a_test_too():
    tests = [
        value
        for name, value in runpy.run_path(str(FOLDER / "order.py")).items()
        if name.startswith("test_")
    ]
    for test in tests:
        test()
    assert len(tests) == 2
