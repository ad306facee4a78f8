"""Stepping a scene, arrays in and arrays out: `step`, `acceleration`, `reference_step`.

A scene keeps spare states for the next call. To compile a scene and to make a state of it costs ten
steps of a small cloth. A scene is immutable, so a state can be reused by later calls with equal
arithmetic and arrays of equal shape.
"""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _core
from ..base import check
from ..methods.integrators import check_integrator_name
from ..model.scene import Scene
from ..typing import Backend, Force, Integrator, Kernel, Precision
from .force import force_of_each_scene
from .options import Options, compile_plan, make_room_in_cache
from .state import (
    FloatArray,
    State,
    check_driven_pins,
    check_start_time,
    check_state_arrays,
    list_scenes,
)

# Steps of larger states take so long that a new state does not count, and spares would hold memory.
_MOST_BYTES = 1 << 22
_MOST_SPARES = 2  # spare states for one kind of call, so that each of two threads takes one
_MOST_KINDS = 8  # kinds of calls for which a scene has spare states

_THREADS = (int, type(None))
_DTYPES = (np.dtype(np.float64), np.dtype(np.float32))


def _take_or_make_state(
    scene: Any,
    x: Any,
    v: Any,
    integrator: Any,
    precision: Any,
    threads: Any,
    kernel: Any,
    backend: Any = "cpu",
    force: Any = None,
) -> tuple[State, list[State], FloatArray, FloatArray]:
    """Take a spare state for a call, or make one.

    No other call can have it meanwhile. The list of spares that it returns to comes with it, and
    the arrays for it. Arrays are checked here unless they are plain float arrays of a known shape.
    `State.step` finds numbers that are not finite.
    """
    if not (
        type(x) is type(v) is np.ndarray
        and x.dtype is v.dtype
        and x.dtype in _DTYPES
        and x.shape == v.shape
    ):
        x, v = check_state_arrays(x, v, list_scenes(scene), not isinstance(scene, Scene))
    spares: list[State] = []
    # No scene keeps a function.
    if (
        x.nbytes <= _MOST_BYTES
        and type(threads) in _THREADS
        and type(backend) is str
        and backend == "cpu"
        and force is None
    ):
        # A spare state does not keep its scene: the two would wait for the collector of cycles. A
        # state of a batch knows its scenes, as another may have the identity of one that died.
        batched = type(scene) in (list, tuple) and set(map(type, scene)) == {Scene}
        if batched or type(scene) is Scene:
            kinds = (scene[0] if batched else scene)._spare_states
            identities = tuple(map(id, scene)) if batched else None
            key = (x.shape, x.dtype, integrator, precision, threads, kernel, identities)
            try:
                if key not in kinds:
                    make_room_in_cache(kinds, _MOST_KINDS)
                    kinds[key] = []
                spares = kinds[key]
                while True:
                    state = spares.pop()
                    if not state.core.has_current_kernels:  # CLOTHSIM_ISA has changed.
                        continue
                    if not batched:
                        state.scenes.extend([scene] * (len(x) if x.ndim == 4 else 1))
                        return state, spares, x, v
                    if [reference() for reference in state.scene_references] == list(scene):
                        state.scenes.extend(scene)
                        return state, spares, x, v
            except (IndexError, KeyError, TypeError):
                # There is no spare. Another thread may have removed the kind, which is a KeyError,
                # and an option that is no name is a TypeError.
                pass
    options = Options(integrator, precision, threads, kernel, backend)
    check_integrator_name(options.integrator, fixed=True)
    scenes = list_scenes(scene)
    batched = not isinstance(scene, Scene)
    x, v = check_state_arrays(x, v, scenes, batched, precision)
    members = len(x) if x.ndim == 4 and not batched else 1
    scenes = scenes * members
    forces = force_of_each_scene(force, scenes, batched)
    state = State(scenes, x.ndim == 4, x.shape, x.dtype, 0.0, options, forces)
    if batched:
        state.scene_references = [weakref.ref(member) for member in scenes]
    if force is not None:
        spares = [state] * _MOST_SPARES  # This list is full, and no scene has it.
    return state, spares, x, v


