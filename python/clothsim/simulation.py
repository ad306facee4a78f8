"""A whole run: `simulate`."""

from __future__ import annotations

from functools import partial

import numpy as np

from . import _validate as check
from ._extras import needed
from ._keywords import suggests
from .account import Account, of_companion, of_nothing, of_tolerance, report
from .adaptive import automatic, solve
from .integration import integrator_name, integrators, warn_of_order
from .measures import max_stable_dt
from .plan import BACKENDS, check_backend, check_options
from .run import Run
from .runs import Options, Progress, Solution, frame_times, run_fixed, size_of
from .scene import Scene


@suggests
def simulate(
    scene: Scene,
    duration: float,
    dt: float | None = None,
    integrator: str | None = None,
    precision: str = "double",
    rtol: float | None = None,
    atol: float | None = None,
    every: int | float | None = None,
    threads: int | None = None,
    progress: bool = False,
    *,
    kernel: str = "auto",
    strict: bool = False,
    backend: str = "cpu",
    estimate_error: bool | None = None,
    sampling: int = 32,
) -> Run:
    """Run a scene from its initial state for `duration` and store frames.

    Parameters
    ----------
    scene : Scene
    duration : float
        Simulated time [s], > 0.
    dt : float, optional
        Time step [s]. Not together with `rtol` or `atol`.
    integrator : str, optional
        A name of `integrators`, or "auto": method, precision and step by the tolerance. Default:
        "auto" with `rtol` or `atol`, else "rk4".
    precision : {"double", "single"}, default "double"
        As for `step`; "auto" chooses for itself.
    rtol, atol : float, optional
        Error control: the error of the last positions, the root of its mean square over the mass
        points, is to be at most ``atol + rtol * max(scene.cloth.size)`` [m]; what is not given is
        0. Without `dt`, `rtol` and `atol`, rtol is 1e-3 and the step at most half of the
        guaranteed stable one.
    every : int or float, optional
        An int stores a frame every so many steps, a float every so many seconds: a method with
        error control keeps its steps and stores its dense output, others take a shorter step
        where dt does not divide it. Default: only the first and the last state, which are stored
        in any case.
    threads, kernel, strict, backend
        As for `step`. The backend "gpu" takes fixed steps of "rk4" only: no `rtol` and `atol`.
    progress : bool, default False
        True shows a progress bar (tqdm, in the extra "demo").
    estimate_error : bool, optional
        Whether a run with a given `dt` is compared with one of twice the time step, at half the
        cost again. Default: no. Without `dt` the error is always estimated.
    sampling : int, default 32
        Depths of triangles and stretches are sampled at so many states of the run at least, evenly
        in time, if it has as many steps: after every n-th step, n = min(128, steps // sampling). A
        method with error control samples after every 16th step, and where duration / sampling has
        passed since the last sample. Stored frames are sampled too.

    Returns
    -------
    Run
        ``run.t[-1] == duration``; where dt does not divide it, the last step is shorter.
        ``run.report`` has "steps", "rejected_steps", "force_evaluations" (of the run and of its
        error estimate together), "solution_evaluations" (of the run alone), "wall_time" [s] (of it),
        "steps_per_second", "dt" (the mean step of an adaptive method), "energy" ("start" and
        "end", see `energy`), "kernel", "integrator", "precision", "strict", "threads",
        "instruction_set" (the adapter with the backend "gpu"), "backend" and "version". It also has
        extremes over the states of the run: the initial one and that at the end of each step, after
        the responses. Each is a mapping with a "reason": "" or why a number is NaN, as all are with
        the backend "gpu".

        "penetration"
            "points" and "triangles" [m], the deepest over all spheres; see `penetration`. Mass
            points are watched at every state. Triangles are sampled (`sampling`), and are as deep
            as mass points at least.
        "stretch"
            "largest", see `largest_stretch`; sampled.
        "first_contact"
            "time" [s]: end of the first step in which a response changed the cloth.
        "energy"
            Beside "start" and "end", "gained" [J]: the most by which the total energy was above
            that of the start, 0 where it never was, over one state in 128 and the stored frames
            (one in 16 with error control, or above `max_stable_dt`). Nothing but the method's error
            can add energy until a sphere responds. After a response it is NaN.

        About the error:

        "error_estimate"
            None, or "max" and "rms" [m] of the last positions: with a tolerance, as it was
            carried along with the run or by a run at a smaller tolerance (docs/integrators.md);
            else by a run at twice the step (the difference / (2^order - 1)).
        "estimate_evaluations", "estimate_wall_time"
            Force evaluations and seconds of everything but the run returned: the estimate, and
            runs that turned out too coarse.
        "tolerance"
            None, or "asked" [m, rms], "floor" [m] (rounding of the precision times the growth of
            perturbations: no method comes below it), "growth" (by a perturbed twin run) and
            "below_floor". From 1e-9 of the size up there is no twin: "growth" is None, and
            "floor" 0.
        "chaotic"
            True if a mass point has met a sphere: after that, trajectories of nearby states part
            until nothing but outcomes can be compared. "error_estimate" is None then, and
            "outcomes" gives them with the difference from those of a companion run at a tenth of
            the tolerance.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.
    UnstableError
        If the state stops being finite or runs away; see `Stepper.advance`.
    KeyboardInterrupt
        On Ctrl-C.
    ImportError, MemoryError, clothsim.gpu.AdapterLostError, RuntimeError
        With the backend "gpu" only; see `step`.

    Warns
    -----
    StabilityWarning
        If `dt` is above `max_stable_dt`, or if the run makes energy: until a sphere responds, more
        than half of the kinetic and elastic energy came out of nothing (docs/stability.md).

    Notes
    -----
    A method with error control meets spheres as those with a fixed step do: one collision pass
    after each step, which for "continuous" spheres tests the whole way of the step. Near a sphere,
    a step in which a mass point would move by more than a tenth of the contact radius relative to
    it, and by more than the gap, is cut or redone.

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
    if not isinstance(scene, Scene):
        raise TypeError(f"scene must be a Scene, got {type(scene).__name__}")
    duration = check.number("duration", duration, minimum=0, exclusive=True)
    asked = _asked_error(scene, dt, rtol, atol)
    every = _checked_every(every)
    if integrator is None:
        integrator = "auto" if asked is not None else "rk4"
    integrator = integrator_name(integrator, "auto")
    named = "rk4" if integrator == "auto" else integrator
    check_options(precision, kernel, strict, named)
    check.choice("backend", backend, BACKENDS)
    if backend == "gpu" and asked is not None:
        raise ValueError(
            "rtol and atol must be None with backend 'gpu', which takes fixed steps: give dt, or "
            "leave it out for a step of half the guaranteed stable one"
        )
    check_backend(backend, kernel, threads, integrator)
    sampling = check.integer("sampling", sampling, minimum=1)
    options = Options(named, precision, threads, kernel, strict, backend, sampling)
    shown = _progress(progress)
    warn_of_order(named, scene)

    if dt is not None:
        if integrator == "auto":
            raise ValueError("integrator must be a name with dt, got 'auto': it chooses the step")
        dt = check.number("dt", dt, minimum=0, exclusive=True)
        if estimate_error is not None:
            check.boolean("estimate_error", estimate_error)
        solution = run_fixed(scene, duration, dt, options, _times(duration, dt, every), shown)
        account = of_nothing()
        if estimate_error:
            account = _step_doubling(scene, duration, dt, solution)
    elif asked is None and integrator != "auto" and not integrators()[integrator].adaptive:
        solution, account = _safe_step(scene, duration, options, every, shown)
    else:
        asked = _DEFAULT_RTOL * size_of(scene) if asked is None else asked
        choices = [options]
        if integrator == "auto":
            choices = automatic(scene, duration, asked, options)
        found = solve(scene, duration, asked, choices, every, shown, integrator != "auto")
        solution, account = found.solution, of_tolerance(scene, found)
    return Run(
        scene, np.array(solution.t), solution.x, solution.v, report(scene, solution, account)
    )


# Where neither a step nor a tolerance is given: the error, and the part of the guaranteed stable
# step that is taken at most, so that the run with twice the step is stable as well.
_DEFAULT_RTOL = 1e-3
_SAFETY = 0.5
_ATTEMPTS = 8

def _asked_error(
    scene: Scene, dt: float | None, rtol: float | None, atol: float | None
) -> float | None:
    """The error asked for [m], or None."""
    if rtol is None and atol is None:
        return None
    if dt is not None:
        raise ValueError("dt must be None with rtol or atol: they choose the step")
    relative = 0.0 if rtol is None else check.number("rtol", rtol, minimum=0)
    absolute = 0.0 if atol is None else check.number("atol", atol, minimum=0)
    asked = absolute + relative * size_of(scene)
    if asked == 0:
        raise ValueError("rtol or atol must be > 0, got 0 for both")
    return asked


def _checked_every(every: int | float | None) -> int | float | None:
    if every is None:
        return None
    if isinstance(every, (float, np.floating)):
        return check.number("every", every, minimum=0, exclusive=True)
    return check.integer("every", every, minimum=1)


def _times(duration: float, dt: float, every: int | float | None) -> list[float]:
    between = duration if every is None else every * dt if isinstance(every, int) else every
    return frame_times(duration, between)


def _safe_step(
    scene: Scene, duration: float, options: Options, every: int | float | None, shown: Progress
) -> tuple[Solution, Account]:
    """A run at a stable step whose error, estimated by step doubling, meets the default rtol."""
    dt = min(_SAFETY * max_stable_dt(scene, options.integrator), duration / 4)
    goal, order = _DEFAULT_RTOL * size_of(scene), integrators()[options.integrator].order_of(scene)
    spent, wall_time = 0, 0.0
    for _ in range(_ATTEMPTS):
        solution = run_fixed(scene, duration, dt, options, _times(duration, dt, every), shown)
        account = _step_doubling(scene, duration, dt, solution)
        account["estimate_evaluations"] += spent
        account["estimate_wall_time"] += wall_time
        error = account["error_estimate"]
        if error is None or error["rms"] <= goal:
            break
        dt *= min(0.5, (goal / (2 * error["rms"])) ** (1 / order))
        spent = account["estimate_evaluations"] + solution.evaluations
        wall_time = account["estimate_wall_time"] + solution.wall_time
    return solution, account


def _step_doubling(scene: Scene, duration: float, dt: float, solution: Solution) -> Account:
    """The error by comparison with a run of twice the step (Richardson)."""
    coarse = run_fixed(
        scene, duration, 2 * dt, solution.options, [0.0, duration], own_step=True
    )
    order = integrators()[solution.options.integrator].order_of(scene)
    difference = (coarse.x[-1] - solution.x[-1]) / (2**order - 1)
    return of_companion(scene, solution, coarse, difference)


def _progress(shown: bool) -> Progress:
    if not check.boolean("progress", shown):
        return iter
    return partial(needed("tqdm.auto", "progress=True", "demo").tqdm, unit="frame")
