"""Stop a run, save it, and go on later: the bits are those of the uninterrupted run."""

import tempfile
from pathlib import Path

import clothsim as cs

scene = cs.scenes.paper_static()
whole = cs.simulate(scene, 1.2, dt=1e-4)

first = cs.simulate(scene, 0.6, dt=1e-4)
with tempfile.TemporaryDirectory() as folder:
    path = first.save(Path(folder) / "first.npz")
    rest = cs.load_run(path).resume(0.6)
print("same bits:", bool((rest.x[-1] == whole.x[-1]).all()))
rest.picture(path="resume.png")