@check.check_names
def step(
    scene: Scene | Sequence[Scene],
    x: npt.ArrayLike,
    v: npt.ArrayLike,
    dt: float,
    steps: int = 1,
    t: float | None = None,
    integrator: Integrator = "rk4",
    precision: Precision = "double",
    threads: int | None = None,
    out: tuple[FloatArray, FloatArray] | None = None,
    *,
    kernel: Kernel = "auto",
    backend: Backend = "cpu",
    force: Force | list[Force] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Advance positions and velocities by `steps` time steps of `dt`.

    The paper's responses follow each step of the integrator. Velocities given for pinned points are
    taken as 0.

    Parameters
    ----------
    scene : Scene or sequence of Scene
        A sequence of B scenes of one shape goes with a batch of B states.
    x, v : array_like
        Positions [m] and velocities [m/s], shape (rows, columns, 3) or (B, rows, columns, 3).
        C-contiguous arrays of float32 or float64 are not copied. Other real dtypes become float64.
        Never modified.
    dt : float
        Time step [s], > 0.
    steps : int, default 1
        Number of steps, >= 0.
    t : float, optional
        Time of the state given [s]. Required where a sphere moves, because its place depends on the
        time. Default: 0.
    integrator : str, default "rk4"
        A name of `integrators`. Adaptive methods also run at the fixed step `dt`.
    precision : {"double", "single"}, default "double"
        "single" computes in float32 with compensated sums of x and v, so that small increments are
        not lost.
    threads : int, optional
        Number of threads, 1 to 256. Default: one for a cloth of fewer than 16,384 mass points; else
        the processors that the process may use, at most `OMP_NUM_THREADS` and one for 1,024 mass
        points. A batch takes one a member. The bits are the same for any number. OpenMP's runtime
        ends a process to which the system refuses a thread: set 1 under such a limit.
    out : (numpy.ndarray, numpy.ndarray), optional
        Arrays of the result's shape and dtype to write to; may be `x` and `v` themselves.
    kernel : {"auto", "gather", "edge"}, default "auto"
        "edge", which "auto" stands for, computes each spring once and is the fastest. "gather"
        computes each mass point from its neighbours with the arithmetic of the compute shader:
        exact roots and divisions, and nothing fused. So every instruction set and the shader give
        the same bits, and a step takes three to four times as long.
    backend : {"cpu", "gpu"}, default "cpu"
        "gpu" steps on the graphics adapter (docs/gpu.md), in the kernel "gather". With "gpu",
        `threads` is refused.
    force : callable, optional
        A force of time and state, as for `simulate`. A call with a force makes a new state: a
        `Stepper` takes short calls faster.

    Returns
    -------
    x, v : numpy.ndarray
        The new state, of the shape and dtype of the input (float64 if either is). Arrays of float32
        drop the compensation of "single" at each call; a `Stepper` keeps it.

    Raises
    ------
    UnstableError, ContactError
        If the state stops being finite or runs away, or a mass point goes through a layer. After
        any error, and after Ctrl-C, which acts between two steps, nothing is written to `out`.

    Warns
    -----
    StabilityWarning
        If `dt` is above `max_stable_dt`, the step that is guaranteed to be stable.
    OrderWarning
        If the method loses its order with the damping of this scene.
    ContactWarning
        If a point or a pin is below the true surface of an obstacle.

    Examples
    --------
    One oscillation of a spring ends where it began:

    >>> import math
    >>> scene = cs.scenes.oscillator(stiffness=100.0, mass=1.0, amplitude=0.1)
    >>> period = 2 * math.pi / 10
    >>> x, v = scene.initial_position, scene.initial_velocity
    >>> x, v = cs.step(scene, x, v, period / 1000, 1000)
    >>> float(abs(x - scene.initial_position).max()) < 1e-10
    True
    """
    state, spares, x, v = _take_or_make_state(
        scene, x, v, integrator, precision, threads, kernel, backend, force
    )
    results = state.step(x, v, t, steps, dt, out)
    # After an error the state is not kept.
    if len(spares) < _MOST_SPARES:
        state.scenes.clear()
        spares.append(state)
    return results


@check.check_names
def acceleration(
    scene: Scene | Sequence[Scene],
    x: npt.ArrayLike,
    v: npt.ArrayLike,
    t: float = 0.0,
    precision: Precision = "double",
    out: npt.NDArray[np.float64] | None = None,
    *,
    threads: int | None = None,
    kernel: Kernel = "auto",
    force: Force | list[Force] | None = None,
) -> npt.NDArray[np.float64]:
    """Compute the acceleration of every mass point.

    Springs, damping, gravity, contact with response "penalty", wind and a function's force act.

    Parameters
    ----------
    scene, x, v, precision, threads, kernel, force
        As for `step`.
    t : float, default 0.0
        Time of the state [s]; a driven pin must be at its place.
    out : numpy.ndarray, optional
        float64 array of the shape of `x` to write to.

    Returns
    -------
    numpy.ndarray
        [m/s^2], float64, of the shape of `x`; 0 for pinned points.

    Examples
    --------
    >>> scene = cs.scenes.oscillator(stiffness=100.0, mass=2.0, amplitude=0.1)
    >>> a = cs.acceleration(scene, scene.initial_position, scene.initial_velocity)
    >>> round(float(a[0, 1, 0]), 12)
    -5.0
    """
    state, spares, x, v = _take_or_make_state(
        scene, x, v, "rk4", precision, threads, kernel, force=force
    )
    result = state.compute_acceleration(x, v, t, out)
    if len(spares) < _MOST_SPARES:
        state.scenes.clear()
        spares.append(state)
    return result


@check.check_names
def reference_step(
    scene: Scene,
    x: npt.ArrayLike,
    v: npt.ArrayLike,
    dt: float,
    steps: int = 1,
    t: float | None = None,
    *,
    as_printed: bool = False,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Step by the scalar reference: spring by spring, in double, not optimised.

    The code (cpp/reference) follows the paper's equations and shares none with the kernels.

    Parameters
    ----------
    scene : Scene
        One scene.
    x, v : array_like
        Positions [m] and velocities [m/s], shape (rows, columns, 3).
    dt, steps, t
        As for `step`.
    as_printed : bool, default False
        True: eq 2-6 of Kim et al. as printed, with the time step in the slopes and in the sum.
        That form is not consistent: its error does not go to 0 with the time step.

    Returns
    -------
    x, v : numpy.ndarray
        The new state, float64. May be non-finite: nothing is checked here.

    Examples
    --------
    >>> scene = cs.scenes.paper_static()
    >>> state = scene.initial_position, scene.initial_velocity
    >>> x, v = cs.step(scene, *state, 1e-4, steps=10)
    >>> reference = cs.reference_step(scene, *state, 1e-4, steps=10)
    >>> float(abs(x - reference[0]).max()) < 1e-14
    True
    """
    check.instance("scene", scene, Scene)
    t = check_start_time(t, [scene])
    x, v = check_state_arrays(x, v, [scene], False)
    if x.ndim != 3:
        raise ValueError(f"x must be one state of shape {(*scene.cloth.shape, 3)}, got {x.shape}")
    as_printed = check.boolean("as_printed", as_printed)
    if as_printed and scene.cloth.driven:
        raise ValueError(
            "as_printed must be False where a pin is driven, which the paper does not have, "
            "got True"
        )
    check_driven_pins([scene], x, t)
    return _core.reference_step(
        compile_plan(scene, Options()),
        x.astype(np.float64),
        v.astype(np.float64),
        check.number("dt", dt, minimum=0, exclusive=True),
        check.integer("steps", steps, minimum=0),
        t,
        as_printed,
    )
