"""Error against cost of methods, over their steps or tolerances."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from random import Random
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..base import Floats, check
from ..base.build import build_config
from ..base.extras import import_from_extra
from ..base.progress import ProgressBar
from ..engine.options import PRECISIONS
from ..errors import OrderWarning, StabilityWarning, ToleranceWarning
from ..measure import energy
from ..methods.bound import stable_dt
from ..methods.integrators import METHODS, check_integrator_name
from ..model.scene import Scene
from ..run.simulate import simulate
from ..typing import Force, Precision
from .solution import Reference, checked_or_new_reference

if TYPE_CHECKING:
    import xarray

OWN = "clothsim"  # library of the integrators
_DEFAULT_METHODS = (
    "semi_implicit_euler",
    "velocity_verlet",
    "rk4",
    "dopri5 adaptive",
    "dop853 adaptive",
)
_SAFETY = 0.95  # coarsest step of an explicit method over the guaranteed stable step
_IMPLICIT = 8.0  # coarsest step of an implicit method over the stable step of rk4
_SETTINGS = 7  # number of settings of a method
_RTOLS = tuple(10.0**-k for k in range(3, 14))
_LONGEST_REPEATED = 2.0  # s; a longer run is timed once
_LONGEST = 10.0  # s; after a longer run the finer settings of its method are left out
_COLUMNS = {
    "setting": ("dt [s] or relative tolerance", ""),
    "rms_error": ("rms distance from the reference at the end", "m"),
    "max_error": ("largest distance from the reference", "m"),
    "frames_rms_error": ("largest rms distance over the frames of the reference", "m"),
    "force_evaluations": ("force evaluations", "1"),
    "wall_time": ("wall time per simulated second", "s/s"),
    "wall_time_spread": ("interquartile range of the wall times", "s/s"),
    "energy_drift": ("total energy less the reference's", "J"),
    "pareto": ("no run is both faster and more accurate", ""),
}


@dataclass(frozen=True)
class Method:
    """A way to solve a scene, for `clothsim.work_precision`: a solver of your own.

    Parameters
    ----------
    name : str
    solve : callable
        Function of the scene, the duration [s] and a setting. It returns positions [m] and
        velocities [m/s] at the end, the number of force evaluations, and the wall time [s] of the
        stepping alone: no setting up, no compiling.
    control : {"dt", "rtol"}, default "dt"
        Kind of a setting: a time step [s], or a relative tolerance. `simulate` bounds the error at
        the end by the tolerance times the cloth's longer side. Other solvers mostly bound the error
        of each step.
    library : str, default "own"
        Name of the package.
    precision : str, default "double"
    threads : int, optional

    Examples
    --------
    The leapfrog method over `clothsim.acceleration`, of order 2 where forces depend on x alone.

    >>> import time
    >>> from clothsim.accuracy import Method
    >>> def leapfrog(scene, duration, dt):
    ...     x, v = scene.initial_position, scene.initial_velocity
    ...     steps = round(duration / dt)
    ...     start = time.perf_counter()
    ...     for _ in range(steps):
    ...         x = x + dt / 2 * v
    ...         v = v + dt * cs.acceleration(scene, x, v)
    ...         x = x + dt / 2 * v
    ...     return x, v, steps, time.perf_counter() - start
    >>> method = Method("leapfrog", leapfrog)
    >>> data = cs.work_precision(cs.scenes.oscillator(), 0.5, [method], dts=[0.005, 0.0025])
    >>> round(float(data.rms_error[0, 0] / data.rms_error[0, 1]), 1)
    4.0
    """

    name: str
    solve: Callable[[Scene, float, float], tuple[Floats, Floats, int, float]]
    control: str = "dt"
    library: str = "own"
    precision: Precision = "double"
    threads: int | None = None

    def __post_init__(self) -> None:
        check.choice("control", self.control, ("dt", "rtol"))


@check.check_names
def work_precision(
    scene: Scene,
    duration: float,
    methods: Sequence[str | Method] | None = None,
    *,
    precisions: Sequence[Precision] = ("double",),
    dts: Sequence[float] | None = None,
    rtols: Sequence[float] | None = None,
    threads: int | None = None,
    windows: int = 5,
    reference: Reference | None = None,
    progress: bool = False,
    force: Force | None = None,
) -> xarray.Dataset:
    """Measure error against cost of methods over their steps or tolerances.

    Errors are distances from the trusted solution at the end, and over its frames. The time is that
    of the steps alone, and the least of several runs. The methods take turns, in another order each
    round, so a slow spell of the machine affects all of them.

    Parameters
    ----------
    scene, duration
        As for `reference`.
    methods : sequence, optional
        Names of `clothsim.integrators`, run at fixed steps; "NAME adaptive", run at tolerances; or
        a `clothsim.accuracy.Method` of your own. Default: "semi_implicit_euler", "velocity_verlet",
        "rk4", "dopri5 adaptive" and "dop853 adaptive".
    precisions : sequence of {"double", "single"}, default ("double",)
        Precisions of the methods that are given by name.
    dts : sequence of float, optional
        Time steps [s] of fixed-step methods. Default: seven steps, each half the one before. The
        first is 0.95 of the guaranteed stable step (of RK4 for a method of your own; 8 times that
        for an implicit method), and at most a quarter of the duration.
    rtols : sequence of float, optional
        Tolerances of adaptive methods, over the cloth's longer side. `simulate` applies them to the
        error at the end. The cost does not include its error estimate. Default: 1e-3, 1e-4, ...,
        1e-13.
    threads : int, optional
        Threads of every method. Default: as in `simulate`.
    windows : int, default 5
        Timed runs of each method and setting. After a run of more than 10 s the finer settings of
        its method are left out.
    reference : Reference, optional
        Default: `reference(scene, duration)`, which has no frame before the end. If the reference
        has frames, each setting is also solved up to every frame.
    progress : bool, default False
        Show a progress bar (tqdm, in the extra "demo").
    force : callable, optional
        As for `simulate`; a method of your own gets none.

    Returns
    -------
    xarray.Dataset
        Dimensions "solver" and "level" (the number of the setting, the coarsest first). Coordinates
        of "solver": its name, "integrator", "precision", "library", "threads" (0: the library's
        choice) and "control" ("dt" or "rtol"). Variables, NaN where a solver has no such level:
        "setting" (dt [s] or rtol); "rms_error" and "max_error" [m] at the end and
        "frames_rms_error" [m], the largest over the frames, infinite where unstable;
        "force_evaluations"; "wall_time" per simulated second, the least, and "wall_time_spread",
        the interquartile range of all [s/s]; "energy_drift" [J], the total energy at the end less
        that of the reference, which is the change of energy itself where nothing is damped;
        "pareto", True where no run is both faster and more accurate. The attributes have scene,
        duration, reference error, instruction set and version. Its method ``clothsim.plot`` draws
        error against wall time and evaluations.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above, or as `reference` does.

    Examples
    --------
    >>> scene = cs.scenes.oscillator(damping=1.0)
    >>> data = cs.work_precision(scene, 0.5, ["rk4"], dts=[0.02, 0.01])
    >>> data.sizes["level"], bool(data.rms_error[0, 1] < data.rms_error[0, 0] / 10)
    (2, True)
    """
    xr: Any = import_from_extra("xarray", "work_precision")
    check.instance("scene", scene, Scene)
    duration = check.number("duration", duration, minimum=0, exclusive=True)
    windows = check.integer("windows", windows, minimum=1)
    solvers = _list_methods(methods, precisions, threads, force)
    levels = [_settings_to_try(method, scene, duration, dts, rtols) for method in solvers]
    shape = len(solvers), max(map(len, levels))
    table = {name: np.full(shape, np.nan) for name in _COLUMNS}
    places = [(m, n) for m, n in np.ndindex(shape) if n < len(levels[m])]
    stable = []
    spent = 0.0  # wall time of the last run [s]
    most = duration * len(places) * (1 + windows)
    with ProgressBar.for_simulated_time(progress, most, "work_precision") as bar:
        solution = checked_or_new_reference(scene, duration, reference, force)
        for m, n in places:
            # The first run is not timed: it compiles code and fills caches.
            if not (n and spent > _LONGEST):
                row = _measure_setting(solvers[m], levels[m][n], scene, solution)
                spent = row.pop("spent")
                for name, value in row.items():
                    table[name][m, n] = value
                if math.isfinite(row["rms_error"]):
                    stable.append((m, n))
                bar.advance(duration)
        seconds: dict[tuple[int, int], list[float]] = {place: [] for place in stable}
        # Each round has another order, so a slow spell of the machine affects all methods, and none
        # always follows another.
        shuffle = Random(0).shuffle
        bar.expect_more(-duration * windows * (len(places) - len(stable)))
        for _ in range(windows):
            shuffle(stable)
            for m, n in stable:
                times = seconds[m, n]
                if not (times and min(times) > _LONGEST_REPEATED / duration):
                    seconds_of_run = _solve_or_nan(
                        solvers[m], scene, duration, levels[m][n]
                    ).wall_time
                    times.append(seconds_of_run / duration)
                bar.advance(duration)
    for place, times in seconds.items():
        lower, upper = np.quantile(times, (0.25, 0.75))
        table["wall_time"][place] = min(times)
        table["wall_time_spread"][place] = upper - lower
    columns: dict[str, Any] = {
        **table,
        "pareto": is_on_pareto_front(table["rms_error"], table["wall_time"]),
    }
    of_solver = {
        "solver": [f"{method.name} {method.precision}" for method in solvers],
        "integrator": [method.name for method in solvers],
        "precision": [method.precision for method in solvers],
        "library": [method.library for method in solvers],
        "control": [method.control for method in solvers],
        "threads": [method.threads or 0 for method in solvers],
    }
    data: xarray.Dataset = xr.Dataset(
        {
            name: (("solver", "level"), columns[name], {"long_name": text, "units": unit})
            for name, (text, unit) in _COLUMNS.items()
        },
        {
            "level": np.arange(shape[1]),
            **{name: ("solver", values) for name, values in of_solver.items()},
        },
        {
            "scene": json.dumps(scene.to_dict()),
            "duration": duration,
            "reference_error_estimate_rms": float(solution.error_estimate["rms"][-1]),
            "reference_error_bound_rms": float(solution.error_bound["rms"][-1]),
            **{name: build_config()[name] for name in ("instruction_set", "version")},
        },
    )
    return data


def _measure_setting(
    method: Method, setting: float, scene: Scene, solution: Reference
) -> dict[str, float]:
    """Return the columns of one setting that are no times, and "spent", the wall time [s].

    Errors are infinite where the method is unstable.
    """
    duration = float(solution.t[-1])
    result = _solve_or_nan(method, scene, duration, setting)
    row = dict.fromkeys(("rms_error", "max_error", "frames_rms_error"), math.inf)
    row |= {"setting": setting, "spent": result.wall_time}
    if not np.isfinite(result.x).all():
        return row
    error = solution.error_of(result.x)
    frames = [error["rms"]]
    for k, t in enumerate(solution.t[1:-1].tolist(), 1):
        frames.append(solution.error_of(_solve_or_nan(method, scene, t, setting).x, k)["rms"])
    total = energy(scene, result.x, result.v, duration)["total"]
    exact = energy(scene, solution.x[-1], solution.v[-1], duration)["total"]
    row["rms_error"] = error["rms"]
    row["max_error"] = error["max"]
    row["frames_rms_error"] = float(np.max(frames))  # This is NaN if a run is unstable.
    row["force_evaluations"] = result.evaluations
    row["energy_drift"] = float(total - exact)
    return row


class _MethodResult(NamedTuple):
    """The result of `Method.solve`."""

    x: Floats  # positions at the end [m]
    v: Floats  # velocities at the end [m/s]
    evaluations: int
    wall_time: float  # [s]


def _solve_or_nan(method: Method, scene: Scene, duration: float, setting: float) -> _MethodResult:
    """Return what `method.solve` returns; NaN where it is unstable."""
    try:
        with warnings.catch_warnings():
            # The run shows whether a step above the guarantee is stable here, and what an order
            # does to the error.
            warnings.simplefilter("ignore", StabilityWarning)
            warnings.simplefilter("ignore", OrderWarning)
            warnings.simplefilter("ignore", ToleranceWarning)
            return _MethodResult(*method.solve(scene, duration, setting))
    except ArithmeticError:
        nan = np.full_like(scene.initial_position, np.nan)
        return _MethodResult(x=nan, v=nan, evaluations=0, wall_time=math.nan)


def is_on_pareto_front(rms: npt.ArrayLike, cost: npt.ArrayLike) -> npt.NDArray[np.bool_]:
    """Return where a point is on the Pareto front: none has both a smaller error and cost.

    Points whose error or cost is not finite are left out.
    """
    error = np.asarray(rms, dtype=float)
    cost = np.asarray(cost, dtype=float)
    error = np.where(np.isfinite(error) & np.isfinite(cost), error, np.inf)
    order = np.lexsort((error.ravel(), cost.ravel()))
    best = np.minimum.accumulate(np.append(np.inf, error.ravel()[order]))
    front = np.zeros(error.size, dtype=bool)
    front[order] = best[1:] < best[:-1]
    return front.reshape(error.shape)


def _list_methods(
    methods: Sequence[str | Method] | None,
    precisions: Sequence[Precision],
    threads: int | None,
    force: Force | None,
) -> list[Method]:
    """Return the integrators by name, in each precision, then the methods of others."""
    precisions = check.list_of_items("precisions", precisions, None, "names", 1)
    for k, precision in enumerate(precisions):
        check.choice(f"precisions[{k}]", precision, PRECISIONS)
    entries = list(_DEFAULT_METHODS)
    if methods is not None:
        entries = check.list_of_items("methods", methods, None, "names or methods", 1)
    integrators: list[Method] = []
    solvers: list[Method] = []
    for k, entry in enumerate(entries):
        if isinstance(entry, str):
            integrators += [
                method_of_integrator(entry, precision, threads, force) for precision in precisions
            ]
        else:
            solvers.append(check.instance(f"methods[{k}]", entry, Method))
    return integrators + solvers


def method_of_integrator(
    name: str,
    precision: Precision = "double",
    threads: int | None = None,
    force: Force | None = None,
) -> Method:
    """Return an integrator of this package; "NAME adaptive" chooses its steps by a tolerance."""
    control = "rtol" if name.endswith(" adaptive") else "dt"
    integrator = check_integrator_name(
        name.removesuffix(" adaptive"), argument="methods", fixed=control == "dt"
    )
    label = integrator
    if control == "rtol":
        names = [f"{name} adaptive" for name, method in METHODS.items() if method.adaptive]
        label = check.choice("methods", f"{integrator} adaptive", names)

    def solve(scene: Scene, duration: float, setting: float) -> tuple[Floats, Floats, int, float]:
        options: dict[str, Any] = {
            control: setting,
            "integrator": integrator,
            "precision": precision,
            "threads": threads,
            "force": force,
        }
        run = simulate(scene, duration, **options)
        return run.x[-1], run.v[-1], run.report["solution_evaluations"], run.report["wall_time"]

    return Method(label, solve, control, OWN, precision, threads)


def _settings_to_try(
    method: Method, scene: Scene, duration: float, dts: Any, rtols: Any
) -> list[float]:
    """Return the settings to try, the coarsest first."""
    name = f"{method.control}s"
    values = dts if name == "dts" else rtols
    if values is not None:
        entries = check.list_of_items(name, values, None, "numbers > 0", 1)
        numbers = {
            check.number(f"{name}[{k}]", value, minimum=0, exclusive=True)
            for k, value in enumerate(entries)
        }
        return sorted(numbers, reverse=True)
    if name == "rtols":
        return list(_RTOLS)
    integrator = method.name if method.library == OWN else "rk4"
    explicit = METHODS[integrator].explicit
    # Nothing limits an implicit step: it begins well above what an explicit method could take.
    stable = stable_dt(scene, integrator) if explicit else 0.0
    stable = stable or stable_dt(scene, "rk4")
    largest = min((_SAFETY if explicit else _IMPLICIT) * stable, duration / 4)
    return [largest / 2**k for k in range(_SETTINGS)]
