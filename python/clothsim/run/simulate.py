"""A whole run, or the runs of a batch: `simulate`."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, NoReturn, TypeVar, cast, overload

import numpy as np
import numpy.typing as npt

from ..base import check
from ..engine.arrays import scenes_of
from ..engine.snapshot import take
from ..errors import ContactError, RunInterrupted, UnstableError
from ..methods.data import integrator_name
from ..methods.integration import warn_of_order
from ..model.scene import Scene
from ..typing import Backend, Every, Integrator, Kernel, Precision
from .account import Account, of_controlled, of_nothing, report
from .adaptive import estimate_of, solve
from .fixed_steps import Resumed, RunOptions, beginning, checked_tolerances, integrate, run_fixed, size_of
from .frames import schedule
from .recording import Recording, Solution, StopRun, Watch, interrupted, progress_bar
from .result import Run


@overload
def simulate(
    scene: Scene,
    duration: float,
    dt: float | None = None,
    integrator: Integrator | None = None,
    precision: Precision = "double",
    rtol: float | None = None,
    atol: float | None = None,
    every: Every | None = None,
    threads: int | None = None,
    progress: bool = False,
    *,
    t: float = 0.0,
    times: npt.ArrayLike | None = None,
    fps: float | None = None,
    callback: Callable[[float, Any, Any], Any] | None = None,
    kernel: Kernel = "auto",
    backend: Backend = "cpu",
    estimate_error: bool | None = None,
) -> Run: ...
@overload
def simulate(scene: Sequence[Scene], duration: float, *arguments: Any, **options: Any) -> list[Run]: ...
def simulate(
    scene: Scene | Sequence[Scene],
    duration: float,
    dt: float | None = None,
    integrator: Integrator | None = None,
    precision: Precision = "double",
    rtol: float | None = None,
    atol: float | None = None,
    every: Every | None = None,
    threads: int | None = None,
    progress: bool = False,
    *,
    t: float = 0.0,
    times: npt.ArrayLike | None = None,
    fps: float | None = None,
    callback: Callable[[float, Any, Any], Any] | None = None,
    kernel: Kernel = "auto",
    backend: Backend = "cpu",
    estimate_error: bool | None = None,
    **unknown: NoReturn,
) -> Run | list[Run]:
    """Run a scene from its initial state for `duration` and store frames.

    Parameters
    ----------
    scene : Scene or sequence of Scene
        Scenes of one shape give a list of runs, each with the bits of that run alone. With `dt` they are stepped together;
        with `callback`, `estimate_error`, error control or the backend "gpu", one after the other.
    duration : float
        Simulated time [s], > 0.
    dt : float, optional
        Time step [s]. Not together with `rtol` or `atol`.
    integrator : str, optional
        A name of `integrators`, or "auto": method, precision and step by the tolerance. Default:
        "rk4" with `dt` or the backend "gpu", else "auto". Without a tolerance too, "rk4" where its guaranteed stable step
        meets rtol 1e-3, else "auto".
    precision : {"double", "single"}, default "double"
        As for `step`. The integrator "auto" chooses the precision itself.
    rtol, atol : float, optional
        Error control: bounds of the error of the last positions. The rms over the mass points is to be at most
        ``atol + rtol * max(scene.cloth.size)`` [m]. A missing value counts as 0. Without `dt`, `rtol` and `atol`, rtol
        is 1e-3. Steps end where a piece of a motion ends. In reach of a sphere no step is longer than half of
        `max_stable_dt`, for this method and for rk4.
    every : int, float or "step", optional
        An int >= 2 stores a frame every so many steps, a float every so many seconds, and "step"
        at each step. At most one of `every`, `times` and `fps` is given; by default only the
        first and the last state are stored, which every run stores.
    threads, kernel, backend
        As for `step`. The backend "gpu" takes fixed steps of "rk4" only: no `rtol` and `atol`.
    progress : bool, default False
        True shows a progress bar of simulated seconds (tqdm, in the extra "demo") on a terminal
        and in a notebook; nothing in a pipe.
    t : float, default 0.0
        Time of the initial state [s]; moving spheres start from their places at that time.
    times : array_like, optional
        Times of the scene at which frames are stored [s], increasing, from `t` to
        ``t + duration``.
    fps : float, optional
        Frames per second, > 0.
    callback : callable, optional
        Called as ``callback(t, x, v)`` at each stored frame, with read-only arrays of shape
        (rows, columns, 3). It returns True to stop the run there, else False or None. Where error
        control repeats a run, the calls begin again at the start.
    estimate_error : bool, optional
        Whether a run with a given `dt` is compared with a better run. Default: no. Without `dt`
        the error is always estimated.

    Returns
    -------
    Run, or list of Run
        ``run.t[-1] == t + duration``; where dt does not divide the duration, the last step is
        shorter. Frames never change steps. A frame between two steps is interpolated (cubic Hermite polynomial of
        both states). Its free mass points go no deeper into a sphere than in these states; triangles may. With error
        control, dense output of the method gives the frames until a sphere responds. ``run.report`` counts "steps",
        "rejected_steps" and "force_evaluations"; the evaluations include the error estimate. "solution_evaluations",
        "wall_time" [s], "steps_per_second" and "dt" are for the run alone; "dt" is the mean step of an adaptive method.
        "integrator", "precision", "kernel", "threads", "backend", "instruction_set" and "version" say how
        the run was computed; "as_printed", whether a sphere responds as printed in the paper. With the backend "gpu",
        "instruction_set" is the adapter. "stopped" is "" for a whole run, else "callback", "interrupted", "unstable" or
        "contact".

        The report also has extremes over the states of the run. A state is the initial state, or the
        state at the end of a step, after the responses. Each is a mapping with a "reason": "", or why a
        number is NaN. With the backend "gpu" all are NaN.

        "penetration"
            "points" and "triangles" [m]: greatest depths over all spheres; see `penetration`. Mass points are measured
            at every state, triangles at stored frames and after every n-th step, n = min(128, steps // 32). A method with
            error control samples after every 16th step, and where 1/32 of the duration has passed since the last sample.
            The depth of triangles is at least the depth of mass points.
        "stretch"
            "largest", see `largest_stretch`; sampled.
        "first_contact"
            "time" [s]: end of the first step in which a response changed the cloth.
        "impulse", "impulse_reason"
            [N s], one (x, y, z) per sphere: minus the momentum that its responses gave to the cloth, summed over the steps.
            See `Stepper.impulses`. A resumed run counts its own.
        "energy"
            "start" and "end", see `energy`; "gained" [J]: the largest excess of the total energy over its start, or 0.
            It is measured at stored frames and at one state in 128; with error control, or above `max_stable_dt`, at
            one state in 16. Nothing but the method's error can add energy until a sphere responds. After a response it
            is NaN.

        About the error:

        "error_estimate"
            "max" and "rms" [m] of the last positions, over the mass points, and "reason". The
            estimate is the distance from a better run (docs/integrators.md). If it is unknown,
            both are NaN, and the reason is not empty. If it is larger than asked for, the reason says why error control
            could not reduce it. After a contact, trajectories of nearby states part, and no error is known.
        "estimate_evaluations", "estimate_wall_time"
            Force evaluations and seconds of all runs that are not returned: better runs, and runs that were too coarse.
        "tolerance"
            "asked" [m, rms], NaN without error control, and "reached", whether the estimate is
            at most that.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.
    UnstableError, ContactError
        If the state stops being finite or runs away (see `Stepper.advance`), or spheres trap a
        mass point. ``error.run`` is the run up to the state before that step. Of many scenes it is the error of the first
        that fails, raised when all others have ended: ``error.member`` is its index, and ``error.runs`` has all runs. An
        exception of the callback has the frames so far as ``error.run`` too.
    RunInterrupted
        On Ctrl-C, a KeyboardInterrupt whose ``run`` is the run up to the last whole step, at least its first frame; of many
        scenes, the list of those begun.
    ImportError, MemoryError, RuntimeError
        With the backend "gpu" only; see `step`.

    Warns
    -----
    StabilityWarning
        If `dt` is above `max_stable_dt`. Also if more than half of the kinetic and elastic energy
        came out of nothing before a sphere responded (docs/stability.md).
    ContactWarning, OrderWarning
        As `Stepper` and `Stepper.advance`.

    Notes
    -----
    With error control, as with a fixed step, one collision pass follows each step. For "continuous"
    spheres it tests the whole path of the step. A step is cut or redone if a mass point moves too
    far relative to a sphere. The limit is the gap, or a tenth of the contact radius if that is
    more.

    Examples
    --------
    >>> import clothsim as cs
    >>> run = cs.simulate(cs.scenes.paper_swing(), 0.01, dt=1e-4, every=25, estimate_error=True)
    >>> run.x.shape, float(run.t[-1]), run.report["steps"]
    ((5, 32, 32, 3), 0.01, 100)
    >>> run.report["error_estimate"]["max"] < 1e-9
    True

    Ask for an error of a millionth of the size:

    >>> run = cs.simulate(cs.scenes.oscillator(), 1.0, rtol=1e-6)
    >>> run.report["integrator"], run.report["error_estimate"]["rms"] < 1e-6
    ('dop853', True)
    """
    check.no_argument(unknown)
    if not isinstance(scene, Scene):
        scenes = scenes_of(scene)
        if dt is None or callback is not None or estimate_error or backend == "gpu":
            first = (duration, dt, integrator, precision, rtol, atol, every, threads, progress)
            more = {"t": t, "times": times, "fps": fps, "callback": callback, "estimate_error": estimate_error}
            return _one_by_one(scenes, *first, **more, kernel=kernel, backend=backend)
    else:
        scenes = [scene]
    duration = check.number("duration", duration, minimum=0, exclusive=True)
    t = check.number("t", t)
    _check_end(t, duration)
    asked = _asked_error(scenes[0], dt, rtol, atol)
    frames = schedule(every, times, fps, t, duration)
    plain = integrator is None and asked is None and dt is None and backend != "gpu"
    if integrator is None:
        integrator = "auto" if asked is not None or plain else "rk4"
    integrator = integrator_name(integrator, "auto")
    named = "rk4" if integrator == "auto" else integrator
    options = RunOptions(named, precision, threads, kernel, backend, t)
    if options.backend == "gpu" and (asked is not None or integrator == "auto"):
        raise ValueError(
            "rtol and atol must be None and integrator must be 'rk4' with backend 'gpu', which takes fixed steps: "
            "give dt, or leave it out for a step of half the guaranteed stable one"
        )
    any(warn_of_order(named, one) for one in scenes)
    if dt is not None:
        if integrator == "auto":
            raise ValueError("integrator must be a name with dt, got 'auto': it chooses the step")
        dt = check.number("dt", dt, minimum=0, exclusive=True)
        check.step_count(duration, dt)
    frames.check_memory(duration, dt, len(scenes) * scenes[0].initial_position.size // 3)
    if estimate_error is not None:
        check.boolean("estimate_error", estimate_error)
    _check_callback(callback)

    best = options.replace(integrator="dop853", precision="double") if integrator == "auto" else options

    def compute(watch: Watch) -> Run | list[Run]:
        if not isinstance(scene, Scene):
            runs, errors = run_batch(scenes, duration, dt, options, frames, watch)
            return _raise_first([errors[k] for k in sorted(errors)], runs)
        if dt is not None:
            solution, account = run_fixed(scene, duration, dt, options, frames, watch).solution(), of_nothing()
            if estimate_error:
                account = of_controlled(estimate_of(scene, duration, solution))
            return _run(scene, solution, account)
        error = _DEFAULT_RTOL * size_of(scene) if asked is None else asked
        found = solve(scene, duration, error, best, frames, watch, options if plain else None)
        return _run(scene, found.solution, of_controlled(found, error))

    with progress_bar(progress, duration) as bar:
        return _followed(compute, Watch(callback, bar.bar), lambda: beginning(scene, best, dt, frames))


Failure = UnstableError | ContactError
Runs = TypeVar("Runs", bound=Run | list[Run])


def run_batch(*arguments: Any, **options: Any) -> tuple[list[Run], dict[int, Failure]]:
    """Runs side by side, as `run_fixed` takes them; and by member, errors of those whose run ends early."""
    recording = run_fixed(*arguments, **options)
    return _runs(recording), {k: error for k, (error, _) in recording.failed.items()}


def _one_by_one(scenes: list[Scene], *arguments: Any, **options: Any) -> list[Run]:
    runs: list[Run] = []
    errors: list[Failure] = []
    for k, scene in enumerate(scenes):
        try:
            runs.append(simulate(scene, *arguments, **options))
        except (UnstableError, ContactError) as error:
            errors.append(dataclasses.replace(error, member=k))
            errors[-1].run = error.run
            runs.append(error.run)
        except RunInterrupted as interrupt:
            interrupt.run = [*runs, interrupt.run]
            raise
    return _raise_first(errors, runs)


def _raise_first(errors: list[Failure], runs: list[Run]) -> list[Run]:
    """Raise the first error, with the runs, or return the runs."""
    if not errors:
        return runs
    errors[0].runs = runs
    raise errors[0]


def _runs(recording: Recording, reason: str = "") -> list[Run]:
    """The runs so far, which ended early for the `reason`, or for that of a member's own error."""
    errors = {k: error for k, (error, _) in recording.failed.items()}
    runs = []
    for k, (scene, solution) in enumerate(zip(recording.state.scenes, recording.solutions(), strict=True)):
        stopped = _reason(errors[k]) if k in errors else reason
        runs.append(_run(scene, solution, of_nothing(stopped and f"the run ended early: {stopped}"), stopped))
    for k, error in errors.items():
        error.run = runs[k]
    return runs


def _reason(error: Failure) -> str:
    return "unstable" if isinstance(error, UnstableError) else "contact"


def _followed(compute: Callable[[Watch], Runs], watch: Watch, begin: Callable[[], Recording]) -> Runs:
    """What `compute` finds, or the part of the runs before an early end: after Ctrl-C at least their first frames."""

    def so_far(reason: str) -> Any:
        recording = watch.recording
        if recording is None and reason == "interrupted":
            with suppress(Exception):  # as where memory lacks
                recording = begin()
        if recording is None:
            return None
        if reason == "callback":
            recording.end_at_frame()
        else:
            recording.end_here()
        runs = _runs(recording, reason)
        return runs if recording.state.batched else runs[0]

    try:
        return compute(watch)
    except StopRun:
        return cast(Runs, so_far("callback"))  # the callback was called for a frame of it
    except (UnstableError, ContactError) as error:
        if error.run is None:
            error.run = so_far(_reason(error))
        raise
    except KeyboardInterrupt:
        interrupted(lambda: so_far("interrupted"))
    except BaseException as error:  # SystemExit too, as by a callback
        with suppress(Exception):  # as where memory lacks
            run = so_far("callback" if watch.failed else "error")
            if run is not None:
                error.run = run  # type: ignore[attr-defined]
        raise


def _run(scene: Scene, solution: Solution, account: Account, stopped: str = "") -> Run:
    state, saved = solution.state, solution.saved
    snapshot = None if saved is None and state.batched else take(state, scene, solution.options, saved)
    found = report(scene, solution, account, stopped)
    return Run(scene, np.array(solution.t), solution.x, solution.v, found, snapshot, solution.continuation)


def resume(run: Run, duration: float, every: Any, times: Any, fps: Any, callback: Any, progress: bool) -> Run:
    """`Run.resume`."""
    snapshot, before = run.snapshot, run.continuation
    if snapshot is None or before is None or (before.dt is None and before.control is None):
        raise ValueError("this run cannot be resumed, as its final state was not kept: runs of simulate and of load_run can")
    duration = check.number("duration", duration, minimum=0, exclusive=True)
    _check_end(before.start, before.seconds + duration)
    if before.dt is not None:
        check.step_count(duration, before.dt)
    frames = before.frames
    if not (every is None and times is None and fps is None):
        frames = schedule(every, times, fps, before.start + before.seconds, duration)
    frames.check_memory(duration, before.dt, run.scene.cloth.rows * run.scene.cloth.columns)
    _check_callback(callback)
    options = RunOptions(**vars(snapshot.options), start=before.start)
    resumed, scene = Resumed(snapshot, before), run.scene

    def compute(watch: Watch) -> Run:
        if before.control is None:
            assert before.dt is not None
            solution = run_fixed(scene, duration, before.dt, options, frames, watch, resumed=resumed).solution()
        else:
            solution = integrate(scene, duration, before.control[0], options, frames, watch, resumed=resumed)
        return _run(scene, solution, of_nothing("the error of a resumed run is not estimated"))

    with progress_bar(progress, duration) as bar:
        begin = lambda: beginning(scene, options, before.dt, frames, resumed)  # noqa: E731
        return _followed(compute, Watch(callback, bar.bar), begin)


# A duration over the time of its end that is above the rounding of the clock by a thousand times.
_SHORTEST = 1e-12
# A duration [s] whose inverse square is finite: rates in 1/s^2 are computed. No cloth moves by a rounding within it.
_LEAST = 1e-150


def _check_end(t: float, duration: float) -> None:
    if duration < _LEAST:
        raise ValueError(f"duration must be at least {_LEAST:g} s, got {duration!r}")
    end = t + duration
    if not (end < math.inf and duration > _SHORTEST * max(abs(t), abs(end))):
        raise ValueError(
            f"duration must be more than {_SHORTEST:g} of the time t = {t:g} s, whose rounding is "
            f"of that size, and t + duration finite, got duration = {duration:g} s"
        )


def _check_callback(callback: Any) -> None:
    if callback is not None and not callable(callback):
        raise TypeError(f"callback must be callable, got {check.shown(callback)}")


_DEFAULT_RTOL = 1e-3  # Where neither a step nor a tolerance is given.


def _asked_error(scene: Scene, dt: float | None, rtol: float | None, atol: float | None) -> float | None:
    """The error asked for [m], or None."""
    if rtol is None and atol is None:
        return None
    rtol, atol = checked_tolerances(dt, rtol, atol)
    return (atol or 0.0) + (rtol or 0.0) * size_of(scene)
