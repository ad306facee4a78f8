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
from .errors import StabilityWarning, UnstableError
from .grid import thread_grid, triangles
from .measures import energy, largest_stretch, max_stable_dt, penetration
from .integration import integrators
from .measures import energy, max_stable_dt, penetration
from .motion import Keyframes, Linear, Reciprocate
from .scene import Scene
from .scene_files import load_scene, save_scene
from .simulation import Run, load_run, simulate
from .sphere import Sphere
from .stability.map import stability_map
from .stepping import Snapshot, Stepper, acceleration, reference_step, step
from .sweep import open_sweep, sweep

__version__ = build_config()["version"]

__all__ = [
    "Cloth", "Keyframes", "Linear", "Reciprocate", "Run", "Scene", "Snapshot", "Sphere", "Stepper",
    "UnstableError", "acceleration", "build_config", "energy", "largest_stretch", "load_run",
    "load_scene", "max_stable_dt", "open_sweep", "penetration", "reference_step", "save_scene",
    "scenes", "simulate", "step", "sweep", "thread_grid", "triangles",
    "UnstableError", "acceleration", "build_config", "energy", "integrators", "load_run",
    "max_stable_dt", "penetration", "reference_step", "scenes", "simulate", "step", "thread_grid",
    "triangles",
    "Cloth", "Keyframes", "Linear", "Reciprocate", "Run", "Scene", "Snapshot", "Sphere",
    "StabilityWarning", "Stepper", "UnstableError", "acceleration", "build_config", "energy",
    "integrators", "load_run", "max_stable_dt", "penetration", "reference_step", "scenes",
    "simulate", "stability_map", "step", "thread_grid", "triangles",
]  # fmt: skip
