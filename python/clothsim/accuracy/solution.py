"""The trusted solution: two independent computations, and their difference as its error bound.

The second one, steps of dop853 in double, also measures sweeps and derivatives.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .. import _core
from ..base import Floats, check, make_read_only
from ..base.build import available_thread_count
from ..base.services import find_service
from ..engine.force import check_force, needs_python, plan_with_force
from ..engine.options import Options, compile_plan
from ..engine.state import State
from ..errors import ContactError, UnstableError
from ..methods.bound import stable_dt
from ..model.obstacle import name_of_kind
from ..model.scene import Scene, turning_times
from ..run.frames import Frames
from ..run.reasons import Reason
from ..run.recording import PAUSE, equal_steps
from ..typing import Force

METHOD = "dop853"
ORDER = 8
_COARSEST = 0.5  # coarsest step over RK4's stable step, well below the stable step of dop853
_FEWEST_STEPS = 8  # least number of steps of the coarsest run
_MOST_HALVINGS = 8  # largest number of halvings of its steps
_STEPS_BETWEEN_PAUSES = 512

# The extrapolation that is returned, and the one that it is compared with; tolerances are per step
# over the cloth's extent.
_TRUSTED: dict[str, Any] = {"columns": 8, "tolerance": 1e-15}
_CONTROL: dict[str, Any] = {"columns": 7, "tolerance": 1e-14}


@dataclass(frozen=True, eq=False, repr=False)
class Reference:
    """A trusted solution, the result of `reference`.

    Attributes
    ----------
    scene : Scene
    t : numpy.ndarray
        Times of the frames [s], shape (frames,); the first is 0, the last the duration.
    x, v : numpy.ndarray
        Positions [m] and velocities [m/s] of the extrapolation in double-double, rounded to
        float64, shape (frames, rows, columns, 3), read-only.
    error_bound : dict
        "max" and "rms" [m], each of shape (frames,): distance of the mass points from the second
        method, plus half a unit in the last place.
    error_estimate : dict
        The likely error of `x`, with the same keys: the distance to a looser extrapolation of
        another order.
    force : callable or None
        As given to `reference`.
    """

    scene: Scene
    t: Floats
    x: Floats
    v: Floats
    error_bound: dict[str, Floats]
    error_estimate: dict[str, Floats]
    force: Force | None = None

    def __repr__(self) -> str:
        bound = float(np.max(self.error_bound["max"]))
        return f"<Reference of {len(self.t)} frames to {self.t[-1]:g} s, error bound {bound:.1e} m>"

    def error_of(self, x: npt.ArrayLike, frame: int = -1) -> dict[str, float]:
        """Return the distance of positions from this solution.

        Parameters
        ----------
        x : array_like
            Positions [m], shape (rows, columns, 3).
        frame : int, default -1
            Index of the frame to compare with.

        Returns
        -------
        dict
            "max" and "rms" [m] over the mass points of the distance to the reference; NaN if `x` is
            not finite.

        Examples
        --------
        >>> solution = cs.reference(cs.scenes.oscillator(), 0.1)
        >>> solution.error_of(solution.x[-1])
        {'max': 0.0, 'rms': 0.0}
        """
        accepted = f"an array of shape {self.x.shape[1:]}"
        x = check.as_array("x", x, accepted)
        if x.shape != self.x.shape[1:]:
            raise ValueError(f"x must be {accepted}, got {x.shape}")
        frame = check.integer("frame", frame, minimum=-len(self.t), maximum=len(self.t) - 1)
        return {
            name: float(value)
            for name, value in largest_and_rms_distances(
                x.astype(np.float64), self.x[frame]
            ).items()
        }

    def plot(self, ax: Any = None) -> Any:
        """Draw the motion of some points and the errors over time; the two axes come back.

        Parameters
        ----------
        ax : sequence of 2 matplotlib.axes.Axes, optional
            Default: those of a new figure.

        Examples
        --------
        >>> solution = cs.reference(cs.scenes.oscillator(), 0.1, every=0.01)
        >>> [axes.get_ylabel() for axes in solution.plot()]
        ['way from the start [m]', 'error [m]']
        """
        return find_service("draw_reference")(self, ax)


@check.check_names
def reference(
    scene: Scene, duration: float, every: float | None = None, *, force: Force | None = None
) -> Reference:
    """Compute a trusted solution of a scene, with its own error bound.

    Two methods compute it, and their difference is the error bound. Gragg-Bulirsch-Stoer
    extrapolation of order 16 is returned, in double-double (Hairer, Norsett, Wanner, Solving
    Ordinary Differential Equations I, section II.9). It takes the rows of `Cloth.spring_table` and
    shares no code with the kernels. The Dormand-Prince method of order 8 in double uses the
    kernels. Its steps are halved until only rounding changes the result. The last 32 solutions are
    kept in memory.

    Parameters
    ----------
    scene : Scene
        Obstacles of another response than "penalty" must stay out of the cloth's reach.
    duration : float
        Simulated time [s], > 0.
    every : float, optional
        Seconds between frames. Default: only the first and the last state.
    force : callable, optional
        As for `simulate`. It is called in float64 by both methods, and such a solution is not kept.

    Returns
    -------
    Reference
        Its method `plot` draws the motion and its error.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above, or if an obstacle of another response than "penalty"
        responds before `duration`: responses after a step are no part of the equation.
    ArithmeticError
        If the extrapolation cannot continue, because points coincide or the state grows beyond
        bounds.
    KeyboardInterrupt
        On Ctrl-C.

    Examples
    --------
    >>> import math
    >>> scene = cs.scenes.oscillator(stiffness=100.0, mass=1.0, amplitude=0.1)
    >>> solution = cs.reference(scene, 2.0)
    >>> abs(float(solution.x[-1, 0, 1, 0]) - (1.0 + 0.1 * math.cos(10.0 * 2.0))) < 3e-16
    True
    """
    check.instance("scene", scene, Scene)
    duration = check.number("duration", duration, minimum=0, exclusive=True)
    frames = Frames(
        None if every is None else check.number("every", every, minimum=0, exclusive=True)
    )
    moments = frames.moments_between(0.0, 0.0, duration, None)
    times = tuple(moment.time for moment in moments[1:])
    force = check_force(force)
    return (
        _cached_reference(scene, times) if force is None else _make_reference(scene, times, force)
    )


def checked_or_new_reference(
    scene: Scene, duration: float, solution: Reference | None, force: Force | None
) -> Reference:
    """Return the solution, checked to fit scene, duration and force; a new one where it is None."""
    if solution is None:
        return reference(scene, duration, force=force)
    check.instance("reference", solution, Reference)
    fits = solution.scene == scene and solution.t[-1] == duration and solution.force is force
    if not fits:
        raise ValueError(
            f"reference must be one of this scene and force over {duration:g} s, got {solution!r} "
            "of its scene and force"
        )
    return solution


@lru_cache(maxsize=32)
def _cached_reference(scene: Scene, times: tuple[float, ...]) -> Reference:
    """Return the reference with frames at 0 and at `times`, without a function's force."""
    return _make_reference(scene, times, None)


