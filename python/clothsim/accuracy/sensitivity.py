"""Derivatives of a motion with respect to parameters of its scene: `sensitivity`.

Runs that differ in a parameter are the members of one batch. They take the same steps with the same method, so their
differences are as smooth as the solution. Central differences at two steps of the parameter are extrapolated to none
(Richardson). The wider differences also take longer time steps, so that the last correction shows the errors of both kinds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..base import Floats, check
from ..base.extras import needed
from ..engine.stepper import SilentStepper
from ..errors import ContactError, UnstableError
from ..methods.bound import stable_dt
from ..model.fields import change_scene, check_name, units
from ..model.scene import Scene

if TYPE_CHECKING:
    import xarray

_METHOD, _ORDER = "dop853", 8
_STEP = 2e-4  # of a parameter over its scale: rounding and truncation are then below 1e-9 of most derivatives
_PARTED = 1e-3  # difference of both estimates over the largest derivative so far, from which on neither is believed
_ROUNDING = 1e-11  # of the cloth's size: a smaller change of a position is rounding
_LONGEST = 0.9  # of the guaranteed stable step
_FINEST = 64.0  # times as many steps, at most
_DIGITS = 1e-11  # error of positions over the cloth's size that `sensitivity` asks for


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
        reach = 2 * _STEP * self.scale
        return int(self.value - reach <= self.least) - int(self.value + reach >= self.most)


def _numbers(scene: Scene) -> dict[str, list[float]]:
    """The numbers of a scene that can vary continuously, by the names of a sweep."""
    cloth = scene.cloth
    found = {"mass": [float(cloth.mass_per_point.sum())], "drag": [cloth.drag]}
    for kind, families in (("stiffness", cloth.family_stiffness), ("damping", cloth.family_damping)):
        found |= {kind: [*families.values()], **{f"{kind}_{family}": [value] for family, value in families.items()}}
    vectors = {"gravity": [scene.gravity], **{f"pin{k}": [scene.initial_position[pin]] for k, pin in enumerate(cloth.pins)}}
    for prefix, spheres in {"sphere": scene.spheres, **{f"sphere{k}": [one] for k, one in enumerate(scene.spheres)}}.items():
        vectors[f"{prefix}_center"] = [sphere.center for sphere in spheres]
        for part in ("radius", "restitution", "friction"):
            found[f"{prefix}_{part}"] = [getattr(sphere, part) for sphere in spheres]
    found |= {f"{name}_{c}": [float(v[k]) for v in some] for name, some in vectors.items() for k, c in enumerate("xyz")}
    return {name: values for name, values in found.items() if values}


def parameters_of(scene: Scene, names: Any, argument: str) -> list[Parameter]:
    """The named parameters with their values in `scene`."""
    if isinstance(names, str) or not isinstance(names, (Sequence, Mapping)) or not names:
        raise TypeError(f"{argument} must be a sequence of names such as ('stiffness', 'drag'), got {check.shown(names)}")
    known, found = _numbers(scene), []
    scales = {"m": max(scene.cloth.size), "m/s^2": 9.80665, "1": 1.0}
    scales["N s/m"] = float(scene.cloth.mass_per_point.min())  # a drag that acts within a second
    for name in names:
        field = check_name(name.replace(".", "_") if isinstance(name, str) else name)
        if field not in known:
            raise ValueError(f"{argument} must name numbers of the scene, got {name!r}; this one has {', '.join(known)}")
        value = known[field][0]
        if any(other != value for other in known[field]):
            raise ValueError(f"{argument} must name single numbers, got {name!r}, here {known[field]}: name its parts")
        least = -math.inf if field[-2:] in ("_x", "_y", "_z") else 0.0
        most = 1.0 if field.endswith("restitution") else math.inf
        found.append(Parameter(name, field, value, max(abs(value), scales.get(units(field), 0.0)), least, most))
    if len({one.field for one in found}) < len(found):
        raise ValueError(f"{argument} must name each parameter once, got {list(names)}")
    return found


def changed(scene: Scene, parameters: Sequence[Parameter], values: Sequence[float] | Floats) -> Scene:
    """A copy of `scene` with new values of the parameters."""
    named: dict[str, Any] = {p.field: float(value) for p, value in zip(parameters, values)}
    if "mass" in named:  # the masses of the points keep their ratios
        named["mass"] *= scene.cloth.mass_per_point / scene.cloth.mass_per_point.sum()
    return change_scene(scene, named)


def checked_times(times: npt.ArrayLike) -> Floats:
    """Times at which positions are asked for [s]."""
    accepted = "increasing times >= 0 [s]"
    given = np.atleast_1d(check.array("times", times, what=accepted))
    if given.ndim > 1:
        raise ValueError(f"times must be {accepted} in one dimension, got shape {given.shape}")
    check.check_all("times", given, np.diff(given, prepend=-1e-300) > 0, accepted)
    if not given.size or given[-1] == 0:
        raise ValueError(f"times must be {accepted} of which one is > 0, got {given.tolist()}")
    return given


class Clock:
    """The times of all steps: every run of a comparison takes the same."""

    def __init__(self, scene: Scene, times: Floats) -> None:
        stops = scene.stops(0.0, float(times[-1]))
        self.times, self.stops = times, np.array(sorted({*times.tolist(), *stops} - {0.0}))
        self.size = max(scene.cloth.size)
        self.finer = 1.0

    def counts(self, scene: Scene, coarse: bool = False) -> npt.NDArray[np.int64]:
        """Steps up to each stop; the coarse ones are a fourth longer."""
        longest = _LONGEST * stable_dt(scene, _METHOD) / self.finer
        counts = np.ceil(np.diff(self.stops, prepend=0.0) / longest).astype(np.int64)
        counts = np.maximum(counts, 1)
        return counts if coarse else counts + -(-counts // 4)

    def refine(self, scene: Scene, rtol: float) -> None:
        """Shorten the steps until positions should be off by at most `rtol` of the cloth's size."""
        (x, (known, _)), (y, _) = (positions_of([scene], self, self.counts(scene, coarse)) for coarse in (False, True))
        off = np.abs(x - y)[:, self.times <= known].max(initial=0.0)
        if off > rtol * self.size:
            self.finer = min((off / (rtol * self.size)) ** (1 / _ORDER), _FINEST)


