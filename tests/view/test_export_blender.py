"""Blender itself imports the exports, and each frame has the positions of the run.

CLOTHSIM_BLENDER names a Python that has Blender's module bpy: pip install bpy in an environment.
"""

import json
import os
import subprocess
from pathlib import Path

import clothsim as cs
import numpy as np
import pytest

PYTHON = os.environ.get("CLOTHSIM_BLENDER")


@pytest.mark.skipif(not PYTHON, reason="CLOTHSIM_BLENDER names no Python with bpy")
def test_blender_shows_the_positions_of_the_run(tmp_path):
    run = cs.simulate(cs.scenes.paper_moving(), 0.3, dt=1e-3, fps=60)
    run.export(tmp_path / "usd.usdc", z_up=True)
    run.export(tmp_path / "gltf.glb")
    for folder, suffix in (("pc2", ".pc2"), ("obj", ".obj"), ("ply", ".ply")):
        (tmp_path / folder).mkdir()
        run.export(tmp_path / folder / f"a{suffix}", z_up=True)
    folder = tmp_path / "all"
    folder.mkdir()
    kept = ("usd.usdc", "gltf.glb", "pc2/a.pc2", "obj/a_0008.obj", "ply/a_0008.ply")
    for name in kept:
        (tmp_path / name).rename(folder / Path(name).name)
    (tmp_path / "pc2" / "a.obj").rename(folder / "a.obj")

    script = Path(__file__).with_name("blender_reads.py")
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    result = subprocess.run(
        [PYTHON, script, folder, "0", "7", "18"], env=environment, capture_output=True, text=True, timeout=120
    )
    lines = [line for line in result.stdout.splitlines() if line.startswith("READ ")]
    assert lines, result.stdout + result.stderr
    read = json.loads(lines[0].removeprefix("READ "))
    assert read.pop("smooth")
    frames = {f"{s} {k}" for s in (".usdc", ".glb", ".pc2") for k in (0, 7, 18)}
    assert set(read) == frames | {".obj 7", ".ply 7"}
    for name, positions in read.items():
        x = run.x[int(name.split()[1])].reshape(-1, 3)
        expected = np.stack([x[:, 0], -x[:, 2], x[:, 1]], -1)
        np.testing.assert_allclose(positions, expected, rtol=0, atol=2e-7, err_msg=name)
