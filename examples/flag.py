"""A flag in the wind: a force on each mass point, computed with NumPy once a frame."""

import clothsim as cs
import numpy as np


def wind(t, x, v):
    """Pressure rho (w . n)^2 / 2 by the wind w relative to each mass point, on the area at it along
    its normal n [N].
    """
    area = np.cross(np.gradient(x, axis=1), np.gradient(x, axis=0))
    flow = (((6.0, 0.0, 1.0) - v) * area).sum(axis=-1, keepdims=True)  # through the area [m^3/s]
    return 1.2 / 2 * np.abs(flow) * flow * area / (area**2).sum(axis=-1, keepdims=True)


cloth = cs.Cloth(
    (20, 30),
    (1.0, 1.5),
    mass=0.2,
    stiffness=60.0,
    damping=0.01,
    pins=[(row, 0) for row in range(20)],
)
upright = cs.Scene(cloth, position=cloth.rest_positions[..., [0, 2, 1]] * (1, -1, 1))
run = cs.simulate(upright, 1.0, dt=1 / 6000, fps=60, force=wind)
run.animate("flag.webp", fps=20, speed=0.5)
print(
    f"the lower corner ends at {run.x[-1, -1, -1].round(2)} m; work of the wind "
    f"{run.report['force_work']:.3f} J"
)
