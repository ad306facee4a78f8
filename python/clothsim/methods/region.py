"""Stability regions: the largest time step that keeps a damped oscillator from growing.

A mode of the linearised cloth is the oscillator x'' = -omega^2 x - delta x', with omega^2 an
eigenvalue of the stiffness per unit mass and delta one of the damping per unit mass [1/s]. A step
of dt multiplies its (x, dt v) by a 2 x 2 matrix G(omega dt, delta dt). The mode does not grow where
the eigenvalues of G are at most 1 in size. For the trace T and determinant D of G this means |T| <=
1 + D and |D| <= 1.

In the plane of (omega dt, delta dt) a time step walks along a ray from the origin. A table per
integrator keeps where each ray first leaves the stable region.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base import Floats
from .integrators import METHODS, check_integrator_name

_ANGLES = 257
_RADIUS_STEP = 0.05
_BISECTIONS = 30
# This growth a step counts as rounding: e-fold in 1e9 steps. Below a radius of 1 it falls with the
# square of the radius, as the growth does that Euler's method gives an undamped oscillator.
_ROUNDING = 1e-9
# A region is searched up to this radius first, then twice as far, until it ends on every ray.
_FARTHEST = 10.0
_NOWHERE = 1e-7  # a region that ends before this radius ends at the origin: double resolves no less


def amplification_matrix(
    integrator: str, omega_dt: npt.ArrayLike, delta_dt: npt.ArrayLike
) -> Floats:
    """Return the matrix, shape (..., 2, 2), by which a step maps (x, dt v) of the damped
    oscillator.

    `omega_dt` and `delta_dt` are omega dt and delta dt of x'' = - omega^2 x - delta x', >= 0.

    >>> amplification_matrix("semi_implicit_euler", 1.0, 0.0).tolist()
    [[0.0, 1.0], [-1.0, 1.0]]
    """
    omega, delta = np.broadcast_arrays(np.asarray(omega_dt, float), np.asarray(delta_dt, float))
    square = omega * omega
    method = METHODS[check_integrator_name(integrator, fixed=True)]
    if method.family == "splitting":
        unit = np.ones_like(square)
        x = np.stack([unit, 0 * unit], -1)
        w = np.stack([0 * unit, unit], -1)
        k = square[..., None]
        c = delta[..., None]
        x, w, _ = splitting_step(integrator, lambda x, w: -k * x - c * w, x, w)
        return np.stack([x, w], -2)
    slope = np.stack(
        [np.stack([0 * square, 1 + 0 * square], -1), np.stack([-square, -delta], -1)], -2
    )
    identity = np.broadcast_to(np.eye(2), slope.shape)
    if method.family == "implicit":
        return np.asarray(np.linalg.solve(identity - slope / 2, identity + slope / 2), np.float64)
    result = np.zeros_like(slope)
    for term in reversed(method.terms):
        result = slope @ result + term * identity
    return result


def splitting_step(
    integrator: str, acceleration: Callable[[Any, Any], Any], x: Any, w: Any
) -> tuple[Any, Any, list[Any]]:
    """Take a step of a splitting method from positions x and w, dt times the velocities.

    `acceleration(x, w)` returns dt^2 times the acceleration. The result is x and w at the end of
    the step, and the accelerations in the order of their evaluation.
    """
    method = METHODS[integrator]
    stages: list[Any] = []
    if method.weights_damped:  # without damping it is the same step
        start = x, w
        for stage, (drift, in_x, in_w) in enumerate(method.weights_damped):
            if stage:
                x = start[0] + drift * start[1] + sum(part * a for part, a in zip(in_x, stages))
                w = start[1] + sum(part * a for part, a in zip(in_w, stages))
            if stage < method.stages_damped:
                stages.append(acceleration(x, w))
        return x, w, stages
    for drift, kick in zip(*method.splitting):
        x = x + drift * w if drift else x
        if kick:
            stages.append(acceleration(x, w))
            w = w + kick * stages[-1]
    return x, w, stages


def is_stable_mode(
    integrator: str, omega_dt: npt.ArrayLike, delta_dt: npt.ArrayLike
) -> npt.NDArray[np.bool_]:
    """Return whether a step does not amplify the mode, per entry."""
    g = amplification_matrix(integrator, omega_dt, delta_dt)
    trace = g[..., 0, 0] + g[..., 1, 1]
    determinant = g[..., 0, 0] * g[..., 1, 1] - g[..., 0, 1] * g[..., 1, 0]
    with np.errstate(invalid="ignore"):
        rounding = _ROUNDING * np.minimum(1.0, np.square(omega_dt) + np.square(delta_dt))
        inside = (np.abs(trace) <= 1 + determinant + rounding) & (
            np.abs(determinant) <= 1 + rounding
        )
    return np.asarray(inside)


@cache
def angles_and_radii_of_border(integrator: str) -> tuple[Floats, Floats]:
    """Return angles of rays from the omega axis to the delta axis, and the radius where each ray
    leaves the region.
    """
    angle = np.linspace(0.0, np.pi / 2, _ANGLES)
    return angle, _exit_radii(integrator, angle)


def _exit_radii(integrator: str, angle: Floats) -> Floats:
    """Return the radius where the ray of each angle (from the omega axis) leaves the region."""
    if METHODS[integrator].family == "implicit":
        return np.full(len(angle), np.inf)
    if METHODS[integrator].family == "stabilised":  # enough stages damp all but undamped motion
        return np.where(angle > 0, np.inf, 0.0)
    omega = np.cos(angle)
    delta = np.sin(angle)
    omega[angle >= np.pi / 2] = 0.0
    farthest = _FARTHEST
    bad = np.zeros((1, 1), bool)
    while not bad.any(axis=1).all():
        radii = np.arange(_RADIUS_STEP, farthest, _RADIUS_STEP)
        bad = ~is_stable_mode(integrator, radii * omega[:, None], radii * delta[:, None])
        farthest *= 2
    first = bad.argmax(axis=1)
    high = radii[first]
    low = np.where(first > 0, radii[first - 1], 0.0)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        good = is_stable_mode(integrator, middle * omega, middle * delta)
        low = np.where(good, middle, low)
        high = np.where(good, high, middle)
    return np.where(low < _NOWHERE, 0.0, low)


@cache
def limit_on_axis(integrator: str, damping: bool) -> float:
    """Return where the stable region ends on the delta axis (`damping`) or on the omega axis, less
    what counts as rounding.
    """
    return (1 - _ROUNDING) * float(
        _exit_radii(integrator, np.array([np.pi / 2 if damping else 0.0]))[0]
    )


@cache
def has_notch(integrator: str) -> bool:
    """Return whether slow modes with little damping can limit the step more than fast modes.

    This holds for dopri5: its region ends at 1 on the omega axis, and at 3 right beside the axis.
    """
    _, radius = angles_and_radii_of_border(integrator)
    return bool(np.isfinite(radius[0]) and radius[0] < 0.5 * radius.max())


def stable_dt_of_modes(integrator: str, omega: npt.ArrayLike, delta: npt.ArrayLike) -> Floats:
    """Return the largest stable time step of each mode [s]; infinite for one at rest.

    `omega` and `delta` are angular frequency and damping of the modes [1/s], >= 0, of one shape.
    """
    angle, radius = angles_and_radii_of_border(integrator)
    omega = np.asarray(omega, float)
    delta = np.asarray(delta, float)
    ray = np.atleast_1d(np.arctan2(delta, omega))
    size = np.hypot(omega, delta)
    if not np.isfinite(radius).all():  # implicit
        return np.full(size.shape, np.inf)
    right = np.searchsorted(angle, ray).clip(1, len(angle) - 1)
    pair = radius[right - 1], radius[right]
    steady = np.abs(pair[0] - pair[1]) < 0.02 * pair[1]  # else the border jumps between the rays
    exits = np.interp(ray, angle, radius)
    if not steady.all():
        # Each ray is searched once: all modes of an undamped cloth are on a single one.
        rays, place = np.unique(ray[~steady], return_inverse=True)
        exits[~steady] = _exit_radii(integrator, rays)[place.ravel()]
    exits = exits.reshape(size.shape)
    return np.asarray(np.divide(exits, size, out=np.full(size.shape, np.inf), where=size > 0))


def stable_dt_of_box(integrator: str, omega: float, delta: float) -> float:
    """Return the largest time step that is stable for every mode with at most this omega and this
    delta [s].

    Modes may combine frequency and damping in any way. So the whole box [0, omega dt] x [0, delta
    dt] has to lie in the stable region. Between two rays the box is taken at its widest and the
    region at its narrowest.
    """
    if omega == 0 or delta == 0:
        return float(stable_dt_of_modes(integrator, omega, delta))
    angle, radius = angles_and_radii_of_border(integrator)
    box = np.full(len(angle), np.hypot(omega, delta))  # as far as the corner, then the far side
    low = angle < np.arctan2(delta, omega)
    box[low] = omega / np.cos(angle[low])
    box[~low] = delta / np.sin(angle[~low])
    widest = np.maximum(box[:-1], box[1:])
    widest[np.count_nonzero(low) - 1] = np.hypot(omega, delta)
    return float((np.minimum(radius[:-1], radius[1:]) / widest).min())
