"""Derivatives of a motion with respect to parameters of its scene, and parameters from a measured
motion.

Derivatives: runs that differ in a parameter are the members of one batch, with the same steps and
method, so their differences are as smooth as the solution. A central difference and one more value
give a difference of third order, and the correction from second order bounds its error.

Fit: least squares over the logarithms of positive parameters. A start that is far off gives a
motion that is out of phase with the data, where least squares finds a wrong minimum. So the first
times are fitted first, and then twice as many, until all are. While few times are fitted, each
parameter is held near its start by a weak prior. A wrong minimum may look like the right one where
no sigma tells how well data can be explained, so several starts are compared; the aliases of an
oscillation, which fit as well as it does, are starts too.
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
from ..methods.bound import limit_in_layer, stable_dt
from ..model.cloth import Cloth
from ..model.fields import change_scene, check_name, units
from ..model.scene import Scene, stops_of
from ..model.sphere import Plane, Sphere
from ..run.result import Run
from ..run.simulate import simulate
from ..typing import Force
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
_SURE = 4  # further starts where no sigma tells whether it does; one in eight ends elsewhere
_FAR = math.log(10)  # of a logarithm from its start, within which starts and aliases lie
# Singular value over the largest, of columns of length 1: below, the data cannot tell parameters
# apart.
_SINGULAR = 1e-5
_PART = 1e-2  # of a parameter in a direction that is not determined
_SIGMAS = 5.0  # from which on a chi-square, or a correlation of residuals, is no chance
_CORRELATED = 0.2  # of residuals at neighbouring times
_SIGNIFICANT = 3.0  # sigmas, from which on such a correlation widens errors
_RESIDUAL = 0.02  # of the motion, rms: larger residuals are part of it where no sigma is given
_LEAST_FREE = 3  # numbers more than parameters from which sigma can be estimated
_COARSE = 0.3  # of sigma: the largest error of simulated positions
# Factors between units of length. One is meant if data then is ten times nearer to the motion.
_UNITS = {"millimetres": 1000.0, "centimetres": 100.0, "inches": 39.37, "feet": 3.281}
_NEARER = 10.0
_MISFIT = 4.0  # chi-square per number of the first times, from which the clock is asked
_EARLY = 8  # times, of which a clock that is off is asked
_NO_SUCH = "no such cloth moves like this, or the noise is not independent; errors have no meaning"
_MOST_TURNS = 3  # between two times, of which aliases are looked for
_LEAST_FRAMES, _MOST_FRAMES = 64, 4096  # of a spectrum


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
    indexed = {f"plane{k}": one for k, one in enumerate(scene.spheres) if one._kind == "plane"}
    for prefix, planes in {
        "plane": [*indexed.values()],
        **{name: [plane] for name, plane in indexed.items()},
    }.items():
        for part in ("point", "normal"):
            vectors[f"{prefix}_{part}"] = [getattr(plane, part) for plane in planes]
        found |= _contact_numbers(prefix, planes, cloth)
    for prefix, spheres in {
        "sphere": scene.spheres,
        **{f"sphere{k}": [one] for k, one in enumerate(scene.spheres)},
    }.items():
        found |= _contact_numbers(prefix, spheres, cloth)
        if all(one._kind == "sphere" for one in spheres):  # no plane
            vectors[f"{prefix}_center"] = [sphere.center for sphere in spheres]
            found[f"{prefix}_radius"] = [sphere.radius for sphere in spheres]
    if scene.wind:
        vectors["wind_velocity"] = [scene.wind.velocity]
        for name in ("density", "normal", "tangential"):
            found[f"wind_{name}"] = [getattr(scene.wind, name)]
    found |= {
        f"{name}_{c}": [float(v[k]) for v in some]
        for name, some in vectors.items()
        for k, c in enumerate("xyz")
    }
    return {name: values for name, values in found.items() if values}


def _contact_numbers(
    prefix: str, obstacles: Sequence[Sphere | Plane], cloth: Cloth
) -> dict[str, list[float]]:
    """Return the numbers of contact of some obstacles, layers as resolved for the cloth."""
    found = {f"{prefix}_friction": [one.friction for one in obstacles]}
    if all(one.response == "penalty" for one in obstacles):
        layers = [one.layer(cloth) for one in obstacles]
        for name in ("thickness", "stiffness", "dissipation", "slip_speed"):
            found[f"{prefix}_{name}"] = [layer[name] for layer in layers]
    restitutions = [one.restitution for one in obstacles if one.restitution is not None]
    if len(restitutions) == len(obstacles):
        found[f"{prefix}_restitution"] = restitutions
    return found


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

    def __init__(
        self, scene: Scene, times: Floats, rtol: float, force: Force | None = None
    ) -> None:
        """With steps so short that positions should err by at most `rtol` of the cloth's size."""
        self.times, self.size, self.finer = times, max(scene.cloth.size), 1.0
        self.force = force
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
        # Friction of a layer is stiffer than springs: twice as deep contacts are rare.
        limits = [stable_dt(scene, METHOD)]
        for k, obstacle in enumerate(scene.spheres):
            if obstacle.response == "penalty":
                depth = obstacle.layer(scene.cloth)["thickness"] / 2
                limits.append(limit_in_layer(scene, METHOD, k, depth))
        longest = _LONGEST * min(limits) / self.finer
        return np.maximum(np.ceil(np.diff(self.stops, prepend=0.0) / longest), 1).astype(np.int64)

    def run(self, scenes: Sequence[Scene], counts: npt.NDArray[np.int64]) -> Motion:
        """The scenes at `times`."""
        found = motion(scenes, self.stops, counts.tolist(), force=self.force)
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
def sensitivity(
    scene: Scene, times: npt.ArrayLike, of: Sequence[str], *, force: Force | None = None
) -> xarray.Dataset:
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
        "sphere0_center_x", "sphere_friction", "sphere_restitution", "wind_velocity_x".
    force : callable, optional
        As for `simulate`.

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
    clock = Clock(scene, checked_times(times), _DIGITS, force)
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
        self,
        scene: Scene,
        names: Sequence[str],
        times: Floats,
        data: Floats,
        measured: Any,
        force: Force | None,
    ) -> None:
        self.scene, self.names, self.times, self.force = scene, names, times, force
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
                u,
                bounds,
                sigma,
                Clock(self.at(u), self.times[:count], rtol, self.force),
                least_squares,
            )
            u = found.x
        return found

    def _minimum(
        self,
        middle: Floats,
        bounds: Floats,
        sigma: float,
        clock: Clock,
        least_squares: Any,
        most: int = 60,
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

        digits = dict.fromkeys(("ftol", "xtol", "gtol"), 1e-4 if held else 1e-10)
        start = np.clip(middle, bounds[0] + _EDGE / 2, bounds[1] - _EDGE / 2)
        return least_squares(
            residuals,
            start,
            jacobian,
            (*bounds,),
            max_nfev=min(most, 20) if held else most,
            **digits,
        )

    def search(
        self,
        bounds: Floats,
        sigma: float | None,
        unit: float,
        rtol: float,
        moved: float,
        least_squares: Any,
    ) -> tuple[list[Any], dict[str, float], str, float]:
        """The minima of all starts, the quality of the best and why its residuals are no noise, and
        by how much the times are off [s].
        """
        random, minima, late = np.random.default_rng(0), list[Any](), 0.0
        least = rtol * max(self.scene.cloth.size)

        def judged() -> tuple[dict[str, float], str]:
            best = min(minima, key=lambda one: one.cost)
            return _judged(best, self.measured, len(self.names), sigma, unit, least, moved)

        u = np.zeros(len(self.names))
        early = self._minimum(
            u,
            bounds,
            unit,
            Clock(self.scene, self.times[:_FEWEST], rtol, self.force),
            least_squares,
        )
        level = 1.0 if sigma else _RESIDUAL * moved / unit
        if 2 * early.cost > _MISFIT * early.fun.size * level**2:
            late = self.shift_of_times(rtol, least_squares)
        if late:
            clock = Clock(self.at(early.x), self.times, rtol, self.force)
            minima.append(self._minimum(early.x, bounds, unit, clock, least_squares, most=1))
            return minima, *judged(), late
        while True:
            minima.append(self.minimise(u, bounds, unit, rtol, least_squares))
            quality, misfit = judged()
            further = len(minima) - 1
            if further >= _STARTS or not (misfit or (sigma is None and further < _SURE)):
                break
            u = random.uniform(-_FAR, _FAR, len(self.names)) * self.logarithmic
        if misfit:
            return minima, quality, misfit, 0.0
        best = min(minima, key=lambda one: one.cost)
        for place in self.aliases(best.x, bounds):
            clock = Clock(self.at(place), self.times, rtol, self.force)
            minima.append(self._minimum(place, bounds, unit, clock, least_squares))
        return minima, *judged(), 0.0

    def check_units(self, rtol: float) -> None:
        """Refuse positions that are near the motion of the start in another unit alone."""
        distance = self._first_distance(1.0, rtol)
        for unit, factor in _UNITS.items():
            if _NEARER * self._first_distance(factor, rtol) < distance:
                raise ValueError(
                    f"positions must be in metres, got numbers that look like {unit}: "
                    f"divide them by {factor:g}"
                )

    def _first_distance(self, factor: float, rtol: float) -> float:
        """Distance of the data over `factor` from the motion of the start [m], rms."""
        clock = Clock(self.scene, self.times[:_FEWEST], rtol, self.force)
        x = clock.run([self.scene], clock.counts(self.scene)).x[0]
        n = len(clock.times)
        return float(np.sqrt(np.nanmean((self.data[:n] / factor - x)[self.measured[:n]] ** 2)))

    def shift_of_times(self, rtol: float, least_squares: Any) -> float:
        """What has to be added to the times [s] so that the first of them can be explained; 0 if a
        shift does not explain them ten times better.
        """
        shape, size = self.scene.cloth.shape, max(self.scene.cloth.size)
        given = self.times[:_EARLY]
        data = self.data[: len(given)]
        measured = self.measured[: len(given)]
        unit = float(np.diff(self.times, prepend=0.0).max())
        far = _FAR * self.logarithmic + ~self.logarithmic

        def residuals(values: Floats, shifted: float = 1.0) -> Floats:
            scene, late = self.at(values[:-1]), shifted * unit * float(values[-1])
            times = np.maximum(given + late, 0.0)
            later, places = np.unique(times[times > 0], return_inverse=True)
            x = np.broadcast_to(scene.initial_position, (len(given), *shape, 3)).copy()
            if later.size:
                clock = Clock(scene, later, rtol, self.force)
                x[times > 0] = clock.run([scene], clock.counts(scene)).x[0][places]
            off = np.nan_to_num((x - data)[measured], nan=size)
            return np.append(off, 1e-3 * rtol * size * values)

        start = np.zeros(len(self.names) + 1)
        ends = np.append(far, _EARLY / 2.0)
        options = {"diff_step": 1e-4, "max_nfev": 20, "bounds": (-ends, ends), "x_scale": ends}
        shifted = least_squares(residuals, start, **options)
        still = least_squares(residuals, start, args=(0.0,), **options)
        better = still.cost > _NEARER**2 * shifted.cost
        return unit * float(shifted.x[-1]) if better else 0.0

    def aliases(self, u: Floats, bounds: Floats) -> list[Floats]:
        """Coordinates whose motion has an alias of the main frequency at the times: as often a
        whole number of turns more or less between two of them.
        """
        speeding = np.array([one.field.startswith("stiffness") for one in self.parameters])
        slowing = np.array([one.field == "mass" for one in self.parameters])
        way = 1.0 * speeding - slowing
        between = float(np.median(np.diff(self.times))) if len(self.times) > 1 else 0.0
        if not way.any() or between <= 0:
            return []
        frequency = self._main_frequency(u)
        found = []
        for turns in range(1, _MOST_TURNS + 1):
            for alias in (turns / between - frequency, turns / between + frequency):
                if frequency <= 0 or alias <= 0:
                    continue
                place = u + 2 * math.log(alias / frequency) * way * self.logarithmic
                inside = (np.abs(place) <= _FAR) & (bounds[0] <= place) & (place <= bounds[1])
                if inside[way != 0].all():
                    found.append(place)
        return found

    def _main_frequency(self, u: Floats) -> float:
        """The frequency [Hz] at which most of the measured points' motion is."""
        scene = self.at(u)
        end = float(self.times[-1])
        longest = stable_dt(scene, METHOD)
        count = int(min(max(2 * end / longest, _LEAST_FRAMES), _MOST_FRAMES))
        moments = np.linspace(0, end, count + 1)[1:]
        run = simulate(scene, end, rtol=1e-3, times=moments, force=self.force)
        moving = run.x[1:, self.measured.any(axis=0)]
        spectrum = np.abs(np.fft.rfft(moving - moving.mean(axis=0), axis=0)) ** 2
        weights = spectrum.sum(axis=1)
        peak = int(weights[1:].argmax()) + 1
        near = slice(peak - 1, peak + 2)
        places = np.fft.rfftfreq(count, end / count)[near]
        return float((places * weights[near]).sum() / weights[near].sum())


@check.named
def fit(
    scene: Scene,
    times: npt.ArrayLike,
    positions: npt.ArrayLike,
    over: Sequence[str] | Mapping[str, tuple[float, float]],
    points: Sequence[tuple[int, int]] | None = None,
    sigma: float | None = None,
    rtol: float = 1e-6,
    *,
    force: Force | None = None,
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
        `points`; NaN, or masked, where nothing was measured. Pinned points do not count, unless the
        place of a pin is fitted.
    over : sequence of str, or mapping of str to (least, most)
        Names as in `sensitivity`; a mapping gives bounds too.
    points : sequence of (row, column), optional
        The measured points. Default: all.
    sigma : float, optional
        Standard deviation of each measured number [m], > 0. Default: estimated from the residuals
        of the best of several starts. Give it if you know it: it tells whether a minimum explains
        the data.
    rtol : float, default 1e-6
        Error of the simulated positions over the size of the cloth, well below `sigma`.
    force : callable, optional
        As for `simulate`.

    Returns
    -------
    Fit
        A parameter that the data does not determine is NaN, with a reason, also where another
        value fits as well. After a contact all are NaN. Errors are NaN if the residuals are not
        noise: then the model does not describe the measured motion. Correlated residuals widen
        errors where `sigma` is given; without it errors are those of Student's t.

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
    problem = _Problem(scene, names, times, data, measured, force)
    bounds = problem.bounds(over)
    least = rtol * max(scene.cloth.size)  # of what residuals can show
    moved = float(np.sqrt(np.mean((data - scene.initial_position)[measured] ** 2)))
    if sigma is not None and least > _COARSE * sigma:
        raise ValueError(
            f"rtol must be at most {_COARSE * sigma / max(scene.cloth.size):.2g} with sigma = "
            f"{sigma:g} m, so that simulated positions err by less than that, got {rtol:g}"
        )
    problem.check_units(rtol)
    unit = sigma or max(1e-3 * moved, least)
    begin = perf_counter()
    minima, quality, misfit, late = problem.search(bounds, sigma, unit, rtol, moved, least_squares)
    best = min(minima, key=lambda one: one.cost)
    parameters = parameters_of(scene := problem.at(best.x), names, "over")
    clock = Clock(scene, times, rtol, force)
    _, change, _, _, ended = known_derivatives(scene, parameters, clock)
    run = simulate(scene, float(times[-1]), rtol=rtol, times=times, force=force)
    wall_time = perf_counter() - begin
    jacobian = problem.columns(change, parameters, best.x) / quality["sigma"]
    covariance, condition, reasons = _determined(jacobian, ended, best.x, bounds)
    free = count - len(names)
    small = "" if sigma is None else _too_small(quality, free, measured)
    if sigma is None:
        covariance *= _student(free) ** 2
    elif _significant(quality["correlation"], measured):
        covariance = _widened(covariance, jacobian, measured, quality["correlation"])
    alike = _alike(best, minima, 2 * (unit / quality["sigma"]) ** 2, covariance)
    for k, other in alike.items():
        text = f"{problem.values(other)[k]:.4g} fits as well as {problem.values(best.x)[k]:.4g}"
        reasons[k] = reasons[k] or f"{text}; bounds exclude one of them"
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
    elif late:
        told = [f"times seem to be off by {-late:.3g} s: the first ones fit far better without it"]
        covariance = np.full_like(covariance, np.nan)
    elif misfit or small:
        told.append(misfit or small)
        covariance = np.full_like(covariance, np.nan)
    report = {
        "reason": "; ".join(told),
        "reasons": dict(zip(names, reasons)),
        **quality,
        "condition": condition,
    }
    spent = {"evaluations": problem.evaluations, "jacobians": problem.jacobians}
    report |= {**spent, "starts": len(minima), "wall_time": wall_time}
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
    if isinstance(values, np.ma.MaskedArray) and values.dtype.kind in "iuf":
        values = np.where(np.ma.getmaskarray(values), np.nan, values.data)
    given = check.as_array("positions", values, accepted)
    if given.shape != shape:
        raise ValueError(f"positions must be {accepted}, got shape {given.shape}")
    given = given.astype(np.float64)
    check.check_all("positions", given, ~np.isinf(given), accepted)
    return given, place


def _judged(
    found: Any,
    measured: Any,
    parameters: int,
    sigma: float | None,
    unit: float,
    least: float,
    moved: float,
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
    chi = 2 * float(found.cost) / free
    if sigma is not None:
        quality = {"sigma": sigma, "chi_square": chi, "correlation": correlation}
        if chi > 1 + _SIGMAS * math.sqrt(2 / _effective(free, correlation, measured)):
            return quality, f"chi-square is {chi:.3g} per degree of freedom: {_NO_SUCH}"
        return quality, ""
    noise = unit * math.sqrt(chi)
    quality = {"sigma": max(noise, least), "chi_square": math.nan, "correlation": correlation}
    reason = ""
    if free < _LEAST_FREE:
        reason = f"only {free} numbers more than parameters do not tell sigma: give it"
    elif noise > 10 * least and correlation > max(_CORRELATED, _SIGMAS / math.sqrt(max(number, 1))):
        text = f"residuals at neighbouring times have a correlation of {correlation:.2f}"
        reason = f"{text}: {_NO_SUCH}"
    elif noise > max(10 * least, _RESIDUAL * moved):
        text = f"residuals are {100 * noise / moved:.2g} % of the motion"
        reason = f"{text}: {_NO_SUCH}; give sigma where noise is as large"
    return quality, reason


def _significant(correlation: float, measured: Any) -> bool:
    """Whether a correlation of residuals at neighbouring times is no chance."""
    number = int((measured[1:] & measured[:-1]).sum())
    return number > 0 and correlation > _SIGNIFICANT / math.sqrt(number)


def _effective(free: int, correlation: float, measured: Any) -> float:
    """The number of independent data whose chi-square scatters as much as that of correlated."""
    rho = correlation if _significant(correlation, measured) else 0.0
    return free * (1 - rho**2) / (1 + rho**2)


def _too_small(quality: Mapping[str, float], free: int, measured: Any) -> str:
    """Why chi-square is far below 1, or ""; its cube root is nearly normal (Wilson, Hilferty)."""
    chi = quality["chi_square"]
    part = 2 / (9 * _effective(free, quality["correlation"], measured))
    if chi > max(1 - part - _SIGMAS * math.sqrt(part), 0.0) ** 3:
        return ""
    return (
        f"chi-square is {chi:.2g} per degree of freedom: sigma is larger than the noise, or the "
        "data was smoothed"
    )


def _widened(covariance: Floats, jacobian: Floats, measured: Any, correlation: float) -> Floats:
    """The covariance where residuals at times that are k apart have the correlation to the k-th."""
    whole = np.zeros((measured.size, jacobian.shape[1]))
    whole[measured.ravel()] = jacobian
    whole = whole.reshape(len(measured), -1, jacobian.shape[1])
    before, after = whole.copy(), whole.copy()
    for k in range(1, len(whole)):
        before[k] += correlation * before[k - 1]
        after[-1 - k] += correlation * after[-k]
    meat = np.einsum("tnp,tnq->pq", whole, before + after - whole)
    return np.asarray(covariance @ meat @ covariance)


def _student(free: int) -> float:
    """The one-sigma quantile of Student's t: sigma is estimated from so many numbers."""
    special = needed("scipy.special", "fit", "fit")
    return float(special.stdtrit(max(free, _LEAST_FREE), 0.5 + math.erf(math.sqrt(0.5)) / 2))


def _alike(best: Any, minima: list[Any], scale: float, covariance: Floats) -> dict[int, Floats]:
    """Other minima that the data does not rule out, by the parameter that is elsewhere there;
    `scale` times a cost is chi-square.
    """
    found: dict[int, Floats] = {}
    errors = np.sqrt(np.diag(covariance))
    for one in minima:
        if scale * (one.cost - best.cost) < _SIGMAS**2:
            for k in np.flatnonzero(np.abs(one.x - best.x) > np.maximum(_SIGMAS * errors, _PART)):
                found.setdefault(int(k), one.x)
    return found


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
