"""`simulate`: arguments to a `Job`, its `Trajectory` to a `Run`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NoReturn, TypeVar, cast, overload

import numpy as np
import numpy.typing as npt

from ..base import check
from ..base.interrupts import Interrupts
from ..base.progress import ProgressBar
from ..engine.force import check_force, force_of_each_scene
from ..engine.options import Options
from ..engine.snapshot import make_snapshot
from ..engine.state import check_state_arrays, initial_arrays, list_scenes
from ..errors import ContactError, RunInterrupted, ToleranceWarning, UnstableError, warn_caller
from ..methods.bound import least_rtol_of_rkc2
from ..methods.integrators import check_integrator_name, warn_of_order
from ..model.scene import Scene
from ..typing import Backend, Force, Integrator, Kernel, Precision
from .error_control import estimate_error_of_run, longer_side, run_to_error
from .frames import Frames
from .reasons import Reason
from .recording import Failure, Recording, StopRun, Watch
from .report import make_report
from .result import Run
from .trajectory import Job, Trajectory

_DEFAULT_RTOL = 1e-3  # Where neither a step nor a tolerance is given.
# A duration over the time of its end that is above the rounding of the clock by a thousand times.
_SHORTEST = 1e-12
# A duration [s] whose inverse square is finite: rates in 1/s^2 are computed. No cloth moves by a
# rounding within it.
_LEAST = 1e-150


@overload
def simulate(
    scene: Scene,
    duration: float,
    dt: float | None = None,
    integrator: Integrator | None = None,
    precision: Precision = "double",
    rtol: float | None = None,
    atol: float | None = None,
    every: float | None = None,
    threads: int | None = None,
    progress: bool = False,
    *,
    t: float = 0.0,
    times: npt.ArrayLike | None = None,
    fps: float | None = None,
    force: Force | list[Force] | None = None,
    callback: Callable[[float, Any, Any], Any] | None = None,
    kernel: Kernel = "auto",
    backend: Backend = "cpu",
    estimate_error: bool | None = None,
) -> Run: ...
@overload
def simulate(
    scene: Sequence[Scene], duration: float, *arguments: Any, **options: Any
) -> list[Run]: ...
@check.check_names
def simulate(
    scene: Scene | Sequence[Scene],
    duration: float,
    dt: float | None = None,
    integrator: Integrator | None = None,
    precision: Precision = "double",
    rtol: float | None = None,
    atol: float | None = None,
    every: float | None = None,
    threads: int | None = None,
    progress: bool = False,
    *,
    t: float = 0.0,
    times: npt.ArrayLike | None = None,
    fps: float | None = None,
    force: Force | list[Force] | None = None,
    callback: Callable[[float, Any, Any], Any] | None = None,
    kernel: Kernel = "auto",
    backend: Backend = "cpu",
    estimate_error: bool | None = None,
) -> Run | list[Run]:
    """Run a scene from its initial state for `duration` and store frames.

    Parameters
    ----------
    scene : Scene or sequence of Scene
        Scenes of one shape give a list of runs, each with the bits of that run alone.
    duration : float
        Simulated time [s], > 0.
    dt : float, optional
        Time step [s], not with `rtol` or `atol`. If it does not divide the duration, the last step
        is shorter.
    integrator : str, optional
        A name of `integrators`, or "auto", which chooses method, precision and step by the
        tolerance and the damping. Default: "auto" without `dt`, "rk4" with it.
    precision, threads, kernel, backend
        As for `step`. The backend "gpu" takes fixed steps of "rk4" only.
    rtol, atol : float, optional
        Error control: the rms error of the last positions over the mass points is to be at most
        ``atol + rtol * max(scene.cloth.size)`` [m]. Without `dt`, `rtol` and `atol`, rtol is 1e-3.
    every, times, fps
        When frames are stored besides the first and the last state. `every`: an interval in steps
        (an int) or seconds (a float); `times` of the scene [s], increasing; `fps`: frames per
        second. Frames never change a run.
    progress : bool, default False
        True shows a progress bar of simulated seconds on a terminal and in a notebook (tqdm, in the
        extra "demo").
    t : float, default 0.0
        Time of the initial state [s], at which moving spheres and pins start.
    force : callable, optional
        A force of time and state, a part of the equation: ``force(t, x, v)`` returns the force on
        each mass point [N], shape (rows, columns, 3), for read-only arrays of positions and
        velocities. It is called at every evaluation, so it must depend on its arguments alone. A
        `scipy.LowLevelCallable` or a numba `cfunc` ``void(double t, const double *x, const double
        *v, double *f, int64_t points)`` is called without Python; `f` comes filled with 0
        (docs/runs.md). Of several scenes: one for all, or a list of one for each.
    callback : callable, optional
        ``callback(t, x, v)`` is called at each frame, with read-only arrays; True stops the run, at
        the end of the step. If error control repeats the run, the calls start again from the first
        frame.
    estimate_error : bool, optional
        Whether a run with a given `dt` is compared with a more accurate run. Without `dt` the error
        is always estimated.

    Returns
    -------
    Run, or list of Run
        ``run.t[-1] == t + duration``. `Run` says what is in ``run.report``.

    Raises
    ------
    UnstableError, ContactError
        If the state runs away, or a mass point goes through a layer; ``error.run`` is the run so
        far. Of many scenes it is the first error, of ``error.member``, raised when all have ended;
        ``error.runs`` has all runs.
    RunInterrupted
        On Ctrl-C; its ``run`` ends with the last whole step.
    Exception
        Whatever `force` or `callback` raise, with the run so far as ``error.run``.

    Warns
    -----
    StabilityWarning, ContactWarning, OrderWarning
        As `Stepper` and `Stepper.advance`.
    ToleranceWarning
        If the error is above the one that was asked for, or not known.

    Examples
    --------
    >>> run = cs.simulate(cs.scenes.oscillator(), 1.0, rtol=1e-6, fps=25)
    >>> run.x.shape, run.report["integrator"], run.report["error_estimate"]["rms"] < 1e-6
    ((26, 1, 2, 3), 'dop853', True)
    """
    batched = not isinstance(scene, Scene)
    scenes = list_scenes(scene)
    if batched and (dt is None or callback is not None or estimate_error or backend == "gpu"):
        forces = force_of_each_scene(force, scenes, batched) or [None] * len(scenes)
        return _simulate_one_by_one(
            scenes,
            forces,
            duration=duration,
            dt=dt,
            integrator=integrator,
            precision=precision,
            rtol=rtol,
            atol=atol,
            every=every,
            threads=threads,
            progress=progress,
            t=t,
            times=times,
            fps=fps,
            callback=callback,
            kernel=kernel,
            backend=backend,
            estimate_error=estimate_error,
        )
    duration = check.number("duration", duration, minimum=0, exclusive=True)
    t = check.number("t", t)
    _check_end_time(t, duration)
    request = _tolerance_in_metres(scenes[0], dt, rtol, atol)
    frames = Frames.from_arguments(every, times, fps, t, duration)
    if integrator is None:
        integrator = "rk4" if dt is not None or backend == "gpu" else "auto"
    integrator = check_integrator_name(integrator, "auto", fixed=dt is not None)
    method = "rk4" if integrator == "auto" else integrator
    options = Options(method, precision, threads, kernel, backend)
    if options.backend == "gpu" and (request is not None or integrator == "auto"):
        raise ValueError(
            "rtol and atol must be None and integrator must be 'rk4' with backend 'gpu', which "
            "takes fixed steps: give dt, or leave it out for steps that meet rtol "
            f"{_DEFAULT_RTOL:g}"
        )
    any(warn_of_order(method, member) for member in scenes)
    if dt is not None:
        if integrator == "auto":
            raise ValueError("integrator must be a name with dt, got 'auto': it chooses the step")
        dt = check.number("dt", dt, minimum=0, exclusive=True)
        check.check_step_count(duration, dt)
    if estimate_error is not None:
        check.boolean("estimate_error", estimate_error)
    _check_callback(callback)
    force_of_each_scene(force, scenes, batched)
    if integrator == "auto":
        relative = _DEFAULT_RTOL if request is None else request / longer_side(scenes[0])
        chosen = "rkc2" if relative >= least_rtol_of_rkc2(scenes[0]) else "dop853"
        options = replace(options, integrator=chosen, precision="double")
    if options.precision == "single":
        check_state_arrays(*initial_arrays(scenes, batched), scenes, batched, "single")
    job = Job(scenes, batched, duration, options, t, frames, force, dt)
    tolerance = _DEFAULT_RTOL * longer_side(scenes[0]) if request is None else request

    def compute(watch: Watch) -> Run | list[Run]:
        if batched:
            runs, errors = run_batch(job, watch)
            return _raise_first_error([errors[k] for k in sorted(errors)], runs)
        if dt is None:
            controlled = run_to_error(job, tolerance, watch, auto=integrator == "auto")
            run = _run_of_trajectory(
                controlled.trajectory, controlled=controlled, requested_error=tolerance
            )
            # After a response of the paper's, a call that asked for no error gets none.
            if request is not None or controlled.error.reason != Reason.CONTACT:
                _warn_of_error(run)
            return run
        trajectory = Recording(job, watch).run_to_end().trajectory()
        estimated = estimate_error_of_run(job, trajectory) if estimate_error else None
        return _run_of_trajectory(trajectory, controlled=estimated)

    return _compute_under_watch(compute, job, callback, progress)


def _warn_of_error(run: Run) -> None:
    """Warn where the tolerance was not reached."""
    if run.report["tolerance"]["reached"]:
        return
    error = run.report["error_estimate"]
    result = "not known" if math.isnan(error["rms"]) else "above the one that was asked for"
    warn_caller(f"the error at the end is {result}: {error['reason']}", ToleranceWarning)


Runs = TypeVar("Runs", bound=Run | list[Run])


def run_batch(job: Job, watch: Watch | None = None) -> tuple[list[Run], dict[int, Failure]]:
    """Return runs side by side, at a fixed step, and errors of those that end early, by member."""
    recording = Recording(job, watch or Watch()).run_to_end()
    return _runs_of_recording(recording), {k: error for k, (error, _) in recording.failed.items()}


def _simulate_one_by_one(
    scenes: list[Scene], forces: list[Force | None], duration: float, **options: Any
) -> list[Run]:
    """Return the runs of a call that cannot take its scenes side by side."""
    runs: list[Run] = []
    errors: list[Failure] = []
    for k, scene in enumerate(scenes):
        try:
            runs.append(simulate(scene, duration, **options, force=forces[k]))
        except (UnstableError, ContactError) as error:
            errors.append(replace(error, member=k))
            errors[-1].run = error.run
            runs.append(error.run)
        except RunInterrupted as interrupt:
            interrupt.run = [*runs, interrupt.run]
            raise
    return _raise_first_error(errors, runs)


def _raise_first_error(errors: list[Failure], runs: list[Run]) -> list[Run]:
    if not errors:
        return runs
    errors[0].runs = runs
    raise errors[0]


def _run_of_trajectory(trajectory: Trajectory, reason_of_end: str = "", **accuracy: Any) -> Run:
    """Return the public form of a run; `accuracy` is what `make_report` takes about its error."""
    state = trajectory.state
    final = None
    if trajectory.saved is not None or not state.batched:
        final = make_snapshot(state, trajectory.scene, trajectory.options, trajectory.saved)
    return Run(
        trajectory.scene,
        np.array(trajectory.t),
        trajectory.x,
        trajectory.v,
        make_report(trajectory, reason_of_end, **accuracy),
        final,
        trajectory.continuation,
    )


def _runs_of_recording(recording: Recording, reason: str = "") -> list[Run]:
    """Return the runs so far; they ended for the `reason`, or for that of a member's own error."""
    errors = {k: error for k, (error, _) in recording.failed.items()}
    runs = [
        _run_of_trajectory(trajectory, _reason_of_end(errors[k]) if k in errors else reason)
        for k, trajectory in enumerate(recording.trajectories())
    ]
    for k, error in errors.items():
        error.run = runs[k]
    return runs


