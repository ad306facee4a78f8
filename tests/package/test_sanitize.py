"""The quick form of `make sanitize`: planted faults are seen, and a sound loop of OpenMP is not reported."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("kind", "compiler", "faults"), [("address", "g++", ["heap_overflow", "float_cast"]), ("thread", "clang++", ["race"])]
)
def test_planted_faults_are_seen(kind, compiler, faults):
    if not shutil.which(compiler):
        pytest.skip(f"no {compiler} here")
    if kind == "thread" and not (Path(shutil.which(compiler)).resolve().parents[1] / "lib" / "libarcher.so").exists():
        pytest.skip("no archer here")
    command = [ROOT / "tools" / "sanitize.sh", kind, "planted"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=120, env={**os.environ, "PYTHON": sys.executable})
    assert run.returncode == 0, run.stdout + run.stderr
    assert [line.split()[1] for line in run.stdout.splitlines()] == faults