def positions_of(scenes: Sequence[Scene], clock: Clock, counts: npt.NDArray[np.int64]) -> tuple[Floats, tuple[float, str]]:
    """Positions of each scene at the times of `clock`, shape (scenes, times, rows, columns, 3).

    Also the last of the times before a contact or a failure in any of the scenes, and the reason; positions after a failure
    are NaN.
    """
    shape = scenes[0].cloth.shape
    result = np.full((len(scenes), len(clock.times), *shape, 3), np.nan)
    known, reason, t = math.inf, "", 0.0
    if clock.times[0] == 0:
        result[:, 0] = [scene.initial_position for scene in scenes]
    stepper = SilentStepper(list(scenes), integrator=_METHOD)
    places = {time: k for k, time in enumerate(clock.times.tolist())}
    for stop, count in zip(clock.stops.tolist(), counts.tolist()):
        try:
            stepper.advance(count, (stop - t) / count)
        except (UnstableError, ContactError) as error:
            return result, (min(known, t), reason or f"a run ended after {t:.4g} s: {error}")
        if not reason and np.any(stepper.impulses):
            known, reason = t, f"the cloth meets a sphere between {t:.4g} and {stop:.4g} s: motions part there"
        t = stop
        if t in places:
            result[:, places[t]] = stepper.positions
    return result, (known, reason)


def difference(
    scene: Scene, parameters: Sequence[Parameter], clock: Clock, coarse: bool = False
) -> tuple[Floats, Floats, tuple[float, str]]:
    """Positions of `scene`, and by how much they change per scale of each parameter, axis 0; see `positions_of`."""
    h = _STEP * (2 if coarse else 1)
    sides = np.array([one.side for one in parameters])
    members = []
    for one, side in zip(parameters, sides):
        members += [changed(scene, [one], [one.value + k * h * one.scale]) for k in ((side, 2 * side) if side else (-1, 1))]
    if not coarse or sides.any():
        members.append(scene)
    x, end = positions_of(members, clock, clock.counts(scene, coarse))
    low, high = x[: 2 * len(sides) : 2], x[1 : 2 * len(sides) : 2]
    change = high - low
    for k in np.flatnonzero(sides):
        change[k] = sides[k] * (4 * (low[k] - x[-1]) - (high[k] - x[-1]))
    return x[-1], change / (2 * h), end


