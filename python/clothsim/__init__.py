"""clothsim: mass-spring cloth meeting spheres, after Kim et al.

A `Scene` of one `Cloth` and any number of `Sphere` goes in, arrays come out:

>>> import clothsim as cs
>>> scene = cs.scenes.paper_static()
>>> x, v = cs.step(scene, scene.initial_position, scene.initial_velocity, dt=5e-6, steps=100)
>>> x.shape
(32, 32, 3)
"""

from typing import TYPE_CHECKING

from . import errors as errors
from . import scenes
from . import typing as typing
from .sweeps import register as _register_accessor
from .base.on_demand import on_demand as _on_demand
from .base.build import build_config
from .model.cloth import Cloth
from .errors import ContactError, ContactWarning, OrderWarning, RunInterrupted, StabilityWarning, UnstableError
from .model.mesh import thread_grid, triangles
from .methods.integration import integrators
from .measure.measures import energy, largest_stretch, penetration
from .stability.limit import max_stable_dt
from .model.motion import Keyframes, Linear, Reciprocate, Sinusoid
from .model.scene import Scene
from .model.scene_files import load_scene, save_scene
from .run.result import Run, load_run
from .run.settle import settle
from .run.difference import difference
from .run.simulate import simulate
from .model.sphere import Sphere
from .engine.snapshot import Snapshot
from .engine.stepper import Stepper
from .engine.stepping import acceleration, reference_step, step

if TYPE_CHECKING:
    from .accuracy import Convergence, Reference, convergence, reference, work_precision
    from .accuracy.fit import Fit, fit
    from .accuracy.sensitivity import sensitivity
    from .gpu.live_page import view
    from .stability.map import stability_map
    from .sweeps.api import sweep
    from .model.fields import sweepable
    from .sweeps.store import open_sweep
    from .viewing.camera import Camera
    from .viewing.page import compare
    from .viewing.picture import Picture, picture

__version__ = build_config()["version"]

_register_accessor()

__all__ = [
    "Camera",
    "Cloth",
    "ContactError",
    "ContactWarning",
    "Convergence",
    "Fit",
    "Keyframes",
    "Linear",
    "OrderWarning",
    "Picture",
    "Reciprocate",
    "Reference",
    "Run",
    "RunInterrupted",
    "Scene",
    "Sinusoid",
    "Snapshot",
    "Sphere",
    "StabilityWarning",
    "Stepper",
    "UnstableError",
    "acceleration",
    "build_config",
    "compare",
    "convergence",
    "difference",
    "energy",
    "fit",
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
    "sensitivity",
    "settle",
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

__getattr__, __dir__ = _on_demand(
    globals(),
    {
        "Convergence": ".accuracy",
        "Fit": ".accuracy.fit",
        "Reference": ".accuracy",
        "convergence": ".accuracy",
        "fit": ".accuracy.fit",
        "reference": ".accuracy",
        "sensitivity": ".accuracy.sensitivity",
        "work_precision": ".accuracy",
        "stability_map": ".stability.map",
        "open_sweep": ".sweeps.store",
        "sweep": ".sweeps.api",
        "sweepable": ".model.fields",
        "Camera": ".viewing.camera",
        "Picture": ".viewing.picture",
        "picture": ".viewing.picture",
        "compare": ".viewing.page",
        "view": ".gpu.live_page",
    },
    also=("errors", "typing"),
)
del TYPE_CHECKING
