"""clothsim: mass-spring cloth meeting spheres, after Kim et al.

A `Scene` of one `Cloth` and any number of `Sphere` goes in, arrays come out:

>>> import clothsim as cs
>>> scene = cs.scenes.paper_static()
>>> x, v = scene.initial_position, scene.initial_velocity
>>> x, v = cs.step(scene, x, v, dt=5e-6, steps=100)
>>> x.shape
(32, 32, 3)

``help(cs.NAME)`` tells more of each name. Its examples take ``import clothsim as cs`` as done.

Describe a scene
    Cloth               a sheet of mass points and springs, with its pins
    Sphere              an obstacle: place, response to contact, offset, restitution, friction
    Plane               an obstacle without curvature, such as a floor
    Wind                moving air that presses on the triangles
    Linear              motion of a sphere or a pin: constant velocity
    Reciprocate         motion: back and forth, slower at the turning points
    Sinusoid            motion: a sine
    Keyframes           motion: a table of times and places, joined by lines or a smooth curve
    Scene               a cloth, spheres, gravity, the initial state
    scenes              ready scenes: the paper's, `hanging`, `oscillator`, `hard_cases`
    load_scene          read a scene from a TOML file
    save_scene          write one

Simulate
    simulate            a whole run, with frames and a report, at a time step or to a tolerance
    settle              the rest state
    Run                 what they return: frames, report, pictures, exports
    RunInterrupted      Ctrl-C, with the run so far
    load_run            read a run that `Run.save` wrote
    difference          two runs, frame by frame
    integrators         the methods, with order, cost and stability
    max_stable_dt       the largest time step that is guaranteed to be stable

Step arrays
    step                positions and velocities after some steps
    acceleration        the right-hand side of the equations of motion
    Stepper             keeps the state in the core between calls
    Snapshot            the state of a stepper, to the bit
    reference_step      steps of the plain oracle that judges the kernels

Measure
    energy              kinetic, elastic, gravity, total [J]
    penetration         deepest point and triangle inside a sphere [m]
    largest_stretch     stretch of the most stretched spring

Know the error
    reference           a solution with a bound of its own error
    Reference           what `reference` returns
    convergence         errors over time steps, observed order
    Convergence         what `convergence` returns
    work_precision      error against wall time of several methods
    stability_map       stable and unstable over stiffness and time step

Vary and fit
    sweep               many runs over a grid of values, as an xarray Dataset
    sweepable           the names that can be varied
    open_sweep          a sweep from its store
    fit                 parameters of a scene from a measured motion
    Fit                 what `fit` returns
    sensitivity         derivatives of positions with respect to parameters

Look
    picture             a shaded picture of a state
    Picture             what it returns
    Camera              where a picture is seen from
    compare             several runs side by side
    view                the scene live in the browser, by WebGPU

Look up
    triangles           corners of the sheet's triangles
    thread_grid         thread of the compute shader for each mass point
    build_config        compiler, instruction sets, threads, versions

Errors and warnings
    UnstableError       the state is no longer finite, or grew beyond bounds
    ContactError        a mass point has gone through the layer of an obstacle
    StabilityWarning    the time step is above the guaranteed limit
    OrderWarning        the integrator does not keep its order for this scene
    ContactWarning      a point or a pin is below a surface, or starts deep in a layer
    ToleranceWarning    the error asked for was not reached, or is not known
"""

from typing import TYPE_CHECKING

from . import errors as errors
from . import scenes
from . import typing as typing
from .base import check as _check
from .base import extras as _extras
from .base import services as _services
from .base.build import build_config
from .model.cloth import Cloth
from .model.fields import sweepable
from .errors import (
    ContactError,
    ContactWarning,
    OrderWarning,
    RunInterrupted,
    StabilityWarning,
    ToleranceWarning,
    UnstableError,
)
from .model.mesh import thread_grid, triangles
from .methods.integrators import integrators
from .measure import energy, largest_stretch, penetration
from .stability.limit import max_stable_dt
from .model.motion import Keyframes, Linear, Reciprocate, Sinusoid
from .model.scene import Scene
from .model.scene_files import load_scene, save_scene
from .run.settle import settle
from .run.difference import difference
from .run.result import Run, load_run
from .run.simulate import simulate
from .model.obstacle import Plane, Sphere
from .model.wind import Wind
from .engine.snapshot import Snapshot
from .engine.stepper import Stepper
from .engine.stepping import acceleration, reference_step, step

