"""Derivatives of a motion with respect to parameters of its scene, and parameters from a measured
motion.

Derivatives: runs that differ in a parameter are the members of one batch, with the same steps and
method, so their differences are as smooth as the solution. A central difference and one more value
give a difference of third order, and the correction from second order bounds its error.

Fit: least squares over the logarithms of positive parameters. A start that is far off gives a
motion that is out of phase with the data, where least squares finds a wrong minimum. So the first
times are fitted first, and then twice as many, until all are. While few times are fitted, each
parameter is held near its start by a weak prior.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..base import Floats, check
from ..base.extras import needed
from ..base.text import aligned
from ..methods.bound import stable_dt
from ..model.fields import change_scene, check_name, units
from ..model.scene import Scene, stops_of
from ..model.sphere import Plane, Sphere
from ..run.result import Run
from ..run.simulate import simulate
from .solution import METHOD, ORDER, Motion, motion

if TYPE_CHECKING:
    import xarray

# Of a parameter over its scale: rounding and truncation are then below 1e-9 of most derivatives.
_STEP = 7e-5
_PARTED = 1e-3  # error over the largest derivative so far, from which on neither is believed
_VISIBLE = 1e-4  # of the cloth's size: the least derivative of which that part is asked
_ROUNDING = 2e-14  # of positions, over the cloth's size
_LONGEST = 0.9  # of the guaranteed stable step
_FINEST = 64.0  # times as many steps, at most
_DIGITS = 1e-11  # error of positions over the cloth's size that `sensitivity` asks for
_FEWEST = 4  # times of the first stage
_PRIOR = 3.0  # width of the prior, in logarithms or scales
_WIDEST = 1e3  # factor, or scales, that a parameter without bounds may move
_EDGE = 1e-3  # of logarithms or scales, from a bound
_STARTS = 8  # further starts where a minimum does not explain the data
# Singular value over the largest, of columns of length 1: below, the data cannot tell parameters
# apart.
_SINGULAR = 1e-5
_PART = 1e-2  # of a parameter in a direction that is not determined
_SIGMAS = 5.0  # from which on a chi-square, or a correlation of residuals, is no chance
_CORRELATED = 0.2  # of residuals at neighbouring times


class Parameter(NamedTuple):
    """A number of a scene that can vary continuously."""

    name: str  # as the caller wrote it
    field: str  # as in a sweep
    value: float
    scale: float  # a change of it changes the motion visibly
    least: float
    most: float

    @property
    def side(self) -> int:
        """The only side to which it can vary, else 0."""
        reach = 3 * _STEP * self.scale
        return int(self.value - reach <= self.least) - int(self.value + reach >= self.most)


def _numbers(scene: Scene) -> dict[str, list[float]]:
    """The numbers of a scene that can vary continuously, by the names of a sweep."""
    cloth = scene.cloth
    found = {"mass": [float(cloth.mass_per_point.sum())], "drag": [cloth.drag]}
    for kind, families in (
        ("stiffness", cloth.family_stiffness),
        ("damping", cloth.family_damping),
    ):
        found |= {
            kind: [*families.values()],
            **{f"{kind}_{family}": [value] for family, value in families.items()},
        }
    vectors = {
        "gravity": [scene.gravity],
        **{f"pin{k}": [scene.initial_position[pin]] for k, pin in enumerate(cloth.pins)},
    }
    indexed = {f"plane{k}": one for k, one in enumerate(scene.spheres) if isinstance(one, Plane)}
    for prefix, planes in {
        "plane": [*indexed.values()],
        **{name: [plane] for name, plane in indexed.items()},
    }.items():
        for part in ("point", "normal"):
            vectors[f"{prefix}_{part}"] = [getattr(plane, part) for plane in planes]
        for part in ("restitution", "friction"):
            found[f"{prefix}_{part}"] = [getattr(plane, part) for plane in planes]
    for prefix, spheres in {
        "sphere": scene.spheres,
        **{f"sphere{k}": [one] for k, one in enumerate(scene.spheres)},
    }.items():
        parts = ["restitution", "friction"]
        if all(isinstance(one, Sphere) for one in spheres):  # no plane
            vectors[f"{prefix}_center"] = [sphere.center for sphere in spheres]
            parts.append("radius")
        for part in parts:
            found[f"{prefix}_{part}"] = [getattr(sphere, part) for sphere in spheres]
    found |= {
        f"{name}_{c}": [float(v[k]) for v in some]
        for name, some in vectors.items()
        for k, c in enumerate("xyz")
    }
    return {name: values for name, values in found.items() if values}


def parameters_of(scene: Scene, names: Any, argument: str) -> list[Parameter]:
    """The named parameters with their values in `scene`."""
    if isinstance(names, str) or not isinstance(names, (Sequence, Mapping)) or not names:
        raise TypeError(
            f"{argument} must be a sequence of names such as ('stiffness', 'drag'), got "
            f"{check.shown(names)}"
        )
    known, found = _numbers(scene), []
    scales = {"m": max(scene.cloth.size), "m/s^2": 9.80665, "1": 1.0}
    scales["N s/m"] = float(scene.cloth.mass_per_point.min())  # a drag that acts within a second
    for name in names:
        field = check_name(name.replace(".", "_") if isinstance(name, str) else name)
        if field not in known:
            raise ValueError(
                f"{argument} must name numbers of the scene, got {name!r}; this one has "
                f"{', '.join(known)}"
            )
        value = known[field][0]
        if any(other != value for other in known[field]):
            raise ValueError(
                f"{argument} must name single numbers, got {name!r}, here {known[field]}: "
                "name its parts"
            )
        least = -math.inf if field[-2:] in ("_x", "_y", "_z") else 0.0
        most = 1.0 if field.endswith("restitution") else math.inf
        found.append(
            Parameter(
                name, field, value, max(abs(value), scales.get(units(field), 0.0)), least, most
            )
        )
    if len({one.field for one in found}) < len(found):
        raise ValueError(f"{argument} must name each parameter once, got {list(names)}")
    return found


def changed(
    scene: Scene, parameters: Sequence[Parameter], values: Sequence[float] | Floats
) -> Scene:
    """A copy of `scene` with new values of the parameters."""
    named: dict[str, Any] = {p.field: float(value) for p, value in zip(parameters, values)}
    if "mass" in named:  # the masses of the points keep their ratios
        named["mass"] *= scene.cloth.mass_per_point / scene.cloth.mass_per_point.sum()
    return change_scene(scene, named)


def checked_times(times: npt.ArrayLike) -> Floats:
    """Times at which positions are asked for [s]."""
    accepted = "increasing times >= 0 [s] of which one is > 0"
    given = np.atleast_1d(check.array("times", times, what=accepted))
    if given.ndim > 1 or not given.any():
        raise ValueError(f"times must be {accepted}, got {check.shown(times)}")
    check.check_all("times", given, np.diff(given, prepend=-1e-300) > 0, accepted)
    return given


class Clock:
    """The times of all steps: every run of a comparison takes the same."""

    def __init__(self, scene: Scene, times: Floats, rtol: float) -> None:
        """With steps so short that positions should err by at most `rtol` of the cloth's size."""
        self.times, self.size, self.finer = times, max(scene.cloth.size), 1.0
        self.stops = sorted({*times.tolist(), *stops_of(scene, 0.0, float(times[-1]))} - {0.0})
        coarse = self.counts(scene)
        x, y = (self.run([scene], counts) for counts in (coarse + -(-coarse // 4), coarse))
        off = np.abs(x.x - y.x)[:, times <= min(x.known, y.known)].max(initial=0.0) / (
            rtol * self.size
        )
        # The coarse steps are longer by a fourth, which is not counted on.
        self.finer = float(np.clip(off ** (1 / ORDER), 1.0, _FINEST)) * 1.25

    def counts(self, scene: Scene) -> npt.NDArray[np.int64]:
        """Steps up to each stop."""
        longest = _LONGEST * stable_dt(scene, METHOD) / self.finer
        return np.maximum(np.ceil(np.diff(self.stops, prepend=0.0) / longest), 1).astype(np.int64)

    def run(self, scenes: Sequence[Scene], counts: npt.NDArray[np.int64]) -> Motion:
        """The scenes at `times`."""
        found = motion(scenes, self.stops, counts.tolist())
        x = found.x[:, np.searchsorted(self.stops, self.times)]
        if self.times[0] == 0:
            x[:, 0] = [scene.initial_position for scene in scenes]
        return found._replace(x=x)


def derivatives(
    scene: Scene, parameters: Sequence[Parameter], clock: Clock, most: int = 3
) -> tuple[Motion, Floats, Floats]:
    """The motion of `scene`, its changes per scale of each parameter, and the last term of each
    change.

    Each is a difference of three positions, for the values -1, 0 and 1 of the parameter or, at a
    bound, 0, 1 and 2. With `most` = 4 values the term of third order corrects it.
    """
    places = [
        np.arange(most) * one.side if one.side else np.arange(-1, most - 1) for one in parameters
    ]
    members = [
        changed(scene, [p], [p.value + k * _STEP * p.scale])
        for p, some in zip(parameters, places)
        for k in some
        if k
    ]
    found = clock.run([scene, *members], clock.counts(scene))
    change = np.empty((len(parameters), *found.x.shape[1:]))
    term, moved = np.zeros_like(change), iter(found.x[1:])
    for n, (one, some) in enumerate(zip(parameters, places)):
        x = [next(moved) if k else found.x[0] for k in some]
        change[n] = (
            (4 * (x[1] - x[0]) - (x[2] - x[0])) / 2 * one.side if one.side else (x[2] - x[0]) / 2
        )
        if most > 3:
            term[n] = (x[3] - x[0] - 3 * (x[2] - x[1])) * (one.side / 3 or -1 / 6)
    return found._replace(x=found.x[0]), (change + term) / _STEP, term / _STEP


def known_derivatives(
    scene: Scene, parameters: Sequence[Parameter], clock: Clock
) -> tuple[Floats, Floats, Floats, Floats, list[str]]:
    """Positions, derivatives per scale of each parameter, their errors, the times until which they
    are known, and why.
    """
    found, change, term = derivatives(scene, parameters, clock, 4)
    largest = np.fmax.accumulate(np.abs(change).max(axis=(2, 3, 4)), axis=1)
    error = np.abs(term).max(axis=(2, 3, 4)) + _ROUNDING * clock.size / _STEP + _DIGITS * largest
    bad = np.isnan(error) | (clock.times > found.known)
    parted = ~bad & (error > _PARTED * (largest + _VISIBLE * clock.size))
    reasons = [
        f"differences of two orders disagree from {clock.times[one.argmax()]:.4g} s on: "
        "motions part there"
        if one.any()
        else found.reason * bool(late.any())
        for one, late in zip(parted, bad)
    ]
    bad |= np.logical_or.accumulate(parted, axis=1)
    change[bad], error[bad] = np.nan, np.nan
    return found.x, change, error, np.where(bad, 0.0, clock.times).max(axis=1), reasons


@check.named
def sensitivity(scene: Scene, times: npt.ArrayLike, of: Sequence[str]) -> xarray.Dataset:
    """How each position changes with each parameter, and how far that is known, at the cost of
    three runs a parameter.

    Parameters
    ----------
    scene : Scene
    times : array_like
        Times at which the derivatives are wanted [s], increasing, >= 0.
    of : sequence of str
        Names as in `sweep`: "mass" (the total; the ratios of the points stay), "stiffness",
        "damping", those of a family, such as "stiffness_shear" or "stiffness.shear", "drag",
        "gravity_y", "pin0_x" (the place of a pin), and of spheres "sphere_radius",
        "sphere0_center_x", "sphere_friction", "sphere_restitution".

    Returns
    -------
    xarray.Dataset
        "dx", derivatives of the positions at (parameter, time, row, column, component) in metres
        per unit of the parameter; "error", their error at (parameter, time), the largest over the
        points: estimated by a difference of lower order, and usually far above the true error; "x",
        the positions [m]; "value" and "unit" of the parameters; "known_until" [s], after which
        derivatives are NaN, for example because of a contact, with the "reason".

    Examples
    --------
    The exact derivative by the stiffness is -0.1 sin(w t) t / (2 w), with w = 10 / s:

    >>> import math
    >>> data = cs.sensitivity(cs.scenes.oscillator(stiffness=100.0), [0.5, 1.0], of=["stiffness"])
    >>> found = data.dx.sel(parameter="stiffness", time=1.0, row=0, column=1, component="x").item()
    >>> abs(found + 0.1 * math.sin(10.0) * 1.0 / 20.0) < 1e-12
    True
    """
    xr: Any = needed("xarray", "sensitivity")
    check.instance("scene", scene, Scene)
    parameters = parameters_of(scene, of, "of")
    clock = Clock(scene, checked_times(times), _DIGITS)
    x, change, error, until, reasons = known_derivatives(scene, parameters, clock)
    scales = np.array([one.scale for one in parameters])
    place = ("time", "row", "column", "component")
    data: xarray.Dataset = xr.Dataset(
        {
            "dx": (("parameter", *place), change / scales.reshape(-1, 1, 1, 1, 1)),
            "error": (("parameter", "time"), error / scales[:, None]),
            "x": (place, x, {"units": "m"}),
            "value": ("parameter", [one.value for one in parameters]),
            "unit": ("parameter", [units(one.field) for one in parameters]),
            "known_until": ("parameter", until, {"units": "s"}),
            "reason": ("parameter", reasons),
        },
        {
            "parameter": [p.name for p in parameters],
            "time": ("time", clock.times, {"units": "s"}),
            "component": [*"xyz"],
        },
    )
    return data


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """Parameters that were fitted to a motion, the result of `fit`.

    Attributes
    ----------
    scene : Scene
        The scene at the minimum; a parameter that is not determined has an arbitrary value.
    values, errors : dict
        Parameters by name, and their standard deviations; NaN where the data does not determine
        them.
    covariance : numpy.ndarray
        Covariance of the values, in their order; NaN as above.
    residuals : numpy.ndarray
        Measured less fitted positions [m], of the shape of the data; NaN where nothing was
        measured.
    run : Run
        The run of `scene`, with frames at `times`.
    times, positions : numpy.ndarray
        The data [s, m].
    report : dict
        "reason": "", or why something is NaN; "reasons" by parameter; "sigma" [m], as given or
        estimated; "chi_square" per degree of freedom (NaN if sigma is estimated); "correlation" of
        residuals at neighbouring times; "condition" of the Jacobian with columns of length 1;
        "evaluations", "jacobians", "starts", "wall_time" [s].
    """

    scene: Scene
    values: dict[str, float]
    errors: dict[str, float]
    covariance: Floats
    residuals: Floats
    run: Run
    times: Floats
    positions: Floats
    report: dict[str, Any]

    def __repr__(self) -> str:
        reasons = self.report["reasons"]
        rows = [
            (n, f"{v:.6g}", f"+- {self.errors[n]:.2g}", reasons[n]) for n, v in self.values.items()
        ]
        text = aligned([("parameter", "value", "one sigma", ""), *rows], left=(0, 3))
        return text + f"\n{self.report['reason']}".rstrip()

    def plot(self, ax: Any = None) -> Any:
        """Draw data and fit, residuals, and correlations of the parameters; the three axes come
        back.

        Parameters
        ----------
        ax : sequence of 3 matplotlib.axes.Axes, optional
            Default: those of a new figure.

        Examples
        --------
        >>> motion = cs.simulate(cs.scenes.oscillator(), 0.2, rtol=1e-6, fps=50)
        >>> guess = cs.scenes.oscillator(stiffness=90.0)
        >>> len(cs.fit(guess, motion.t, motion.x, over=["stiffness"]).plot())
        3
        """
        from ..viewing.plots import draw_fit

        return draw_fit(self, ax)


class _Problem:
    """Residuals in sigmas and their Jacobian, as functions of coordinates that are 0 at the start:
    logarithms of positive parameters, else their changes.
    """

    def __init__(
        self, scene: Scene, names: Sequence[str], times: Floats, data: Floats, measured: Any
    ) -> None:
        self.scene, self.names, self.times = scene, names, times
        self.data, self.measured = (
            data,
            measured,
        )  # (times, rows, columns, 3); whether a number counts
        self.parameters = parameters_of(scene, names, "over")
        self.start, self.scales, *ends = np.array([one[2:] for one in self.parameters]).T
        self.ends, self.evaluations, self.jacobians = np.array(ends), 0, 0
        self.logarithmic = (self.ends[0] == 0) & (self.start > 0)

    def values(self, u: Floats) -> Floats:
        values: Floats = np.where(
            self.logarithmic,
            self.start * np.exp(u * self.logarithmic),
            self.start + u * self.scales,
        )
        return values

    def slopes(self, u: Floats) -> Floats:
        """Derivatives of the values by the coordinates."""
        slopes: Floats = np.where(self.logarithmic, self.values(u), self.scales)
        return slopes

    def bounds(self, over: Any) -> Floats:
        """Least and largest coordinates."""
        ends = self.ends.copy()
        for k, name in enumerate(self.names if isinstance(over, Mapping) else ()):
            argument, value, (low, high) = f"over[{name!r}]", self.start[k], ends[:, k]
            given = [
                check.number(argument, n)
                for n in check.items(argument, over[name], 2, "numbers (least, most)")
            ]
            if not (low <= given[0] <= value <= given[1] <= high and given[0] < given[1]):
                accepted = f"(least, most) from {low:g} to {high:g} around {value:g}"
                raise ValueError(f"{argument} must be {accepted}, got {tuple(given)}")
            ends[:, k] = given
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.where(
                self.logarithmic, np.log(ends / self.start), (ends - self.start) / self.scales
            )
        far = np.where(self.logarithmic, math.log(_WIDEST), _WIDEST)
        return np.asarray(np.clip(u, -far, far))

    def at(self, u: Floats) -> Scene:
        return changed(self.scene, self.parameters, self.values(u))

    def columns(self, change: Floats, parameters: Sequence[Parameter], u: Floats) -> Floats:
        """Changes per scale of each parameter as columns of a Jacobian [m per coordinate]; 0 where
        a run failed.
        """
        slopes = self.slopes(u) / [one.scale for one in parameters]
        return np.nan_to_num(change[:, self.measured[: change.shape[1]]].T * slopes)

    def minimise(
        self, u: Floats, bounds: Floats, sigma: float, rtol: float, least_squares: Any
    ) -> Any:
        """The minimum over all times that is found from `u` by way of the first times."""
        total = len(self.times)
        counts = [-(-total // 2**k) for k in range(int(math.log2(total)), 0, -1)]
        for count in [*(n for n in counts if n >= _FEWEST), total]:
            found = self._minimum(
                u, bounds, sigma, Clock(self.at(u), self.times[:count], rtol), least_squares
            )
            u = found.x
        return found

    def _minimum(
        self, middle: Floats, bounds: Floats, sigma: float, clock: Clock, least_squares: Any
    ) -> Any:
        """The minimum over the times of `clock`, near `middle` unless these are all times."""
        n = len(clock.times)
        held, data, measured = (n < len(self.times)) / _PRIOR, self.data[:n], self.measured[:n]

        def residuals(u: Floats) -> Floats:
            self.evaluations += 1
            scene = self.at(u)
            off = (clock.run([scene], clock.counts(scene)).x[0] - data)[measured]
            return np.append(np.nan_to_num(off, nan=clock.size) / sigma, (u - middle) * held)

        def jacobian(u: Floats) -> Floats:
            self.jacobians += 1
            parameters = parameters_of(scene := self.at(u), self.names, "over")
            found = self.columns(derivatives(scene, parameters, clock)[1], parameters, u)
            return np.append(found / sigma, np.eye(len(u)) * held, axis=0)

        digits, most = (
            dict.fromkeys(("ftol", "xtol", "gtol"), 1e-4 if held else 1e-10),
            20 if held else 60,
        )
        start = np.clip(middle, bounds[0] + _EDGE / 2, bounds[1] - _EDGE / 2)
        return least_squares(residuals, start, jacobian, (*bounds,), max_nfev=most, **digits)


@check.named
def fit(
    scene: Scene,
    times: npt.ArrayLike,
    positions: npt.ArrayLike,
    over: Sequence[str] | Mapping[str, tuple[float, float]],
    points: Sequence[tuple[int, int]] | None = None,
    sigma: float | None = None,
    rtol: float = 1e-6,
) -> Fit:
    """Fit parameters of a scene to a measured motion, with the error of every number.

    Parameters
    ----------
    scene : Scene
        Initial state of the motion, and starting values of the parameters, which may be off by a
        factor of ten.
    times : array_like
        Times of the measurement [s], increasing, >= 0; the scene's initial state is at time 0.
    positions : array_like
        Measured positions [m], shape (times, rows, columns, 3), or (times, points, 3) with
        `points`; NaN where nothing was measured. Pinned points do not count, unless the place of a
        pin is fitted.
    over : sequence of str, or mapping of str to (least, most)
        Names as in `sensitivity`; a mapping gives bounds too.
    points : sequence of (row, column), optional
        The measured points. Default: all.
    sigma : float, optional
        Standard deviation of each measured number [m], > 0. Default: estimated from the residuals.
    rtol : float, default 1e-6
        Error of the simulated positions over the size of the cloth.

    Returns
    -------
    Fit
        A parameter that the data does not determine is NaN, with a reason. After a contact all are
        NaN. Errors are NaN if the residuals are not noise: then the model does not describe the
        measured motion.

    Examples
    --------
    >>> import numpy as np
    >>> times = np.linspace(0.05, 0.5, 10)
    >>> scene = cs.scenes.hanging(shape=(4, 4))
    >>> tracked = cs.simulate(scene, 0.5, rtol=1e-8, times=times).x[1:, -1:, -1]
    >>> noise = np.random.default_rng(0).normal(0, 1e-4, tracked.shape)
    >>> guess = cs.scenes.hanging(shape=(4, 4), stiffness=300.0)
    >>> found = cs.fit(guess, times, tracked + noise, over=["stiffness"], points=[(-1, -1)])
    >>> abs(found.values["stiffness"] - 1000) < 3 * found.errors["stiffness"]
    True
    """
    least_squares = needed("scipy.optimize", "fit", "fit").least_squares
    check.instance("scene", scene, Scene)
    names = [one.name for one in parameters_of(scene, over, "over")]
    times = checked_times(times)
    given, place = _checked_data(scene, times, positions, points)
    if sigma is not None:
        sigma = check.number("sigma", sigma, minimum=1e-100)
    rtol = check.number("rtol", rtol, minimum=0, exclusive=True)
    data = np.full((len(times), *scene.cloth.shape, 3), np.nan)
    data[:, place[0], place[1]] = given
    measured = np.isfinite(data)
    if not any(name.startswith("pin") for name in names):
        measured &= ~scene.cloth.pinned[:, :, None]
    count = int(measured.sum())
    if count <= len(names):
        raise ValueError(
            "positions must have more numbers at free points than over has names, "
            f"{len(names)}, got {count}"
        )
    problem = _Problem(scene, names, times, data, measured)
    bounds = problem.bounds(over)
    least = rtol * max(scene.cloth.size)  # of what residuals can show
    moved = float(np.sqrt(np.mean((data - scene.initial_position)[measured] ** 2)))
    unit = sigma or max(1e-3 * moved, least)
    random, u, starts, misfit = np.random.default_rng(0), np.zeros(len(names)), 0, "not tried"
    best: Any = None
    begin = perf_counter()
    while misfit and starts <= _STARTS:
        found = problem.minimise(u, bounds, unit, rtol, least_squares)
        best = found if best is None or found.cost < best.cost else best
        quality, misfit = _judged(best, measured, len(names), sigma, unit, least)
        u, starts = (
            random.uniform(-math.log(10), math.log(10), len(names)) * problem.logarithmic,
            starts + 1,
        )
    parameters = parameters_of(scene := problem.at(best.x), names, "over")
    _, change, _, _, ended = known_derivatives(scene, parameters, Clock(scene, times, rtol))
    run = simulate(scene, float(times[-1]), rtol=rtol, times=times)
    wall_time = perf_counter() - begin
    jacobian = problem.columns(change, parameters, best.x) / quality["sigma"]
    covariance, condition, reasons = _determined(jacobian, ended, best.x, bounds)
    slopes = problem.slopes(best.x)
    values = np.where([bool(reason) for reason in reasons], np.nan, problem.values(best.x))
    covariance = covariance * np.outer(slopes, slopes) + 0 * np.add.outer(values, values)
    groups = {
        one: [name for name, reason in zip(names, reasons) if reason == one]
        for one in reasons
        if one
    }
    told = [f"{', '.join(group)}: {one}" for one, group in groups.items()]
    if any(ended):
        told = [f"{next(filter(None, ended))}: give only the times before"]
    elif misfit:
        told.append(
            f"{misfit}: no such cloth moves like this, or the noise is not independent; "
            "errors have no meaning"
        )
        covariance = np.full_like(covariance, np.nan)
    report = {
        "reason": "; ".join(told),
        "reasons": dict(zip(names, reasons)),
        **quality,
        "condition": condition,
    }
    spent = {"evaluations": problem.evaluations, "jacobians": problem.jacobians}
    report |= {**spent, "starts": starts, "wall_time": wall_time}
    residuals = given - run.x[np.searchsorted(run.t, times)][:, place[0], place[1]]
    errors = dict(zip(names, np.sqrt(np.diag(covariance)).tolist()))
    return Fit(
        scene,
        dict(zip(names, values.tolist())),
        errors,
        covariance,
        residuals,
        run,
        times,
        given,
        report,
    )


def _checked_data(scene: Scene, times: Floats, values: Any, points: Any) -> tuple[Floats, Any]:
    """Measured positions, and the rows and columns of their points."""
    sides, place = scene.cloth.shape, np.indices(scene.cloth.shape)
    if points is not None:
        pairs = []
        for k, pair in enumerate(check.items("points", points, None, "(row, column)", 1)):
            both = zip(check.items(f"points[{k}]", pair, 2, "integers (row, column)"), sides)
            pairs.append(
                [check.integer(f"points[{k}]", i, minimum=-n, maximum=n - 1) % n for i, n in both]
            )
        place = np.array(pairs).T
        if len(np.unique(place, axis=1).T) < len(pairs):
            raise ValueError(f"points must name each point once, got {list(points)}")
    shape = (len(times), *place[0].shape, 3)
    accepted = f"an array of shape {shape} of numbers, NaN where nothing was measured"
    given = check.as_array("positions", values, accepted)
    if given.shape != shape:
        raise ValueError(f"positions must be {accepted}, got shape {given.shape}")
    given = given.astype(np.float64)
    check.check_all("positions", given, ~np.isinf(given), accepted)
    return given, place


def _judged(
    found: Any, measured: Any, parameters: int, sigma: float | None, unit: float, least: float
) -> tuple[dict[str, float], str]:
    """Sigma, chi-square per degree of freedom, correlation of neighbouring residuals; and why
    residuals are no noise.
    """
    free = measured.sum() - parameters
    whole = np.full(measured.shape, np.nan)
    whole[measured] = found.fun[: measured.sum()]
    pairs = whole[1:] * whole[:-1]
    number = int(np.isfinite(pairs).sum())
    correlation = (
        float(np.nansum(pairs) / number / max(np.nanmean(whole**2), 1e-300)) if number else math.nan
    )
    chi, reason = 2 * float(found.cost) / free, ""
    if sigma is not None:
        if chi > 1 + _SIGMAS * math.sqrt(2 / free):
            reason = f"chi-square is {chi:.3g} per degree of freedom"
        return {"sigma": sigma, "chi_square": chi, "correlation": correlation}, reason
    noise = unit * math.sqrt(chi)
    if noise > 10 * least and correlation > max(_CORRELATED, _SIGMAS / math.sqrt(max(number, 1))):
        reason = f"residuals at neighbouring times have a correlation of {correlation:.2f}"
    return {"sigma": max(noise, least), "chi_square": math.nan, "correlation": correlation}, reason


def _determined(
    jacobian: Floats, ended: list[str], u: Floats, bounds: Floats
) -> tuple[Floats, float, list[str]]:
    """Covariance of the coordinates, condition of the scaled Jacobian, and why a parameter is not
    determined.
    """
    lengths = np.linalg.norm(jacobian, axis=0)
    used = lengths > 0
    scaled = jacobian / np.where(used, lengths, 1.0)
    _, singular, right = np.linalg.svd(scaled, full_matrices=False)
    condition = float(singular[0] / singular[-1]) if singular[-1] > 0 else math.inf
    kept = singular > _SINGULAR * singular[0]
    inverse = (
        right[kept].T / singular[kept] ** 2 @ right[kept]
        if kept.any()
        else np.zeros((len(u), len(u)))
    )
    safe = np.where(used, lengths, np.inf)
    covariance = inverse / np.outer(safe, safe)
    lost = np.abs(right[~kept] / safe)
    vague = (lost > _PART * lost.max(axis=1, keepdims=True)).any(axis=0)
    near_bound = np.minimum(u - bounds[0], bounds[1] - u) <= _EDGE
    reasons = list(ended)
    for k, error in enumerate(np.sqrt(np.diag(covariance))):
        why = {
            "has no effect on what was measured": not used[k],
            "only combinations are determined: the condition of the scaled Jacobian is "
            f"{condition:.1e}": vague[k],
            "ends at its bound": near_bound[k],
            f"its error would be {error:.1g} times its value or scale": error > 1,
        }
        reasons[k] = reasons[k] or next((reason for reason, holds in why.items() if holds), "")
    return covariance, condition, reasons