def _make_reference(scene: Scene, times: tuple[float, ...], force: Force | None) -> Reference:
    """Return the reference with frames at 0 and at `times`."""
    layers = [obstacle for obstacle in scene.spheres if obstacle.response == "penalty"]
    free = scene.replace(spheres=layers)
    threads = available_thread_count()
    # Steps end where pieces of the pins' motions end, so that both methods keep their orders.
    stops = sorted({*times, *turning_times(free, 0.0, times[-1])})
    frames = np.searchsorted(stops, times)
    # Where spheres respond after a step, the method of the kernels tells whether they do. Without
    # such spheres the extrapolation comes first: it finds out whether forces are smooth.
    double = None
    if len(layers) < len(scene.spheres):
        double = solve_in_double(scene, stops, threads, force)
    if double and double.finest.contact:
        raise ValueError(
            f"duration must end before a {name_of_kind(scene.spheres)} responds after a step, at "
            f"about {double.finest.end:.4g} s, got {times[-1]:g} s: such responses are no part of "
            "the equation and have no reference; take response 'penalty', or compare outcomes "
            "(penetration, energy)"
        )
    options: dict[str, Any] = {"threads": threads, "force": force}
    x, v = extrapolate_motion(free, stops, **_TRUSTED, **options)
    control, _ = extrapolate_motion(free, stops, **_CONTROL, **options)
    double = double or solve_in_double(free, stops, threads, force)
    if double.finest.reason:
        raise ArithmeticError(f"no reference: {double.finest.reason}")
    # The solution is rounded to float64: half a unit in the last place, but for the initial state.
    rounding = np.spacing(np.abs(x[frames]).max()) / 2 * (np.arange(len(times) + 1) > 0)
    start = scene.initial_position[None]
    x = np.concatenate([start, x[frames]])
    v = np.concatenate([scene.initial_velocity[None], v[frames]])
    second = np.concatenate([start, double.x[frames]])
    control = np.concatenate([start, control[frames]])
    bound = {
        name: make_read_only(value + rounding)
        for name, value in largest_and_rms_distances(x, second).items()
    }
    estimate = {
        name: make_read_only(value) for name, value in largest_and_rms_distances(x, control).items()
    }
    return Reference(
        scene=scene,
        t=make_read_only(np.array([0.0, *times])),
        x=make_read_only(x),
        v=make_read_only(v),
        error_bound=bound,
        error_estimate=estimate,
        force=force,
    )


class Positions(NamedTuple):
    """Positions of scenes at some times, and until when they have a meaning."""

    x: Floats  # [m], shape (scenes, times, rows, columns, 3); NaN after a failure
    # Time before the first response of a sphere or failure in any of the scenes [s]; infinite
    # without.
    end: float
    reason: str = ""  # what ended it
    contact: bool = False  # whether that was a response


