"""Write a run as a USD file for Blender, with z up: File > Import > Universal Scene Description."""

import tempfile
from pathlib import Path

import clothsim as cs

run = cs.simulate(cs.scenes.paper_static(), 0.5, dt=2e-4, fps=30)
with tempfile.TemporaryDirectory() as folder:
    (path,) = run.export(Path(folder) / "cloth.usdc", fps=30, z_up=True)
    print(f"{path.name}: {path.stat().st_size / 1e6:.1f} MB")
run.picture(path="blender.png")  # the last frame of the file
