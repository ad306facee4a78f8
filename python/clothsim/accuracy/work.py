"""Errors of methods over their settings: the order that they show, and their cost."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from random import Random
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..base import Floats, check
from ..base.build import build_config
from ..base.extras import needed
from ..base.progress import ProgressBar
from ..base.services import service
from ..base.text import aligned
from ..engine.options import PRECISIONS
from ..errors import OrderWarning, StabilityWarning, UnstableError
from ..measure import energy
from ..methods.bound import stable_dt
from ..methods.integrators import METHODS, integrator_name
from ..model.scene import Scene
from ..run.simulate import simulate
from ..typing import Force, Integrator, Kernel, Precision
from .solution import Reference, reference_for

if TYPE_CHECKING:
    import xarray

OWN = "clothsim"  # library of the integrators
_COMPARED = ("semi_implicit_euler", "velocity_verlet", "rk4", "dopri5 adaptive", "dop853 adaptive")
_SAFETY = 0.95  # of the guaranteed stable step: an explicit method's coarsest
_HALVINGS = 7
_RTOLS = tuple(10.0**-k for k in range(3, 14))
_ONCE = 2.0  # s; a run that takes longer is timed once
_LONGEST = 10.0  # s; after a longer run the finer settings of its method are left out
# An error is fitted where rounding and the reference make less than this part of it ...
_FLOOR_PART = 0.1
_ASYMPTOTIC = 0.1  # ... and where it is below this part of how far the cloth has moved
_STALLED = 0.5  # slope between two steps below which smaller steps no longer help: rounding
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
    ...     x, v, steps = scene.initial_position, scene.initial_velocity, round(duration / dt)
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


@check.named
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
    """Error against cost of methods over their steps or tolerances.

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
        duration, reference error, instruction set and version.

    Examples
    --------
    >>> scene = cs.scenes.oscillator(damping=1.0)
    >>> data = cs.work_precision(scene, 0.5, ["rk4"], dts=[0.02, 0.01])
    >>> data.sizes["level"], bool(data.rms_error[0, 1] < data.rms_error[0, 0] / 10)
    (2, True)
    """
    xr: Any = needed("xarray", "work_precision")
    check.instance("scene", scene, Scene)
    duration = check.number("duration", duration, minimum=0, exclusive=True)
    windows = check.integer("windows", windows, minimum=1)
    chosen = _chosen(methods, precisions, threads, force)
    levels = [_settings(one, scene, duration, dts, rtols) for one in chosen]
    shape = len(chosen), max(map(len, levels))
    table = {name: np.full(shape, np.nan) for name in _COLUMNS}
    taken: dict[tuple[int, ...], list[float]] = {}  # times of the stable runs
    once = 0.0  # wall time of the last run
    most = duration * sum(map(len, levels)) * (1 + windows)
    with ProgressBar.of_time(progress, most, "work_precision") as bar:
        solution = reference_for(scene, duration, reference, force)
        start = energy(scene, solution.x[-1], solution.v[-1], duration)["total"]
        for m, n in np.ndindex(shape):
            # The first run is not timed: it compiles code and fills caches.
            if n < len(levels[m]) and not (n and once > _LONGEST):
                table["setting"][m, n] = levels[m][n]
                for name in ("rms_error", "max_error", "frames_rms_error"):
                    table[name][m, n] = np.inf
                x, v, evaluations, once = _solved(chosen[m], scene, duration, levels[m][n])
                if np.isfinite(x).all():
                    table["rms_error"][m, n], table["max_error"][m, n] = (
                        solution.error_of(x)[k] for k in ("rms", "max")
                    )
                    table["force_evaluations"][m, n] = evaluations
                    table["energy_drift"][m, n] = energy(scene, x, v, duration)["total"] - start
                    frames = [float(table["rms_error"][m, n])]
                    for k, t in enumerate(solution.t[1:-1].tolist(), 1):
                        at_frame = _solved(chosen[m], scene, t, levels[m][n])[0]
                        frames.append(solution.error_of(at_frame, k)["rms"])
                    table["frames_rms_error"][m, n] = np.max(frames)  # NaN if one is unstable
                    taken[m, n] = []
                bar.advance(duration)
        # Another order in each round: a slow spell of the machine affects all methods, and none
        # always follows another.
        shuffle, stable = Random(0).shuffle, [*taken]
        bar.expect(-duration * windows * (sum(map(len, levels)) - len(stable)))
        for _ in range(windows):
            shuffle(stable)
            for m, n in stable:
                if not (taken[m, n] and min(taken[m, n]) > _ONCE / duration):
                    taken[m, n].append(
                        _solved(chosen[m], scene, duration, levels[m][n])[3] / duration
                    )
                bar.advance(duration)
    for at, seconds in taken.items():
        lower, upper = np.quantile(seconds, (0.25, 0.75))
        table["wall_time"][at], table["wall_time_spread"][at] = min(seconds), upper - lower
    columns: dict[str, Any] = {**table, "pareto": pareto(table["rms_error"], table["wall_time"])}
    of_solver = {
        name: [getattr(one, name) for one in chosen] for name in ("precision", "library", "control")
    }
    of_solver |= {
        "integrator": [one.name for one in chosen],
        "threads": [one.threads or 0 for one in chosen],
    }
    found: xarray.Dataset = xr.Dataset(
        {
            k: (("solver", "level"), columns[k], {"long_name": text, "units": unit})
            for k, (text, unit) in _COLUMNS.items()
        },
        {
            "solver": [f"{one.name} {one.precision}" for one in chosen],
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
    return found


def _solved(
    method: Method, scene: Scene, duration: float, setting: float
) -> tuple[Floats, Floats, int, float]:
    """What `method.solve` returns; NaN where it is unstable."""
    try:
        with warnings.catch_warnings():
            # The run shows whether a step above the guarantee is stable here, and what an order
            # does to the error.
            warnings.simplefilter("ignore", StabilityWarning)
            warnings.simplefilter("ignore", OrderWarning)
            return method.solve(scene, duration, setting)
    except ArithmeticError:
        nowhere = np.full_like(scene.initial_position, np.nan)
        return nowhere, nowhere, 0, math.nan


def pareto(rms: npt.ArrayLike, cost: npt.ArrayLike) -> npt.NDArray[np.bool_]:
    """True at the points of the Pareto front: no other point has both a smaller error and a smaller
    cost.

    Points whose error or cost is not finite are left out.
    """
    error, cost = np.asarray(rms, dtype=float), np.asarray(cost, dtype=float)
    error = np.where(np.isfinite(error) & np.isfinite(cost), error, np.inf)
    order = np.lexsort((error.ravel(), cost.ravel()))
    best = np.minimum.accumulate(np.append(np.inf, error.ravel()[order]))
    front = np.zeros(error.size, dtype=bool)
    front[order] = best[1:] < best[:-1]
    return front.reshape(error.shape)


def _chosen(
    methods: Sequence[str | Method] | None,
    precisions: Sequence[Precision],
    threads: int | None,
    force: Force | None,
) -> list[Method]:
    """The integrators that are given by name, then the methods of others."""
    precisions = check.items("precisions", precisions, None, "names", 1)
    for k, precision in enumerate(precisions):
        check.choice(f"precisions[{k}]", precision, PRECISIONS)
    given = (
        list(_COMPARED)
        if methods is None
        else check.items("methods", methods, None, "names or methods", 1)
    )
    named = [
        own_method(one, precision, threads, force)
        for one in given
        if isinstance(one, str)
        for precision in precisions
    ]
    return named + [
        check.instance(f"methods[{k}]", one, Method)
        for k, one in enumerate(given)
        if not isinstance(one, str)
    ]


def own_method(
    name: str,
    precision: Precision = "double",
    threads: int | None = None,
    force: Force | None = None,
) -> Method:
    """An integrator of this package; "NAME adaptive" chooses its steps by a tolerance."""
    control = "rtol" if name.endswith(" adaptive") else "dt"
    label = integrator = integrator_name(
        name.removesuffix(" adaptive"), argument="methods", fixed=control == "dt"
    )
    if control == "rtol":
        adaptive = [f"{one} adaptive" for one, about in METHODS.items() if about.adaptive]
        label = check.choice("methods", f"{integrator} adaptive", adaptive)

    def solve(scene: Scene, duration: float, setting: float) -> tuple[Floats, Floats, int, float]:
        by: dict[str, Any] = {
            control: setting,
            "integrator": integrator,
            "precision": precision,
            "threads": threads,
            "force": force,
        }
        run = simulate(scene, duration, **by)
        return run.x[-1], run.v[-1], run.report["solution_evaluations"], run.report["wall_time"]

    return Method(label, solve, control, OWN, precision, threads)


def _settings(method: Method, scene: Scene, duration: float, dts: Any, rtols: Any) -> list[float]:
    """The settings to try, the coarsest first."""
    name, given = ("dts", dts) if method.control == "dt" else ("rtols", rtols)
    if given is not None:
        given = check.items(name, given, None, "numbers > 0", 1)
        values = {
            check.number(f"{name}[{k}]", value, minimum=0, exclusive=True)
            for k, value in enumerate(given)
        }
        return sorted(values, reverse=True)
    if name == "rtols":
        return list(_RTOLS)
    integrator = method.name if method.library == OWN else "rk4"
    explicit = METHODS[integrator].explicit
    # A step that nothing limits: from well above what an explicit method could take.
    largest = (stable_dt(scene, integrator) if explicit else 0.0) or stable_dt(scene, "rk4")
    largest = min(_SAFETY * largest if explicit else 8 * largest, duration / 4)
    return [largest / 2**k for k in range(_HALVINGS)]


@dataclass(frozen=True, eq=False, repr=False)
class Convergence:
    """Errors of a method over time steps, the result of `convergence`.

    Attributes
    ----------
    integrator, precision : str
    dt : numpy.ndarray
        Time steps as taken [s], decreasing, shape (steps,).
    steps : numpy.ndarray
        Number of steps of each run, shape (steps,).
    rms, max : numpy.ndarray
        Distances of the mass points from the reference at the end [m], shape (steps,); infinite
        where the run was unstable.
    order : float
        Slope of log rms over log dt, a least-squares fit of the steps in `fitted`. NaN if `fitted`
        has fewer than two steps.
    fitted : numpy.ndarray
        True where the method causes the error, shape (steps,). The error is then at least ten times
        the `floor`, and below a tenth of the rms distance that the cloth has moved.
    floor : numpy.ndarray
        Smallest error that the comparison can show [m], shape (steps,), the largest of three: the
        reference's error estimate; the least error from where smaller steps no longer help (slope <
        1/2); and eps/2 times the cloth's size, in double times the root of the number of steps. In
        double the rounding of the positions adds up like a random walk; "single" compensates it.
    reference : Reference
    """

    integrator: str
    precision: Precision
    dt: Floats
    steps: npt.NDArray[np.int64]
    rms: Floats
    max: Floats
    order: float
    fitted: npt.NDArray[np.bool_]
    floor: Floats
    reference: Reference

    def plot(self, ax: Any = None) -> Any:
        """Draw errors, order and floor on axes, which come back: hollow is not fitted, a cross
        unstable.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Default: those of a new figure.

        Examples
        --------
        >>> cs.convergence(cs.scenes.oscillator(), 0.1, [0.01, 0.005]).plot().get_xlabel()
        'time step dt [s]'
        """
        return service("draw_convergence")(self, ax)

    def __str__(self) -> str:
        fitted = f"order {self.order:.2f} (* fitted)"
        if math.isnan(self.order):
            fitted = (
                "no order: fewer than two errors are well above the floor, "
                f"{self.floor.min():.1e} m"
            )
        orders = ["", *(f"{order:.2f}" for order in _slopes(self.dt, self.rms))]
        rows = [
            (f"{dt:.4g}", f"{rms:.2e}", f"{largest:.2e}", order, "*" * bool(fit))
            for dt, rms, largest, order, fit in zip(
                self.dt, self.rms, self.max, orders, self.fitted, strict=True
            )
        ]
        table = aligned([("dt [s]", "rms [m]", "max [m]", "order", ""), *rows], left=())
        return f"{self.integrator}, {self.precision}: {fitted}\n{table}"

    __repr__ = __str__


@check.named
def convergence(
    scene: Scene,
    duration: float,
    dts: Sequence[float],
    integrator: Integrator = "rk4",
    precision: Precision = "double",
    *,
    reference: Reference | None = None,
    threads: int | None = None,
    kernel: Kernel = "auto",
    force: Force | None = None,
) -> Convergence:
    """Errors against the trusted solution, and the order that they show.

    Parameters
    ----------
    scene, duration
        As for `reference`.
    dts : sequence of float
        Time steps [s], > 0, at least one. Each step is shortened until it divides the duration, so
        that all steps of a run are equal.
    integrator : str, default "rk4"
        A name of `clothsim.integrators`; an adaptive one runs at the fixed steps given.
    precision : {"double", "single"}, default "double"
    reference : Reference, optional
        Solution to measure by; its last frame is at `duration`. Default: `reference(scene,
        duration, force=force)`.
    threads, kernel, force
        As for `simulate`.

    Returns
    -------
    Convergence
        It prints as a table.

    Examples
    --------
    >>> scene = cs.scenes.oscillator(damping=2.0)
    >>> found = cs.convergence(scene, 0.5, [0.01, 0.005, 0.0025])
    >>> round(found.order, 1), found.steps.tolist()
    (4.0, [50, 100, 200])
    """
    check.instance("scene", scene, Scene)
    duration = check.number("duration", duration, minimum=0, exclusive=True)
    integrator = integrator_name(integrator, fixed=True)
    check.choice("precision", precision, ("double", "single"))
    listed = check.items("dts", dts, None, "time steps > 0", 1)
    given = [
        check.number(f"dts[{k}]", dt, minimum=0, exclusive=True) for k, dt in enumerate(listed)
    ]
    if not duration / min(given) <= check.INT64_MAX:
        raise ValueError(f"dts must be above duration / {check.INT64_MAX:.3g}, got {min(given):g}")
    steps = np.array(sorted({max(1, math.ceil(duration / dt - 1e-9)) for dt in given}))
    solution = reference_for(scene, duration, reference, force)
    options: dict[str, Any] = {"precision": precision, "threads": threads, "kernel": kernel}
    dt, errors = duration / steps, []
    for one in dt.tolist():
        try:
            end = simulate(scene, duration, one, integrator, force=force, **options).x[-1]
            errors.append([solution.error_of(end)[name] for name in ("rms", "max")])
        except UnstableError:
            errors.append([math.inf, math.inf])
    rms, largest = np.array(errors).T
    stalled = np.flatnonzero(_slopes(dt, rms) < _STALLED)
    known = max(
        float(solution.error_estimate["rms"][-1]),
        float(rms[stalled[0] :].min()) if stalled.size else 0.0,
    )
    single = precision == "single"
    digits = (
        np.finfo(np.float32 if single else np.float64).eps / 2 * np.sqrt(np.where(single, 1, steps))
    )
    floor = np.maximum(known, max(scene.cloth.size) * digits)
    moved = solution.error_of(scene.initial_position)["rms"]
    fitted = (rms >= floor / _FLOOR_PART) & (rms <= _ASYMPTOTIC * moved)
    order = math.nan
    if fitted.sum() > 1:
        order = float(np.polyfit(np.log(dt[fitted]), np.log(rms[fitted]), 1)[0])
    return Convergence(
        integrator, precision, dt, steps, rms, largest, order, fitted, floor, solution
    )


def _slopes(dt: Floats, rms: Floats) -> Floats:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.diff(np.log(rms)) / np.diff(np.log(dt))
