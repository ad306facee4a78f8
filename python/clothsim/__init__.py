"""clothsim: mass-spring cloth meeting spheres, after Kim et al.

A `Scene` of one `Cloth` and any number of `Sphere` goes in, arrays come out:

>>> import clothsim as cs
>>> scene = cs.scenes.paper_static()
>>> x, v = cs.step(scene, scene.initial_position, scene.initial_velocity, dt=5e-6, steps=100)
>>> x.shape
(32, 32, 3)
"""

from typing import TYPE_CHECKING

from . import _openmp  # noqa: F401  # before anything that loads the core
from . import _accessor, scenes
from ._on_demand import on_demand
from .build import build_config
from .cloth import Cloth
from .errors import (
    ContactError,
    ContactWarning,
    LongRunWarning,
    OrderWarning,
    RunInterrupted,
    StabilityWarning,
    UnstableError,
)
from .grid import thread_grid, triangles
from .integration import integrators
from .measures import energy, largest_stretch, max_stable_dt, penetration
from .motion import Keyframes, Linear, Reciprocate
from .scene import Scene
from .scene_files import load_scene, save_scene
from .run import Run, load_run
from .simulation import simulate
from .sphere import Sphere
from .snapshot import Snapshot
from .stepper import Stepper
from .stepping import acceleration, reference_step, step
from .sweep import sweep

if TYPE_CHECKING:
    from .accuracy import Convergence, Reference, convergence, reference, work_precision
    from .stability.map import stability_map
    from .sweep import open_sweep
    from .sweep.fields import sweepable
    from .view import view
    from .view.camera import Camera
    from .view.page import compare
    from .view.picture import Picture, picture

__version__ = build_config()["version"]

_accessor.register()

__all__ = [
    "Camera",
    "Cloth",
    "ContactError",
    "ContactWarning",
    "Convergence",
    "Keyframes",
    "Linear",
    "LongRunWarning",
    "OrderWarning",
    "Picture",
    "Reciprocate",
    "Reference",
    "Run",
    "RunInterrupted",
    "Scene",
    "Snapshot",
    "Sphere",
    "StabilityWarning",
    "Stepper",
    "UnstableError",
    "acceleration",
    "build_config",
    "compare",
    "convergence",
    "energy",
    "integrators",
    "largest_stretch",
    "load_run",
    "load_scene",
    "max_stable_dt",
    "open_sweep",
    "penetration",
    "picture",
    "reference",
    "reference_step",
    "save_scene",
    "scenes",
    "simulate",
    "stability_map",
    "step",
    "sweep",
    "sweepable",
    "thread_grid",
    "triangles",
    "view",
    "work_precision",
]

__getattr__, __dir__ = on_demand(
    globals(),
    {
        "Convergence": ".accuracy",
        "Reference": ".accuracy",
        "convergence": ".accuracy",
        "reference": ".accuracy",
        "work_precision": ".accuracy",
        "stability_map": ".stability.map",
        "open_sweep": ".sweep.dataset",
        "sweepable": ".sweep.fields",
        "Camera": ".view.camera",
        "Picture": ".view.picture",
        "picture": ".view.picture",
        "compare": ".view.page",
        "view": ".view",
    },
)