def _reason_of_end(error: Failure) -> str:
    return "unstable" if isinstance(error, UnstableError) else "contact"


def _compute_under_watch(
    compute: Callable[[Watch], Runs], job: Job, callback: Any, progress: bool
) -> Runs:
    """Return what `compute` does, or the runs up to an early end, at least their first frames."""
    bar = ProgressBar.for_simulated_time(progress, job.duration)
    watch = Watch(callback, bar.bar)

    def runs_so_far(reason: str) -> Any:
        recording = watch.recording or Recording(job, Watch())
        runs = _runs_of_recording(recording, reason)
        return runs if recording.state.batched else runs[0]

    try:
        with bar:
            return compute(watch)
    except StopRun:
        return cast(Runs, runs_so_far("callback"))  # the callback was called for a frame of it
    except (UnstableError, ContactError) as error:
        error.run = error.run or runs_so_far(_reason_of_end(error))
        raise
    except Exception as error:  # of the user's force or callback
        if watch.recording is not None:
            error.run = runs_so_far("error")  # type: ignore[attr-defined]
        raise
    except KeyboardInterrupt:
        raise_interrupted(lambda: runs_so_far("interrupted"))


def raise_interrupted(so_far: Callable[[], Any]) -> NoReturn:
    """Raise RunInterrupted with the run so far. A second Ctrl-C is held back meanwhile."""
    with Interrupts():
        raise RunInterrupted(so_far()) from None


