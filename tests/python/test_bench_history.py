"""Runs that pytest-benchmark saves may be committed."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.peers
def test_a_saved_run_names_neither_host_nor_branch(tmp_path):
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            "benchmarks",
            "-k",
            "scalar_reference",
            "--benchmark-autosave",
            f"--benchmark-storage={tmp_path}",
            "-p",
            "no:cacheprovider",
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout
    (path,) = tmp_path.rglob("*.json")
    saved = json.loads(path.read_text())
    assert [one["name"] for one in saved["benchmarks"]] == ["test_scalar_reference"]
    assert saved["machine_info"]["cpu"]
    assert not {"node", "release"} & set(saved["machine_info"])
    assert set(saved["commit_info"]) == {"id", "time", "dirty"}
