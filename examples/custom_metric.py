"""Measure something of your own in a sweep: the largest speed at the end of a run."""

import clothsim as cs
import matplotlib.pyplot as plt
import numpy as np


def largest_speed(run: cs.Run) -> float:
    """Speed of the fastest mass point at the end of the run [m/s]."""
    return float(np.linalg.norm(run.v[-1], axis=-1).max())


scene = cs.scenes.hanging(shape=(12, 12))
table = cs.sweep(
    scene,
    over={"stiffness": [1e3, 1e4, 1e5]},
    duration=0.1,
    metrics={"largest_speed": largest_speed},
    progress=False,
)
print(table["largest_speed"].to_pandas())
table.clothsim.plot("heatmap", variable="largest_speed")
plt.savefig("custom_metric.png")