def positions_at(
    scenes: Sequence[Scene],
    times: Sequence[float],
    counts: Sequence[int],
    threads: int | None = None,
    force: Force | None = None,
) -> Positions:
    """Return the scenes at `times` [s], increasing and > 0, by `counts` equal steps to each."""
    several = scenes if len(scenes) > 1 else scenes[0]
    state = State.from_arguments(several, None, None, None, Options(METHOD, threads=threads), force)
    state.warn_of_order()
    moments = [_core.Moment(t, t) for t in (0.0, *times)]
    segments = equal_steps(moments, counts)
    state.warn_of_time_step(max(segment.dt for segment in segments))
    run = _core.FixedRun(segments, moments)
    shape = (len(scenes), len(moments), *scenes[0].cloth.shape, 3)
    x = np.full(shape, np.nan)
    v = np.empty(shape)
    failure = ""
    end = math.inf
    pause = PAUSE.get()
    try:
        while not run.complete:
            if pause is not None:
                pause()
            state.record(run, [*x], [*v], _STEPS_BETWEEN_PAUSES, len(moments))
    except (UnstableError, ContactError) as error:
        end = run.frame(run.stored - 1).time
        failure = Reason.FAILED.format(time=end, error=error)
    x = x[:, 1:]
    watched = state.core.watched
    responses = [member["first_contact"] for member in watched if member["responded"]]
    if responses:
        # They fall at the end of a step, for whatever happened within it.
        contact = min(responses)
        k = min(int(np.searchsorted(times, contact)), len(times) - 1)
        begin = contact - (times[k] - (times[k - 1] if k else 0.0)) / counts[k]
        reason = Reason.PARTED.format(kind=name_of_kind(scenes[0].spheres), time=begin)
        return Positions(x, begin, reason, True)
    return Positions(x, end, failure)


class DoubleSolution(NamedTuple):
    """Positions of a scene at some times, and their error."""

    x: Floats  # [m], shape (times, rows, columns, 3); NaN after a failure
    # The largest distance of a mass point by the last halving [m], shape (times,). It is infinite
    # without a halving.
    change: Floats
    finest: Positions


def solve_in_double(
    scene: Scene, times: Sequence[float], threads: int | None = None, force: Force | None = None
) -> DoubleSolution:
    """Return positions at `times` [s], increasing and > 0, by the kernels.

    The step is halved until the change is no larger than rounding errors. No tolerance has to be
    chosen for a scene. After a response of a sphere or a failure nothing is halved.
    """
    largest = min(_COARSEST * stable_dt(scene), times[-1] / _FEWEST_STEPS)
    # Each way is halved, also the one step of a pulse that is shorter than a step: in it a pin may
    # go as far as anywhere else.
    coarsest = np.ceil(np.diff(times, prepend=0.0) / largest).astype(int)
    counts = coarsest * 2 ** np.arange(1 + _MOST_HALVINGS)[:, None]
    finest = positions_at([scene], times, counts[0].tolist(), threads, force)
    change = math.inf
    changes = np.full(len(times), np.inf)
    for halving in range(1, 1 + _MOST_HALVINGS):
        if finest.reason:
            break
        coarser = finest
        last_change = change
        finest = positions_at([scene], times, counts[halving].tolist(), threads, force)
        distance = finest.x[0] - coarser.x[0]
        change = float(abs(distance).max())
        changes = np.linalg.norm(distance, axis=-1).max(axis=(-2, -1))
        if change >= last_change / 2 ** (
            ORDER / 2
        ):  # truncation would have made it 256 times smaller
            break
    return DoubleSolution(finest.x[0], changes, finest)


def extrapolate_motion(
    scene: Scene,
    times: list[float],
    *,
    columns: int,
    tolerance: float,
    threads: int,
    force: Force | None = None,
) -> tuple[Floats, Floats]:
    """Return states at `times` by extrapolation in double-double."""
    x = np.ascontiguousarray(scene.initial_position)
    v = np.ascontiguousarray(scene.initial_velocity)
    plan = plan_with_force(compile_plan(scene, Options()), force, scene.cloth.shape)
    threads = 1 if needs_python(force) else threads
    time, xs, vs = _core.extrapolate(plan, x, v, times, columns, tolerance, threads)
    if xs is None or vs is None:
        raise ArithmeticError(
            f"no reference: the extrapolation came to t = {time:g} s, where its step fell below "
            "1e-9 of the duration; the forces are not smooth there (points that coincide?) or "
            "something grows beyond bounds"
        )
    return xs, vs


def largest_and_rms_distances(a: Floats, b: Floats) -> dict[str, Floats]:
    """Return the largest and the rms distance of the mass points, of a frame or of each."""
    distance = np.linalg.norm(a - b, axis=-1)
    return {"max": distance.max(axis=(-2, -1)), "rms": np.sqrt((distance**2).mean(axis=(-2, -1)))}