def resume_run(
    run: Run,
    duration: float,
    every: Any,
    times: Any,
    fps: Any,
    force: Any,
    callback: Any,
    progress: bool,
) -> Run:
    """Continue a run, as `Run.resume` says."""
    snapshot = run.snapshot
    past = run.continuation
    if snapshot is None or past is None or (past.dt is None and past.control is None):
        raise ValueError(
            "this run cannot be resumed, as its final state was not kept: runs of simulate "
            "and of load_run can"
        )
    duration = check.number("duration", duration, minimum=0, exclusive=True)
    _check_end_time(past.start, past.seconds + duration)
    if past.dt is not None:
        check.check_step_count(duration, past.dt)
    frames = past.frames
    if not (every is None and times is None and fps is None):
        frames = Frames.from_arguments(every, times, fps, past.start + past.seconds, duration)
    _check_callback(callback)
    check_force(force)
    if past.forced and force is None:
        raise ValueError("force must be given: this run had one, and functions are not kept")
    job = Job(
        [run.scene],
        False,
        duration,
        snapshot.options,
        past.start,
        frames,
        force,
        past.dt,
        resumed=(snapshot, past),
    )

    def compute(watch: Watch) -> Run:
        return _run_of_trajectory(
            Recording(job, watch).run_to_end().trajectory(), reason_unknown=Reason.RESUMED
        )

    return _compute_under_watch(compute, job, callback, progress)


def _check_end_time(t: float, duration: float) -> None:
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
        raise TypeError(f"callback must be callable, got {check.value_text(callback)}")


def checked_tolerances(dt: Any, rtol: Any, atol: Any) -> tuple[float | None, float | None]:
    """Return the tolerances as numbers; they choose the step, so `dt` must be None."""
    if dt is not None:
        raise ValueError(
            "dt must be None with rtol or atol, or with integrator 'auto': they choose it; "
            f"got {check.value_text(dt)}"
        )
    rtol = None if rtol is None else check.number("rtol", rtol, minimum=0)
    atol = None if atol is None else check.number("atol", atol, minimum=0)
    if not rtol and not atol and (rtol, atol) != (None, None):
        raise ValueError("rtol or atol must be > 0, got 0 for both")
    return rtol, atol


def _tolerance_in_metres(
    scene: Scene, dt: float | None, rtol: float | None, atol: float | None
) -> float | None:
    """Return the error that is asked for [m], or None."""
    if rtol is None and atol is None:
        return None
    rtol, atol = checked_tolerances(dt, rtol, atol)
    return (atol or 0.0) + (rtol or 0.0) * longer_side(scene)