def changes(scene: Scene, parameters: Sequence[Parameter], clock: Clock) -> tuple[Floats, Floats, Floats, Floats, list[str]]:
    """Positions, extrapolated derivatives per scale of each parameter, and their errors, ends of meaning, and reasons."""
    x, near, first = difference(scene, parameters, clock)
    _, far, second = difference(scene, parameters, clock, coarse=True)
    known, why = min(first, second)
    change = near + (near - far) / 3
    error = np.abs(near - far).max(axis=(2, 3, 4)) / 3 + _ROUNDING / 100 * clock.size / _STEP
    largest = np.fmax.accumulate(np.abs(change).max(axis=(2, 3, 4)), axis=1)
    bad = np.isnan(error) | (clock.times > known)
    parted = ~bad & (error > _PARTED * largest + _ROUNDING * clock.size / _STEP)
    reasons = [
        f"differences of two sizes disagree from {clock.times[one.argmax()]:.4g} s on: motions part there"
        if one.any()
        else why * bool(late.any())
        for one, late in zip(parted, bad)
    ]
    bad |= np.logical_or.accumulate(parted, axis=1)
    change[bad], error[bad] = np.nan, np.nan
    return x, change, error, np.where(bad, 0.0, clock.times).max(axis=1), reasons


def sensitivity(scene: Scene, times: npt.ArrayLike, of: Sequence[str]) -> xarray.Dataset:
    """How each position changes with each parameter, and how far that is known.

    Parameters
    ----------
    scene : Scene
    times : array_like
        Times at which the derivatives are wanted [s], increasing, >= 0.
    of : sequence of str
        Names as in `sweep`: "mass" (in all; the ratios of the points stay), "stiffness", "damping", "stiffness_shear" and
        alike ("stiffness.shear" too), "drag", "gravity_y", "pin0_x" (the place of a pin), and of spheres "sphere_radius",
        "sphere0_center_x", "sphere_friction", "sphere_restitution".

    Returns
    -------
    xarray.Dataset
        "dx", derivatives of the positions at (parameter, time, row, column, component) in metres per unit of the parameter;
        "error", their error at (parameter, time), the largest over the points: the last correction of the extrapolation,
        which is usually far above the true error; "x", the positions [m]; "value", "unit", and until when the
        derivatives have a meaning, "known_until" [s]. Later ones, as after a contact, are NaN with a "reason".

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.
    ImportError
        Without xarray, naming the extra that brings it.

    Notes
    -----
    Costs 3.6 runs a parameter, and 1.8 more runs; all with the same steps of "dop853".

    Examples
    --------
    The exact derivative by the stiffness is -0.1 sin(w t) t / (2 w), with w = 10 / s:

    >>> import math
    >>> import clothsim as cs
    >>> data = cs.sensitivity(cs.scenes.oscillator(stiffness=100.0), [0.5, 1.0], of=["stiffness"])
    >>> found = data.dx.sel(parameter="stiffness", time=1.0, row=0, column=1, component="x").item()
    >>> abs(found + 0.1 * math.sin(10.0) * 1.0 / 20.0) < 1e-12
    True
    """
    xr: Any = needed("xarray", "sensitivity")
    check.instance("scene", scene, Scene)
    parameters = parameters_of(scene, of, "of")
    clock = Clock(scene, checked_times(times))
    clock.refine(scene, _DIGITS)
    x, change, error, until, reasons = changes(scene, parameters, clock)
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
            "parameter": [one.name for one in parameters],
            "time": ("time", clock.times, {"units": "s"}),
            "component": ["x", "y", "z"],
        },
    )
    return data
