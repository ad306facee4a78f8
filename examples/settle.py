"""The rest state of a curtain of seven pins, without the motion to it."""

import clothsim as cs
import numpy as np

pins = [(int(row), 0) for row in np.linspace(0, 31, 7)]
scene = cs.Scene(cs.Cloth(shape=(32, 32), pins=pins))

run = cs.settle(scene)
print("largest unbalanced force over the weight of a mass point:", run.report["residual"])
print("force evaluations:", run.report["force_evaluations"])
print("sag below the pins [m]:", -run.x[-1, ..., 1].min())
run.picture(path="settle.png")
