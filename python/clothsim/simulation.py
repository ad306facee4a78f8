"""A whole run: `simulate` and what it returns."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _validate as check
from ._extras import needed
from .adaptive import (
    Controlled, Options, Progress, Solution, automatic, frame_times, rms, run_fixed, size_of, solve,
)  # fmt: skip
from .build import build_config
from .integration import integrators
from .measures import energy, max_stable_dt, penetration
from .plan import INTEGRATORS, check_backend, check_options
from .scene import Scene


@dataclass(frozen=True)
class Run:
    """What `simulate` returns.

    Attributes
    ----------
    scene : Scene
    t : numpy.ndarray
        Times of the stored frames [s], shape (frames,).
    x, v : numpy.ndarray
        Positions [m] and velocities [m/s], float64, shape (frames, rows, columns, 3).
    report : dict
        See `simulate`.
    """

    scene: Scene
    t: npt.NDArray[np.float64]
    x: npt.NDArray[np.float64]
    v: npt.NDArray[np.float64]
    report: dict[str, Any]

    def save(self, path: str | Path) -> Path:
        """Write the run, with its scene and report, to a .npz file that `load_run` reads.

        Parameters
        ----------
        path : path-like
            ".npz" is added where it lacks.

        Returns
        -------
        pathlib.Path
            The file written.
        """
        path = Path(path)
        if path.suffix != ".npz":
            path = path.with_name(path.name + ".npz")
        texts = {"scene": json.dumps(self.scene.to_dict()), "report": json.dumps(self.report)}
        np.savez_compressed(path, t=self.t, x=self.x, v=self.v, **texts)
        return path

    def to_xarray(self) -> Any:
        """The run as an `xarray.Dataset` with the dimensions time, row, column and component.

        Raises
        ------
        ImportError
            Without xarray, naming the extra that brings it.
        """
        xarray = needed("xarray", "to_xarray")
        dimensions = ("time", "row", "column", "component")
        return xarray.Dataset(
            {
                "position": (dimensions, self.x, {"units": "m"}),
                "velocity": (dimensions, self.v, {"units": "m/s"}),
            },
            {"time": ("time", self.t, {"units": "s"}), "component": ["x", "y", "z"]},
            {"scene": json.dumps(self.scene.to_dict()), "report": json.dumps(self.report)},
        )


def load_run(path: str | Path) -> Run:
    """Read what `Run.save` wrote.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    Run

    Raises
    ------
    ValueError
        If the file is none of `Run.save`.

    Examples
    --------
    >>> import tempfile, clothsim as cs
    >>> run = cs.simulate(cs.scenes.oscillator(), 0.01, dt=1e-3)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     again = cs.load_run(run.save(folder + "/run"))
    >>> bool((again.x == run.x).all()), again.scene == run.scene
    (True, True)
    """
    with np.load(path) as data:
        missing = {"t", "x", "v", "scene", "report"} - set(data.files)
        if missing:
            raise ValueError(f"{path} is no run of clothsim: it lacks {sorted(missing)}")
        scene = Scene.from_dict(json.loads(str(data["scene"])))
        report = json.loads(str(data["report"]))
        return Run(scene, data["t"], data["x"], data["v"], report)


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

    Returns
    -------
    Run
        ``run.t[-1] == duration``; where dt does not divide it, the last step is shorter.
        ``run.report`` has "steps", "rejected_steps", "force_evaluations", "wall_time" [s],
        "steps_per_second", "dt" (the mean step of an adaptive method), "energy" ("start" and
        "end", see `energy`), "penetration" ("points" and "triangles" [m], the deepest over stored
        frames and spheres), "kernel", "integrator", "precision", "strict", "threads",
        "instruction_set" (the adapter with the backend "gpu"), "backend" and "version"; and about
        the error:

        "error_estimate"
            None, or "max" and "rms" [m] of the last positions, from a companion run: at twice
            the step (the difference / (2^order - 1)), or with a tolerance at a tenth of the
            tolerance or half the step (the difference).
        "estimate_evaluations"
            Force evaluations of everything but the run returned. "force_evaluations" and
            "wall_time" do not contain them.
        "tolerance"
            None, or "asked" [m, rms], "floor" [m] (rounding of the precision times the growth of
            perturbations: no method comes below it), "growth" (by a perturbed twin run; None
            where the tolerance is so large that it was not needed) and "below_floor".
        "chaotic"
            True if a mass point has met a sphere: after that, trajectories of nearby states part
            until nothing but outcomes can be compared. "error_estimate" is None then, and
            "outcomes" gives them with the difference of the companion's.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.
    UnstableError
        If the state stops being finite.
    KeyboardInterrupt
        On Ctrl-C.
    ImportError, MemoryError, clothsim.gpu.AdapterLostError, RuntimeError
        With the backend "gpu" only; see `step`.

    Notes
    -----
    A method with error control meets spheres as those with a fixed step do: one collision pass
    after each step. Near a sphere, a step in which a mass point would move by more than a tenth
    of the contact radius relative to it, and by more than the gap, is cut or redone.

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
    check.choice("integrator", integrator, ("auto", *INTEGRATORS))
    named = "rk4" if integrator == "auto" else integrator
    check_options(precision, kernel, strict, named)
    if backend == "gpu" and asked is not None:
        raise ValueError(
            "rtol and atol must be None with backend 'gpu', which takes fixed steps: give dt, or "
            "leave it out for a step of half the guaranteed stable one"
        )
    check_backend(backend, kernel, threads, integrator)
    options = Options(named, precision, threads, kernel, strict, backend)
    shown = _progress(progress)

    if dt is not None:
        if integrator == "auto":
            raise ValueError("integrator must be a name with dt, got 'auto': it chooses the step")
        dt = check.number("dt", dt, minimum=0, exclusive=True)
        if estimate_error is not None:
            check.boolean("estimate_error", estimate_error)
        solution = run_fixed(scene, duration, dt, options, _times(duration, dt, every), shown)
        account = _step_doubling(scene, duration, dt, solution) if estimate_error else _NOTHING
    elif asked is None and integrator != "auto" and not integrators()[integrator].adaptive:
        solution, account = _safe_step(scene, duration, options, every, shown)
    else:
        if any(sphere.response == "continuous" for sphere in scene.spheres):
            raise ValueError(
                "rtol, atol and adaptive integrators need spheres with the response 'reflect' or "
                "'ray': continuous contact is answered at fixed steps; give dt and an integrator"
            )
        asked = _DEFAULT_RTOL * size_of(scene) if asked is None else asked
        if integrator == "auto":
            options = automatic(scene, duration, asked, options)
        found = solve(scene, duration, asked, options, every, shown)
        solution, account = found.solution, _account(scene, found)
    return Run(
        scene, np.array(solution.t), solution.x, solution.v, _report(scene, solution, account)
    )


# Where neither a step nor a tolerance is given: the error, and the part of the guaranteed stable
# step that is taken at most, so that the run with twice the step is stable as well.
_DEFAULT_RTOL = 1e-3
_SAFETY = 0.5
_ATTEMPTS = 8

_NOTHING: dict[str, Any] = {
    "error_estimate": None, "estimate_evaluations": 0, "tolerance": None, "chaotic": None,
    "outcomes": None,
}  # fmt: skip


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
) -> tuple[Solution, dict[str, Any]]:
    """A run at a stable step whose error, estimated by step doubling, meets the default rtol."""
    dt = min(_SAFETY * max_stable_dt(scene, options.integrator), duration / 4)
    goal, order, spent = _DEFAULT_RTOL * size_of(scene), integrators()[options.integrator].order, 0
    for _ in range(_ATTEMPTS):
        solution = run_fixed(scene, duration, dt, options, _times(duration, dt, every), shown)
        account = _step_doubling(scene, duration, dt, solution)
        account["estimate_evaluations"] += spent
        error = account["error_estimate"]
        if error is None or error["rms"] <= goal:
            break
        dt *= min(0.5, (goal / (2 * error["rms"])) ** (1 / order))
        spent = account["estimate_evaluations"] + solution.evaluations
    return solution, account


def _step_doubling(scene: Scene, duration: float, dt: float, solution: Solution) -> dict[str, Any]:
    """The error by comparison with a run of twice the step (Richardson)."""
    coarse = run_fixed(
        scene, duration, 2 * dt, solution.options, [0.0, duration], own_step=True
    )
    order = integrators()[solution.options.integrator].order
    difference = (coarse.x[-1] - solution.x[-1]) / (2**order - 1)
    return _estimate(scene, solution, coarse, difference) | {
        "estimate_evaluations": coarse.evaluations, "tolerance": None
    }  # fmt: skip


def _account(scene: Scene, found: Controlled) -> dict[str, Any]:
    tolerance = {
        "asked": found.asked, "floor": found.floor, "growth": found.growth,
        "below_floor": found.asked < found.floor,
    }  # fmt: skip
    return _estimate(scene, found.solution, found.companion, found.difference) | {
        "estimate_evaluations": found.evaluations, "tolerance": tolerance
    }  # fmt: skip


def _estimate(
    scene: Scene, solution: Solution, companion: Solution, difference: np.ndarray | None
) -> dict[str, Any]:
    """Error of the last positions, or outcomes where a contact has made it meaningless."""
    if difference is not None and not (solution.contacts or companion.contacts):
        largest = float(np.linalg.norm(difference, axis=-1).max())
        error = {"max": largest, "rms": rms(difference)}
        return {"error_estimate": error, "chaotic": False, "outcomes": None}
    ours, theirs = _outcomes(scene, solution), _outcomes(scene, companion)
    outcomes = {
        name: {"value": value, "difference": _difference(value, theirs[name])}
        for name, value in ours.items()
    }
    return {"error_estimate": None, "chaotic": True, "outcomes": outcomes}


def _outcomes(scene: Scene, one: Solution) -> dict[str, Any]:
    x, v = one.x[-1], one.v[-1]
    mass = scene.cloth.mass_per_point[..., None]
    energies = energy(scene, x, v)
    end = one.t[-1]
    return {
        "first_contact": one.first_contact,
        "centre_of_mass": ((mass * x).sum(axis=(0, 1)) / mass.sum()).tolist(),
        "kinetic_energy": energies["kinetic"],
        "total_energy": energies["total"],
        "penetration": max(float(penetration(x, s, end)["triangles"]) for s in scene.spheres),
    }


def _difference(a: Any, b: Any) -> float | None:
    if a is None or b is None:
        return None
    return float(np.linalg.norm(np.subtract(a, b)))


def _report(scene: Scene, solution: Solution, account: dict[str, Any]) -> dict[str, Any]:
    t, x, v = solution.t, solution.x, solution.v
    depths = [penetration(one, sphere, at) for sphere in scene.spheres for one, at in zip(x, t)]
    wall_time, options, state = solution.wall_time, solution.options, solution.state
    return {
        "steps": solution.steps,
        "rejected_steps": solution.rejected,
        "force_evaluations": solution.evaluations,
        "wall_time": wall_time,
        "steps_per_second": solution.steps / wall_time if wall_time > 0 else math.inf,
        "dt": solution.step,
        **account,
        "energy": {"start": energy(scene, x[0], v[0]), "end": energy(scene, x[-1], v[-1])},
        "penetration": {
            name: max((depth[name] for depth in depths), default=0.0)
            for name in ("points", "triangles")
        },
        "kernel": state.kernel,
        "integrator": options.integrator,
        "precision": options.precision,
        "strict": options.strict,
        "threads": state.threads,
        "instruction_set": state.instruction_set,
        "backend": options.backend,
        "version": build_config()["version"],
    }


def _progress(shown: bool) -> Progress:
    if not check.boolean("progress", shown):
        return iter
    try:
        from tqdm.auto import tqdm
    except ImportError as error:
        raise ImportError("progress=True needs tqdm: pip install 'clothsim[demo]'") from error
    return partial(tqdm, unit="frame")
