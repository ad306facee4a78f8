"""clothsim: mass-spring cloth meeting spheres, after Kim et al.

A `Scene` of one `Cloth` and any number of `Sphere` goes in, arrays come out:

>>> import clothsim as cs
>>> scene = cs.scenes.paper_static()
>>> x, v = cs.step(scene, scene.initial_position, scene.initial_velocity, dt=5e-6, steps=100)
>>> x.shape
(32, 32, 3)
"""

from . import scenes
from .build import build_config
from .cloth import Cloth
from .errors import ContactError, ContactWarning, UnstableError
from .grid import thread_grid, triangles
from .measures import energy, max_stable_dt, penetration
from .motion import Keyframes, Linear, Reciprocate
from .scene import Scene
from .simulation import Run, load_run, simulate
from .sphere import Sphere
from .stepping import Snapshot, Stepper, acceleration, reference_step, step

__version__ = build_config()["version"]

__all__ = [
    "Cloth", "ContactError", "ContactWarning", "Keyframes", "Linear", "Reciprocate", "Run", "Scene",
    "Snapshot", "Sphere", "Stepper", "UnstableError", "acceleration", "build_config", "energy", "load_run", "max_stable_dt",
    "penetration", "reference_step", "scenes", "simulate", "step", "thread_grid", "triangles",
]  # fmt: skip
