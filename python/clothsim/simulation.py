"""A whole run: `simulate` and what it returns."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _validate as check
from .build import build_config
from .measures import energy, max_stable_dt, penetration
from .scene import Scene
from .stepping import Stepper

# A remainder below this part of a step is rounding of the caller's numbers, not a step.
_NEGLIGIBLE = 1e-9

# Part of the guaranteed stable time step that is taken where no time step is given.
_SAFETY = 0.5


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
        try:
            import xarray
        except ImportError as error:
            raise ImportError("to_xarray needs xarray: pip install 'clothsim[sweep]'") from error
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
    integrator: str = "rk4",
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
    estimate_error: bool = False,
) -> Run:
    """Run a scene from its initial state for `duration` and store frames.

    Parameters
    ----------
    scene : Scene
    duration : float
        Simulated time [s], > 0.
    dt : float, optional
        Time step [s]. Default: half of the guaranteed stable one (`max_stable_dt`).
    integrator, precision, threads, kernel, strict, backend
        As for `step`.
    rtol, atol : None
        Error control is not built yet; a value is refused.
    every : int or float, optional
        An int stores a frame every so many steps, a float every so many seconds (a shorter step
        is taken where dt does not divide it). Default: only the first and the last state, which
        are stored in any case.
    progress : bool, default False
        True shows a progress bar (tqdm, in the extra "demo").
    estimate_error : bool, default False
        True runs a second time with twice the time step, at half the cost again, and reports
        ``error_estimate``.

    Returns
    -------
    Run
        ``run.t[-1] == duration``; where dt does not divide it, the last step is shorter.
        ``run.report`` has "steps", "force_evaluations", "wall_time" [s], "steps_per_second",
        "dt", "error_estimate" (None, or "max" and "rms" [m] of the last positions: the
        difference of the two runs / 15), "energy" ("start" and "end", see `energy`), "penetration"
        ("points" and "triangles" [m], the deepest over stored frames and spheres),
        "kernel", "integrator", "precision", "strict", "threads",
        "instruction_set" (the adapter with the backend "gpu"), "backend" and "version".

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.
    UnstableError
        If the state stops being finite.
    KeyboardInterrupt
        On Ctrl-C.

    Examples
    --------
    >>> import clothsim as cs
    >>> run = cs.simulate(cs.scenes.paper_swing(), 0.01, dt=1e-4, every=25, estimate_error=True)
    >>> run.x.shape, float(run.t[-1]), run.report["steps"]
    ((5, 32, 32, 3), 0.01, 100)
    >>> run.report["error_estimate"]["max"] < 1e-9
    True
    """
    if not isinstance(scene, Scene):
        raise TypeError(f"scene must be a Scene, got {type(scene).__name__}")
    duration = check.number("duration", duration, minimum=0, exclusive=True)
    if rtol is not None or atol is not None:
        raise ValueError("rtol and atol must be None: error control is not built yet; give dt")
    if dt is None:
        dt = min(_SAFETY * max_stable_dt(scene), duration)
    dt = check.number("dt", dt, minimum=0, exclusive=True)
    times = _frame_times(duration, dt, every)
    options = {
        "integrator": integrator, "precision": precision, "threads": threads, "kernel": kernel,
        "strict": strict, "backend": backend,
    }  # fmt: skip
    stepper = Stepper(scene, **options)
    frames = [(stepper.positions, stepper.velocities)]
    steps, wall_time = 0, 0.0
    for begin, end in _progress(list(zip(times[:-1], times[1:])), progress):
        start = time.perf_counter()
        steps += _advance_to(stepper, begin, end, dt)
        wall_time += time.perf_counter() - start
        frames.append((stepper.positions, stepper.velocities))
    x, v = (np.array(arrays) for arrays in zip(*frames))

    error = None
    if estimate_error:
        coarse = Stepper(scene, **options)
        _advance_to(coarse, 0.0, duration, 2 * dt)
        difference = np.linalg.norm(x[-1] - coarse.positions, axis=-1) / 15
        error = {"max": float(difference.max()), "rms": float(np.sqrt((difference**2).mean()))}
    depths = [penetration(one, sphere, t) for sphere in scene.spheres for one, t in zip(x, times)]
    report = {
        "steps": steps,
        "force_evaluations": 4 * steps,
        "wall_time": wall_time,
        "steps_per_second": steps / wall_time if wall_time > 0 else math.inf,
        "dt": dt,
        "error_estimate": error,
        "energy": {"start": energy(scene, x[0], v[0]), "end": energy(scene, x[-1], v[-1])},
        "penetration": {
            name: max((depth[name] for depth in depths), default=0.0)
            for name in ("points", "triangles")
        },
        "kernel": stepper.kernel,
        "integrator": integrator,
        "precision": precision,
        "strict": strict,
        "threads": stepper.threads,
        "instruction_set": stepper.instruction_set,
        "backend": stepper.backend,
        "version": build_config()["version"],
    }
    return Run(scene, np.array(times), x, v, report)


def _frame_times(duration: float, dt: float, every: int | float | None) -> list[float]:
    """Times of the frames: 0, each multiple of `every` before the end, and the end."""
    if every is None:
        return [0.0, duration]
    if isinstance(every, (float, np.floating)):
        between = check.number("every", every, minimum=0, exclusive=True)
    else:
        between = check.integer("every", every, minimum=1) * dt
    count = math.ceil(duration / between - _NEGLIGIBLE)
    return [k * between for k in range(count)] + [duration]


def _advance_to(stepper: Stepper, begin: float, end: float, dt: float) -> int:
    """Steps of `dt` from `begin` to `end`, the last one shorter if need be; how many there were."""
    whole = math.floor((end - begin) / dt + _NEGLIGIBLE)
    stepper.advance(whole, dt)
    rest = (end - begin) - whole * dt
    if rest <= _NEGLIGIBLE * dt:
        return whole
    stepper.advance(1, rest)
    return whole + 1


def _progress(parts: list[Any], shown: bool) -> Iterator[Any]:
    if not check.boolean("progress", shown):
        yield from parts
        return
    try:
        from tqdm.auto import tqdm
    except ImportError as error:
        raise ImportError("progress=True needs tqdm: pip install 'clothsim[demo]'") from error
    yield from tqdm(parts, unit="frame")
