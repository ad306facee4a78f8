"""Points without springs around one sphere: a step moves each by v dt, then responds to contact."""

import clothsim as cs
import numpy as np

CENTER = np.array([0.2, -0.3, 0.1])
RADIUS = 0.5


def drifting(x, spheres, pins=(), gravity=(0, 0, 0)):
    """Return a scene without any force but gravity, for points of the shape of x."""
    cloth = cs.Cloth(x.shape[:2], stiffness=0.0, damping=0.0, pins=pins)
    return cs.Scene(cloth, spheres, gravity)


def one_point(position, velocity, sphere, dt=1e-9, **options):
    """Where a free point at `position` (from CENTER) is after a step, which by default is too short
    to move it.
    """
    x = np.full((2, 2, 3), 50.0)
    v = np.zeros((2, 2, 3))
    x[0, 0] = CENTER + position
    v[0, 0] = velocity
    xt, vt = cs.step(drifting(x, sphere), x, v, dt, t=0.0, **options)
    assert (xt[1] == 50.0).all() and (vt[1] == 0).all()
    return xt[0, 0] - CENTER, vt[0, 0]
