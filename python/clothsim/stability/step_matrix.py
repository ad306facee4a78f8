"""The time step at which a splitting method's own step matrix stops being stable.

A step of dt = h maps a small perturbation z = (x, w = h v) of the state linearly, z' = S(h) z. K
and C are the tangent matrices of `spectrum`: each stage evaluates a = -h^2 K x - h C w. The step matrix of a
Runge-Kutta method is a rational function of the first-order system's matrix, so both have the same modes. The step
matrices of splitting methods and of velocity Verlet are not. Where K and C do not commute, S mixes the modes. Its
eigenvalues then leave the unit circle before those of any single mode.

S(h) is projected on a small space V: K and C are replaced by V K V^T and V C V^T. The space is extended by the
accelerations that the stages of the full step give for the eigenvectors that leave the unit circle first. Once
these lie in the space, the projected step of that eigenvector is the full step.

A compressed spring buckles: K has a negative eigenvalue, and a mode of the equation grows without
alternating. A step reproduces that growth, so it does not count as instability of the step. A growing eigenvector
counts as buckling where K is negative along its velocity, and damping along it is within the limit of pure damping.
Other growth counts as growth of the equation only up to the number of its growing modes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base import Floats
from ..methods.amplification import splitting_step
from ..methods.integration import integrators
from .subspace import Operator, Subspace

# Growth per step that counts, by the sign of Re lambda. Damped springs that turn make modes grow by some 1e-3 a
# step without alternating, in the equation too. Twice of either growth moves the limit by less than 1 %.
_GROWTH = {-1: 1e-3, 1: 1e-2}
_FOLLOWED = 2  # eigenvectors per sign of Re lambda
_RATIO = 1.08  # between the steps tried; an unstable interval narrower than that is passed over
_PRECISION = 2e-4  # of the limit in a space
_RESIDUAL = 0.02  # of S z = lambda z: moves lambda, and the limit, by about 1 % at most
_SETTLED = 1e-3  # relative change of the limit over the last rounds
_ROUNDS = 3


def step_limit(integrator: str, stiffness: Operator, damping: Operator, start: Floats, size: int, near: float) -> float:
    """The largest h up to which the step matrix of a splitting method is stable [s], to about 1 %.

    `stiffness` and `damping` are the products with K [1/s^2] and C [1/s] of vectors in rows. `start` has the initial
    vectors, and `size` is the dimension of the space of free coordinates. `near` is a first guess [s], within a factor
    of 10.
    """
    space = Subspace(stiffness, damping)
    space.extend(start)
    limits: list[float] = []
    while True:
        limit = _limit_in(integrator, space.k, space.c, limits[-1] if limits else near)
        limits.append(limit)
        recent = limits[-_ROUNDS:]
        if space.full(size) or not np.isfinite(limit):
            return min(recent)
        values, z = _leaving(integrator, space.k, space.c, limit)
        x, w = (space.vectors(part) for part in np.split(z, 2, axis=1))
        x_new, w_new, stages = splitting_step(integrator, _acceleration(space.stiffness, space.damping, limit), x, w)
        rest = np.concatenate([x_new - values[:, None] * x, w_new - values[:, None] * w], axis=1)
        residual = np.linalg.norm(rest, axis=1) / np.linalg.norm(z, axis=1)
        settled = len(recent) == _ROUNDS and max(recent) <= min(recent) * (1 + _SETTLED)
        grown = np.abs(values) > 1 + _GROWTH[-1]  # the others are inside, known or not
        if settled and (residual <= _RESIDUAL)[grown].all():
            return min(recent)
        if space.crowded(2 * len(z) * len(stages)):
            space.reduce(np.concatenate(np.split(z, 2, axis=1)))
        if not space.extend(np.concatenate([part for a in stages for part in (a.real, a.imag)])):
            return min(recent)


def _acceleration(stiffness: Operator, damping: Operator, h: float) -> Callable[[Any, Any], Any]:
    def product(operator: Operator, y: Any) -> Any:
        if np.iscomplexobj(y):
            return operator(y.real) + 1j * operator(y.imag)
        return operator(y)

    return lambda x, w: -h * h * product(stiffness, x) - h * product(damping, w)


def matrix(integrator: str, k: Floats, c: Floats, h: float) -> Floats:
    """The step matrix S(h) of dense K and C, shape (2 n, 2 n)."""
    x, w = np.split(np.eye(2 * len(k)), 2, axis=1)
    x, w, _ = splitting_step(integrator, lambda x, w: -h * h * x @ k.T - h * w @ c.T, x, w)
    return np.concatenate([x, w], axis=1).T


def faulty(integrator: str, k: Floats, c: Floats, h: float, flow: npt.NDArray[Any]) -> bool:
    """Whether a step of h [s] amplifies modes that do not grow in the equation, with dense K [1/s^2] and C [1/s].

    `flow` has the eigenvalues mu of the equation, whose modes go as e^(mu t) [1/s]; see `rates`.
    """
    step = matrix(integrator, k, c, h)
    values = np.linalg.eigvals(step)
    real = np.abs(values.imag) <= 1e-9 * np.abs(values)
    if (values[real].real > 1 + _GROWTH[1]).any():
        values, vectors = np.linalg.eig(step)
        real = np.abs(values.imag) <= 1e-9 * np.abs(values)
        grown = np.flatnonzero(real & (values.real > 1 + _GROWTH[1]))
        w = vectors[len(k) :, grown].real.T
        size = np.maximum((w**2).sum(axis=1), 1e-300)
        along_k, along_c = (((w @ part.T) * w).sum(axis=1) / size for part in (k, c))
        buckles = (along_k < 0) & (h * along_c < integrators()[integrator].real_limit)
        if not buckles.all():
            return True
    flow = flow[np.abs(flow.imag) > 1e-9 * np.abs(flow)]
    exact = np.exp((flow * h).real.clip(max=50.0) + 1j * (flow * h).imag)
    for sign, growth in _GROWTH.items():
        more, fewer = (
            np.count_nonzero((np.abs(found) > 1 + least) & (sign * found.real >= 0))
            for found, least in ((values[~real | (values.real < 0)], growth), (exact, growth / 2))
        )
        if more > fewer:
            return True
    return False


def rates(k: Floats, c: Floats) -> npt.NDArray[Any]:
    """Eigenvalues mu of y'' + C y' + K y = 0 [1/s], shape (2 n,)."""
    m = len(k)
    speed = max(np.sqrt(np.abs(k).max(initial=0)), np.abs(c).max(initial=0), 1e-300)
    return np.linalg.eigvals(np.block([[np.zeros((m, m)), speed * np.eye(m)], [-k / speed, -c]]))


