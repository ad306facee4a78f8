"""After a contact: bands of an ensemble whose starts differ by a nanometre."""

import clothsim as cs
import matplotlib.pyplot as plt
import numpy as np

cloth = cs.Cloth((16, 16), mass=128.0, stiffness=9_000.0, damping=25.0)
scene = cs.Scene(cloth, cs.Sphere((0.5, -0.5, 0.5), 0.25, dissipation=0.0))
noise = np.random.default_rng(0).normal(0, 1e-9, (16, 16, 16, 3)) * ~cloth.pinned[..., None]
runs = cs.simulate(
    [scene.replace(position=scene.initial_position + one) for one in noise], 3.0, dt=5e-4, fps=30
)

x = np.array([run.x for run in runs])  # (members, frames, rows, columns, 3)
spread = x.std(axis=0).max(axis=(1, 2, 3))
bands = {"height of the centre of mass [m]": x.mean(axis=(2, 3))[..., 1]}
bands["total energy [J]"] = np.array([run.energy()["total"] for run in runs])
depth = max(run.report["penetration"]["points"] for run in runs)
print(
    f"after {runs[0].t[-1]:g} s points differ by {spread[-1]:.1e} m; the deepest is "
    f"{depth:.1e} m in the sphere"
)

figure, (first, *others) = plt.subplots(1, 3, figsize=(11, 3.5), layout="constrained")
first.semilogy(runs[0].t, spread)
first.set(xlabel="time [s]", ylabel="largest spread of a point [m]")
for axes, (name, values) in zip(others, bands.items()):
    axes.fill_between(runs[0].t, values.min(axis=0), values.max(axis=0), lw=1, edgecolor="C0")
    axes.set(xlabel="time [s]", ylabel=name)
figure.savefig("ensemble.png")