if TYPE_CHECKING:
    from .accuracy import Convergence, Reference, convergence, reference, work_precision
    from .accuracy.fit import Fit, fit
    from .accuracy.sensitivity import sensitivity
    from .gpu.live_page import view
    from .stability.map import stability_map
    from .sweeps.sweep import sweep
    from .sweeps.store import open_sweep
    from .viewing.camera import Camera
    from .viewing.page import compare
    from .viewing.picture import Picture, picture

__version__ = build_config()["version"]

__all__ = ["Cloth", "Plane", "Scene", "Sphere", "Wind", "load_scene", "save_scene", "scenes"]
__all__ += ["Keyframes", "Linear", "Reciprocate", "Sinusoid"]
__all__ += [
    "Run",
    "RunInterrupted",
    "difference",
    "integrators",
    "load_run",
    "max_stable_dt",
    "settle",
    "simulate",
]
__all__ += ["Snapshot", "Stepper", "acceleration", "reference_step", "step"]
__all__ += ["energy", "largest_stretch", "penetration"]
__all__ += [
    "Convergence",
    "Reference",
    "convergence",
    "reference",
    "stability_map",
    "work_precision",
]
__all__ += ["Fit", "fit", "open_sweep", "sensitivity", "sweep", "sweepable"]
__all__ += ["Camera", "Picture", "compare", "picture", "view"]
__all__ += ["build_config", "thread_grid", "triangles"]
__all__ += ["ContactError", "ContactWarning", "OrderWarning", "StabilityWarning"]
__all__ += ["ToleranceWarning", "UnstableError"]

__getattr__, __dir__ = _extras.make_late_importers(
    globals(),
    {
        ".accuracy": ("Convergence", "Reference", "convergence", "reference", "work_precision"),
        ".accuracy.fit": ("Fit", "fit"),
        ".accuracy.sensitivity": ("sensitivity",),
        ".stability.map": ("stability_map",),
        ".sweeps.store": ("open_sweep",),
        ".sweeps.sweep": ("sweep",),
        ".viewing.camera": ("Camera",),
        ".viewing.picture": ("Picture", "picture"),
        ".viewing.page": ("compare",),
        ".gpu.live_page": ("view",),
    },
    also=("errors", "typing"),
)
_services.register_services(
    {
        "clothsim.engine.explain": ("explain",),
        "clothsim.gpu.live_page": ("write_live_page",),
        "clothsim.gpu.simulation": ("Simulation",),
        "clothsim.stability.limit": ("max_stable_dt",),
        "clothsim.viewing.animation": ("animate",),
        "clothsim.viewing.exports": ("export",),
        "clothsim.viewing.notebook": ("run_bundle", "scene_bundle"),
        "clothsim.viewing.page": ("comparison_of",),
        "clothsim.viewing.picture": ("picture_of_run",),
        "clothsim.viewing.plots": ("plot",),
        "clothsim.viewing.plots.convergence": ("draw_convergence",),
        "clothsim.viewing.plots.difference": ("draw_difference",),
        "clothsim.viewing.plots.fit": ("draw_fit",),
        "clothsim.viewing.plots.reference": ("draw_reference",),
        "clothsim.viewing.plots.run": ("draw_run",),
    }
)
_extras.EXTENSIONS["xarray"] = "clothsim.sweeps.accessor"  # registers `Dataset.clothsim`
_check.SUBSTITUTES.update(
    {
        "air": "Scene(wind=cs.Wind()) has air at rest, and Cloth(drag=...) slows points down",
        "floor": "a floor is a cs.Plane among the spheres",
        "push_out_speed": "response 'penalty' pushes out what starts inside, slowed by dissipation",
        "wind": "Scene(wind=cs.Wind(velocity)) has moving air",
    }
)
del TYPE_CHECKING