def _limit_in(integrator: str, k: Floats, c: Floats, near: float) -> float:
    """The limit in a space: the first of rising steps that is unstable, then bisection."""
    mu = rates(k, c)
    if not np.abs(mu).max(initial=0) > 0:
        return np.inf

    def unstable(h: float) -> bool:
        return faulty(integrator, k, c, h, mu)

    low = 0.7 * near
    while unstable(low):
        low *= 0.5
    high = low * _RATIO
    while not unstable(high):
        low, high = high, high * _RATIO
        if high * np.abs(mu).max() > 1e6:
            return np.inf
    while high > (1 + _PRECISION) * low:
        middle = np.sqrt(low * high)
        low, high = (low, middle) if unstable(middle) else (middle, high)
    return float(low)


def _leaving(integrator: str, k: Floats, c: Floats, limit: float) -> tuple[Any, Any]:
    """Eigenvalues and eigenvectors (in rows) right above the limit that are the largest."""
    values, vectors = np.linalg.eig(matrix(integrator, k, c, limit * (1 + 10 * _PRECISION)))
    chosen = []
    for sign in _GROWTH:
        side = np.flatnonzero((sign * values.real >= 0) & (values.imag >= 0))
        chosen += list(side[np.argsort(-np.abs(values[side]))[:_FOLLOWED]])
    return values[chosen], vectors[:, chosen].T
