"""Derivatives of a motion with respect to parameters of its scene.

Runs that differ in a parameter are the members of one batch, with the same steps and method, so
their differences are as smooth as the solution. A central difference and one more value give a
difference of third order, and the correction from second order bounds its error.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..base import Floats, check
from ..base.extras import import_from_extra
from ..methods.bound import stable_dt, stable_dt_in_layer
from ..model.fields import unit_of_name
from ..model.scene import Scene, turning_times
from ..run.reasons import Reason
from ..typing import Force
from .parameters import STEP, Parameter, parameters_of, scene_with_values
from .solution import METHOD, ORDER, Positions, positions_at

if TYPE_CHECKING:
    import xarray

_LARGEST_ERROR = 1e-3  # largest error, over the largest derivative so far, that is believed
_LEAST_DERIVATIVE = 1e-4  # least derivative over the cloth's size of which that part is asked
_ROUNDING = 2e-14  # rounding of positions over the cloth's size
_LONGEST = 0.9  # longest step over the guaranteed stable step
_FINEST = 64.0  # largest factor of the number of steps
_DIGITS = 1e-11  # error of positions over the cloth's size that `sensitivity` asks for


def check_times(times: npt.ArrayLike) -> Floats:
    """Return times at which positions are asked for [s], checked."""
    requirement = "increasing times >= 0 [s] of which one is > 0"
    array = np.atleast_1d(check.array("times", times, kind=requirement))
    if array.ndim > 1 or not array.any():
        raise ValueError(f"times must be {requirement}, got {check.value_text(times)}")
    check.check_all("times", array, np.diff(array, prepend=-1e-300) > 0, requirement)
    return array


class Schedule:
    """The times of all steps, which are the same in every run that is compared."""

    def __init__(
        self, scene: Scene, times: Floats, rtol: float, force: Force | None = None
    ) -> None:
        """Choose steps so short that positions err by about `rtol` of the cloth's size at most."""
        self.times = times
        self.size = max(scene.cloth.size)
        self.refinement = 1.0
        self.force = force
        self.stops = sorted({*times.tolist(), *turning_times(scene, 0.0, float(times[-1]))} - {0.0})
        coarse = self.step_counts(scene)
        x = self.compute_positions([scene], coarse + -(-coarse // 4))
        y = self.compute_positions([scene], coarse)
        common = times <= min(x.end, y.end)
        error = np.abs(x.x - y.x)[:, common].max(initial=0.0) / (rtol * self.size)
        # The coarse steps are longer by a fourth, which is not counted on.
        self.refinement = float(np.clip(error ** (1 / ORDER), 1.0, _FINEST)) * 1.25

    def step_counts(self, scene: Scene) -> npt.NDArray[np.int64]:
        """Return the number of steps up to each stop."""
        # Friction of a layer is stiffer than springs: twice as deep contacts are rare.
        limits = [stable_dt(scene, METHOD)]
        for k, obstacle in enumerate(scene.spheres):
            if obstacle.response == "penalty":
                depth = obstacle.layer(scene.cloth)["thickness"] / 2
                limits.append(stable_dt_in_layer(scene, METHOD, k, depth))
        longest = _LONGEST * min(limits) / self.refinement
        if not self.stops[-1] / longest < check.INT64_MAX / 2:
            raise ValueError(
                f"times must end within {check.INT64_MAX / 2 * longest:.3g} s, which steps of "
                f"{longest:.3g} s reach, got {self.stops[-1]:g} s"
            )
        return np.maximum(np.ceil(np.diff(self.stops, prepend=0.0) / longest), 1).astype(np.int64)

    def compute_positions(
        self, scenes: Sequence[Scene], counts: npt.NDArray[np.int64]
    ) -> Positions:
        """Return the motion of the scenes at `times`."""
        result = positions_at(scenes, self.stops, counts.tolist(), force=self.force)
        x = result.x[:, np.searchsorted(self.stops, self.times)]
        if self.times[0] == 0:
            x[:, 0] = [scene.initial_position for scene in scenes]
        return result._replace(x=x)


class Derivatives(NamedTuple):
    """A motion and its changes by parameters."""

    positions: Positions  # of the scene; x has the shape (times, rows, columns, 3)
    change: Floats  # m per scale, shape (parameters, times, rows, columns, 3)
    term: Floats  # last term of each change, in the same shape


def compute_derivatives(
    scene: Scene, parameters: Sequence[Parameter], schedule: Schedule, most: int = 3
) -> Derivatives:
    """Return the changes of the motion of `scene` per scale of each parameter.

    Each is a difference of three positions, for the values -1, 0 and 1 of the parameter or, at a
    bound, 0, 1 and 2. With `most` = 4 values the term of third order corrects it.
    """
    places = [
        np.arange(most) * parameter.only_direction
        if parameter.only_direction
        else np.arange(-1, most - 1)
        for parameter in parameters
    ]
    members = [
        scene_with_values(scene, [parameter], [parameter.value + k * STEP * parameter.scale])
        for parameter, steps in zip(parameters, places)
        for k in steps
        if k
    ]
    result = schedule.compute_positions([scene, *members], schedule.step_counts(scene))
    change = np.empty((len(parameters), *result.x.shape[1:]))
    term = np.zeros_like(change)
    positions = iter(result.x[1:])
    for n, (parameter, steps) in enumerate(zip(parameters, places)):
        side = parameter.only_direction
        x = [next(positions) if k else result.x[0] for k in steps]
        if side:
            change[n] = (4 * (x[1] - x[0]) - (x[2] - x[0])) / 2 * side
        else:
            change[n] = (x[2] - x[0]) / 2
        if most > 3:
            term[n] = (x[3] - x[0] - 3 * (x[2] - x[1])) * (side / 3 or -1 / 6)
    return Derivatives(result._replace(x=result.x[0]), (change + term) / STEP, term / STEP)


class KnownDerivatives(NamedTuple):
    """Derivatives, NaN from the time on at which they are not known."""

    x: Floats  # m, shape (times, rows, columns, 3)
    change: Floats  # m per scale, shape (parameters, times, rows, columns, 3)
    error: Floats  # m per scale, shape (parameters, times)
    until: Floats  # s, shape (parameters,)
    reasons: list[str]  # reason why a derivative is not known later, or ""


def compute_known_derivatives(
    scene: Scene, parameters: Sequence[Parameter], schedule: Schedule
) -> KnownDerivatives:
    """Return derivatives per scale of each parameter, as far as they are known, with errors."""
    result, change, term = compute_derivatives(scene, parameters, schedule, 4)
    times = schedule.times
    largest = np.fmax.accumulate(np.abs(change).max(axis=(2, 3, 4)), axis=1)
    rounding = _ROUNDING * schedule.size / STEP
    error = np.abs(term).max(axis=(2, 3, 4)) + rounding + _DIGITS * largest
    bad = np.isnan(error) | (times > result.end)
    disagree = ~bad & (error > _LARGEST_ERROR * (largest + _LEAST_DERIVATIVE * schedule.size))
    reasons = []
    for disagree_row, bad_row in zip(disagree, bad):
        if disagree_row.any():
            reasons.append(Reason.DISAGREE.format(time=times[disagree_row.argmax()]))
        else:
            reasons.append(result.reason if bad_row.any() else "")
    bad |= np.logical_or.accumulate(disagree, axis=1)
    change[bad] = np.nan
    error[bad] = np.nan
    until = np.where(bad, 0.0, times).max(axis=1)
    return KnownDerivatives(result.x, change, error, until, reasons)


@check.check_names
def sensitivity(
    scene: Scene, times: npt.ArrayLike, of: Sequence[str], *, force: Force | None = None
) -> xarray.Dataset:
    """Return how each position changes with each parameter, and how far that is known.

    It costs three runs a parameter. Every derivative is a difference of third order over four
    values of the parameter, in runs that take the same steps. The derivative of the position x of a
    point by a parameter p solves the variational equation m d2(dx/dp)/dt2 = dF/dx dx/dp +
    dF/dv d(dx/dp)/dt + dF/dp, which tests solve to judge it.

    Parameters
    ----------
    scene : Scene
        Its state is at time 0.
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
        derivatives are NaN, for example because of a contact, with the "reason". Its method
        ``clothsim.plot`` draws derivatives and errors.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.

    Examples
    --------
    The exact derivative by the stiffness is -0.1 sin(w t) t / (2 w), with w = 10 / s:

    >>> import math
    >>> scene = cs.scenes.oscillator(stiffness=100.0)
    >>> data = cs.sensitivity(scene, [0.5, 1.0], of=["stiffness"])
    >>> at = {"parameter": "stiffness", "time": 1.0, "row": 0, "column": 1, "component": "x"}
    >>> slope = data.dx.sel(at).item()
    >>> abs(slope + 0.1 * math.sin(10.0) * 1.0 / 20.0) < 1e-12
    True
    """
    xr: Any = import_from_extra("xarray", "sensitivity")
    check.instance("scene", scene, Scene)
    parameters = parameters_of(scene, of, "of")
    schedule = Schedule(scene, check_times(times), _DIGITS, force)
    slopes = compute_known_derivatives(scene, parameters, schedule)
    scales = np.array([parameter.scale for parameter in parameters])
    place = ("time", "row", "column", "component")
    data: xarray.Dataset = xr.Dataset(
        {
            "dx": (("parameter", *place), slopes.change / scales.reshape(-1, 1, 1, 1, 1)),
            "error": (("parameter", "time"), slopes.error / scales[:, None]),
            "x": (place, slopes.x, {"units": "m"}),
            "value": ("parameter", [parameter.value for parameter in parameters]),
            "unit": ("parameter", [unit_of_name(parameter.field) for parameter in parameters]),
            "known_until": ("parameter", slopes.until, {"units": "s"}),
            "reason": ("parameter", slopes.reasons),
        },
        {
            "parameter": [parameter.name for parameter in parameters],
            "time": ("time", schedule.times, {"units": "s"}),
            "component": [*"xyz"],
        },
    )
    return data
