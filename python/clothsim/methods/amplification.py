"""Amplification of a damped oscillator by a step of a method: the linear theory of its stability."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base import Floats, check
from .data import METHODS, integrator_name


def amplification_matrix(integrator: str, omega_dt: npt.ArrayLike, delta_dt: npt.ArrayLike) -> Floats:
    """The matrix, shape (..., 2, 2), by which a step maps (x, dt v) of the damped oscillator.

    `omega_dt` and `delta_dt` are omega dt and delta dt of x'' = - omega^2 x - delta x', >= 0.

    >>> amplification_matrix("semi_implicit_euler", 1.0, 0.0).tolist()
    [[0.0, 1.0], [-1.0, 1.0]]
    """
    integrator = integrator_name(integrator)
    omega, delta = np.broadcast_arrays(_rates("omega_dt", omega_dt), _rates("delta_dt", delta_dt))
    square = omega * omega
    method = METHODS[integrator]
    if method.family == "splitting":
        one, zero = np.ones_like(square), np.zeros_like(square)
        x, w = np.stack([one, zero], -1), np.stack([zero, one], -1)
        k, c = square[..., None], delta[..., None]
        x, w, _ = splitting_step(integrator, lambda x, w: -k * x - c * w, x, w)
        return np.stack([x, w], -2)
    slope = np.stack([np.stack([0 * square, 1 + 0 * square], -1), np.stack([-square, -delta], -1)], -2)
    identity = np.broadcast_to(np.eye(2), slope.shape)
    if method.family == "implicit":
        return np.asarray(np.linalg.solve(identity - slope / 2, identity + slope / 2), np.float64)
    result = np.zeros_like(slope)
    for term in reversed(method.terms):
        result = slope @ result + term * identity
    return result


def amplification(integrator: str, omega_dt: npt.ArrayLike, delta_dt: npt.ArrayLike) -> Floats:
    """The spectral radius of `amplification_matrix`: a step is stable where it is at most 1.

    >>> amplification("rk4", [2.8, 2.9], 0.0).round(3).tolist()
    [0.931, 1.193]
    """
    matrix = amplification_matrix(integrator, omega_dt, delta_dt)
    half_trace = (matrix[..., 0, 0] + matrix[..., 1, 1]) / 2
    determinant = np.linalg.det(matrix)
    root = np.sqrt((half_trace**2 - determinant).astype(complex))
    return np.asarray(np.maximum(abs(half_trace + root), abs(half_trace - root)))


def _rates(name: str, value: npt.ArrayLike) -> Floats:
    array = check.array(name, value, what="finite numbers >= 0")
    check.check_all(name, array, array >= 0, "finite numbers >= 0")
    return array


def splitting_step(integrator: str, acceleration: Callable[[Any, Any], Any], x: Any, w: Any) -> tuple[Any, Any, list[Any]]:
    """One step of a splitting method from positions x and w, dt times the velocities.

    `acceleration(x, w)` returns dt^2 times the acceleration. The result is x and w at the end of the step, and the
    accelerations in the order of their evaluation.
    """
    method = METHODS[integrator]
    stages: list[Any] = []
    if method.damped:  # without damping it is the same step
        start = x, w
        for stage, (drift, in_x, in_w) in enumerate(method.damped):
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
