"""Every example runs to its end, is short, prints something, and writes a picture or film."""

import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "examples"
SCRIPTS = sorted(FOLDER.glob("*.py"))
NEEDS = {"blender": "pxr", "fit": "scipy"}


def run(*command, cwd):
    return subprocess.run([sys.executable, *map(str, command)], capture_output=True, text=True, timeout=120, cwd=cwd)


def test_there_are_sixteen():
    assert len(SCRIPTS) >= 16


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_example(path, tmp_path):
    assert len(path.read_text(encoding="utf8").splitlines()) < 40
    if path.stem in NEEDS:
        pytest.importorskip(NEEDS[path.stem])
    done = run(path, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    pictures = list(tmp_path.iterdir())
    assert pictures
    for picture in pictures:
        assert picture.name.startswith(path.stem) and picture.suffix in (".png", ".webp")


def test_the_example_of_orders_is_a_test_too(tmp_path):
    done = run("-m", "pytest", "-q", "-p", "no:cacheprovider", FOLDER / "order.py", cwd=tmp_path)
    assert done.returncode == 0, done.stdout
    assert "2 passed" in done.stdout
