"""Fit stiffness, damping and drag to markers on a cloth, with the error of each."""

import clothsim as cs
import matplotlib.pyplot as plt
import numpy as np

TIMES = np.linspace(0.04, 1.2, 30)  # frames of a camera
MARKERS = [(7, 7), (7, 3), (4, 4), (2, 6)]


def cloth(**parameters):
    """Return a sheet that swings down from two corners."""
    return cs.Scene(cs.Cloth((8, 8), mass=0.3, **parameters))


# In place of a camera: a motion that we know, with an error of 2 mm, and markers that were hidden
# for a while.
truth = cloth(stiffness={"structural": 60.0, "shear": 20.0, "bend": 4.0}, damping=0.02, drag=0.01)
rows, columns = np.transpose(MARKERS)
measured = cs.simulate(truth, TIMES[-1], rtol=1e-6, times=TIMES).x[1:, rows, columns]
measured += np.random.default_rng(0).normal(0, 0.002, measured.shape)
measured[10:15, 1] = np.nan

guess = cloth(
    stiffness={"structural": 200.0, "shear": 100.0, "bend": 10.0}, damping=0.02, drag=0.05
)
over = ["stiffness_structural", "stiffness_shear", "stiffness_bend", "damping", "drag"]
found = cs.fit(guess, TIMES, measured, over, points=MARKERS)
print(found)
print(
    f"noise {1000 * found.report['sigma']:.2f} mm, {found.report['evaluations']} runs, "
    f"reason: {found.report['reason']!r}"
)
found.plot()
plt.savefig("fit.png")
