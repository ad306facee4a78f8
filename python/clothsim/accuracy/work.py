"""Error against cost of methods over their settings."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _validate as check
from .._extras import needed
from ..build import build_config
from ..errors import UnstableError
from ..measures import energy
from ..plan import PRECISIONS
from ..scene import Scene
from .methods import OWN, Method, Outcome, own_methods
from .order import solution_for
from .solution import Reference

# A run that takes longer is not repeated.
_LONG = 2.0  # s


@dataclass
class Measured:
    """A method at a setting: its error, and the times seen so far."""

    method: Method
    setting: float
    rms: float = math.inf
    max: float = math.inf
    force_evaluations: int = 0
    energy_drift: float = math.nan
    once: float = 0.0  # wall time of the first run [s]
    seconds: list[float] = field(default_factory=list)

    @property
    def fastest(self) -> float:
        """Least wall time seen [s]; NaN without any."""
        return min(self.seconds, default=math.nan)

    @property
    def stable(self) -> bool:
        return math.isfinite(self.rms)


class Bench:
    """Runs methods on one scene and keeps errors and times.

    Parameters
    ----------
    scene : Scene
    solution : Reference
        Its last frame is the end of every run.
    """

    def __init__(self, scene: Scene, solution: Reference) -> None:
        self.scene, self.solution = scene, solution
        self.duration = float(solution.t[-1])
        self.energy = energy(scene, solution.x[-1], solution.v[-1])["total"]

    def first(self, method: Method, setting: float) -> Measured:
        """The error of a run, whose time does not count: it may compile or fill caches."""
        result = Measured(method, setting)
        outcome = self._solve(result)
        if outcome is not None and np.isfinite(outcome.x).all():
            error = self.solution.error_of(outcome.x)
            result.rms, result.max = error["rms"], error["max"]
            result.force_evaluations = outcome.force_evaluations
            total = energy(self.scene, outcome.x, outcome.v)["total"]
            result.energy_drift = float(total - self.energy)
            result.once = outcome.seconds
        return result

    def time(self, results: Sequence[Measured], windows: int) -> Iterator[Measured]:
        """Time stable runs in turns, `windows` times each, in another order every round."""
        shuffle = random.Random(0).shuffle
        turns = [one for one in results if one.stable]
        for _ in range(windows):
            shuffle(turns)
            for one in turns:
                if not (one.seconds and one.fastest > _LONG):
                    outcome = self._solve(one)
                    if outcome is not None:
                        one.seconds.append(outcome.seconds)
                yield one

    def _solve(self, one: Measured) -> Outcome | None:
        try:
            return one.method.solve(self.scene, self.duration, one.setting)
        except (UnstableError, ArithmeticError):
            return None


def pareto(rms: npt.ArrayLike, cost: npt.ArrayLike) -> npt.NDArray[np.bool_]:
    """Which points no other beats in both error and cost.

    Parameters
    ----------
    rms, cost : array_like
        Of one shape; a point that is not finite in both is beaten.

    Returns
    -------
    numpy.ndarray
        True on the front.

    Examples
    --------
    >>> from clothsim.accuracy.work import pareto
    >>> pareto([1e-3, 1e-6, 1e-5, 1e-9], [1.0, 2.0, 3.0, 4.0]).tolist()
    [True, True, False, True]
    """
    rms, cost = np.asarray(rms, dtype=float), np.asarray(cost, dtype=float)
    front = np.zeros(rms.shape, dtype=bool)
    best = math.inf
    for k in np.lexsort((rms.ravel(), cost.ravel())):
        at = np.unravel_index(k, rms.shape)
        if np.isfinite(rms[at]) and np.isfinite(cost[at]) and rms[at] < best:
            front[at] = True
            best = rms[at]
    return front


def work_precision(
    scene: Scene,
    duration: float,
    methods: Sequence[str | Method] | None = None,
    *,
    precisions: Sequence[str] = PRECISIONS,
    dts: Sequence[float] | None = None,
    rtols: Sequence[float] | None = None,
    peers: bool = False,
    threads: int | None = None,
    windows: int = 5,
    longest: float = 10.0,
    reference: Reference | None = None,
    progress: bool = False,
) -> Any:
    """Error against cost: every integrator in every precision at every step or tolerance.

    Errors are distances from the trusted solution at the end. The time is the least over several
    runs, which take turns in another order each round, so that a slow spell of the machine meets
    all of them; it is that of the stepping alone.

    Parameters
    ----------
    scene : Scene
        Without contact up to `duration`.
    duration : float
        Simulated time [s], > 0.
    methods : sequence, optional
        Names of `clothsim.integrators`, run at fixed steps; "NAME adaptive", run at tolerances;
        or objects of the protocol `clothsim.accuracy.methods.Method`. Default: all integrators.
    precisions : sequence of {"double", "single"}, default both
        For the methods given by name.
    dts : sequence of float, optional
        Time steps [s] of fixed-step methods. Default: seven, each half of the one before, from 0.95
        of the guaranteed stable step (8 times RK4's for an implicit method).
    rtols : sequence of float, optional
        Tolerances of adaptive methods, over the cloth's larger side: of the error at the end for
        `simulate`, whose companion run for the estimate is not counted; of a step for the peers.
        Default: 1e-3, 1e-4, ..., 1e-13.
    peers : bool, default False
        True adds what is installed of numba's RK4, SciPy's DOP853 and RK45 over numba's forces,
        and diffrax (extras "bench" and "peers").
    threads : int, optional
        Threads of every method. Default: as in `simulate`; one for the peers.
    windows : int, default 5
        Timed runs of each.
    longest : float, default 10.0
        The finer settings of a method are left out once a run took longer than this [s].
    reference : Reference, optional
        Default: `reference(scene, duration)`.
    progress : bool, default False
        True shows a progress bar (tqdm, in the extra "demo").

    Returns
    -------
    xarray.Dataset
        Dimensions "solver" and "level" (the number of the setting, the coarsest first).
        Coordinates of "solver": its label, "integrator", "precision", "library", "threads" (0: the
        library's choice) and "control" ("dt" or "rtol"). Variables, NaN where a solver has no
        such level: "setting" (dt [s] or rtol), "rms_error" and "max_error" [m], infinite where
        unstable; "force_evaluations"; "wall_time" per simulated second [s/s]; "energy_drift" [J],
        the total energy at the end less that of the reference, which is the change of energy
        itself where nothing is damped; "pareto", True where no run of clothsim, and "pareto_all",
        where none at all, is both faster and more accurate. The attributes tell scene, duration,
        reference error, machine and version.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.
    ImportError
        Without xarray, naming the extra that brings it.

    Examples
    --------
    >>> import clothsim as cs
    >>> scene = cs.scenes.oscillator(damping=1.0)
    >>> data = cs.work_precision(scene, 0.5, ["rk4"], precisions=["double"], dts=[0.02, 0.01])
    >>> data.sizes["level"], bool(data.rms_error[0, 1] < data.rms_error[0, 0] / 10)
    (2, True)
    """
    xarray = needed("xarray", "work_precision")
    duration = check.number("duration", duration, minimum=0, exclusive=True)
    windows = check.integer("windows", windows, minimum=1)
    chosen = _methods(scene, methods, precisions, check.boolean("peers", peers), threads)
    levels = [_settings(one, scene, duration, dts, rtols) for one in chosen]
    bench = Bench(scene, solution_for(scene, duration, reference))
    jobs = [(m, n) for m, settings in enumerate(levels) for n in range(len(settings))]
    results: dict[tuple[int, int], Measured] = {}
    with progress_bar(len(jobs) * (1 + windows), progress) as advance:
        for m, n in jobs:
            if n and ((m, n - 1) not in results or results[m, n - 1].once > longest):
                advance(1 + windows)
                continue
            results[m, n] = bench.first(chosen[m], levels[m][n])
            advance(1 if results[m, n].stable else 1 + windows)
        for _ in bench.time(list(results.values()), windows):
            advance(1)
    return _dataset(xarray, bench, chosen, results)


def _methods(
    scene: Scene,
    methods: Sequence[str | Method] | None,
    precisions: Sequence[str],
    peers: bool,
    threads: int | None,
) -> list[Method]:
    if not isinstance(scene, Scene):
        raise TypeError(f"scene must be a Scene, got {scene!r} ({type(scene).__name__})")
    names = None if methods is None else [m for m in methods if isinstance(m, str)]
    chosen: list[Method] = list(own_methods(names, precisions, threads))
    chosen += [m for m in methods or () if not isinstance(m, str)]
    if peers:
        from .peers import installed_peers, refused

        if reason := refused(scene):
            raise ValueError(f"peers must be False for this scene: {reason}")
        chosen += installed_peers(scene, threads)[0]
    if not chosen:
        raise ValueError("methods must name at least one method, got none")
    return chosen


def _settings(
    method: Method,
    scene: Scene,
    duration: float,
    dts: Sequence[float] | None,
    rtols: Sequence[float] | None,
) -> list[float]:
    name, given = ("dts", dts) if method.control == "dt" else ("rtols", rtols)
    if given is None:
        return method.settings(scene, duration)
    check.size(name, given)
    values = {
        check.number(f"{name}[{k}]", value, minimum=0, exclusive=True)
        for k, value in enumerate(given)
    }
    return sorted(values, reverse=True)


class progress_bar:
    """A tqdm bar as a context that gives the function to advance it; nothing if not shown."""

    def __init__(self, total: int, shown: bool) -> None:
        self.total, self.shown = total, check.boolean("progress", shown)

    def __enter__(self) -> Any:
        if not self.shown:
            return lambda count: None
        try:
            from tqdm.auto import tqdm
        except ImportError as error:
            raise ImportError("progress=True needs tqdm: pip install 'clothsim[demo]'") from error
        self.bar = tqdm(total=self.total, unit="run")
        return self.bar.update

    def __exit__(self, *error: object) -> None:
        if self.shown:
            self.bar.close()


def label(method: Method) -> str:
    """Name and precision, and the number of threads of a peer."""
    threads = f", {method.threads} threads" if method.library != OWN and method.threads != 1 else ""
    return f"{method.name} {method.precision}{threads if method.threads else ''}"


def _dataset(
    xarray: Any, bench: Bench, methods: list[Method], results: dict[tuple[int, int], Measured]
) -> Any:
    shape = len(methods), 1 + max(n for _, n in results)
    duration = bench.duration

    def table(value: Any) -> npt.NDArray[np.float64]:
        array = np.full(shape, np.nan)
        for at, one in results.items():
            array[at] = value(one)
        return array

    rms, wall_time = table(lambda r: r.rms), table(lambda r: r.fastest / duration)
    own = np.array([m.library == OWN for m in methods])
    columns = {
        "setting": (table(lambda r: r.setting), "dt [s] or relative tolerance", ""),
        "rms_error": (rms, "rms distance from the reference at the end", "m"),
        "max_error": (table(lambda r: r.max), "largest distance from the reference", "m"),
        "force_evaluations": (table(lambda r: r.force_evaluations), "force evaluations", "1"),
        "wall_time": (wall_time, "wall time per simulated second", "s/s"),
        "energy_drift": (table(lambda r: r.energy_drift), "total energy less the reference's", "J"),
        "pareto": (
            pareto(np.where(own[:, None], rms, np.nan), wall_time),
            "on the front of clothsim's methods",
            "",
        ),
        "pareto_all": (pareto(rms, wall_time), "on the front of all methods", ""),
    }
    solution = bench.solution
    return xarray.Dataset(
        {
            name: (("solver", "level"), values, {"long_name": text, "units": unit})
            for name, (values, text, unit) in columns.items()
        },
        {
            "solver": [label(m) for m in methods],
            "level": np.arange(shape[1]),
            "integrator": ("solver", [m.name for m in methods]),
            "precision": ("solver", [m.precision for m in methods]),
            "library": ("solver", [m.library for m in methods]),
            "threads": ("solver", [m.threads or 0 for m in methods]),
            "control": ("solver", [m.control for m in methods]),
        },
        {
            "scene": json.dumps(bench.scene.to_dict()),
            "duration": duration,
            "reference_error_estimate_rms": float(solution.error_estimate["rms"][-1]),
            "reference_error_bound_rms": float(solution.error_bound["rms"][-1]),
            "instruction_set": build_config()["instruction_set"],
            "version": build_config()["version"],
        },
    )
