"""The modes of a cloth about a given state that limit the time step.

About a state (x, v) the cloth moves as M y'' + C y' + K y = 0 with the tangent matrices of the spring
forces. For the force f = (k (l - L) + c (w . n)) n of a spring along d = l n whose ends move apart
with w, and P = 1 - n n^T,

    df/dd = k n n^T + k (1 - L/l) P + c ((w . n) P + n (P w)^T) / l,      df/dw = c n n^T

A mode is a pair (mu, y) with (mu^2 + mu C + K) y = 0 (M is scaled away). Only the few that limit the
time step are wanted, so the problem is projected on a small space (Galerkin: K and C keep their
symmetry and their signs, and no projected mode is beyond the true ones), and the space is extended by
the residuals of the modes that limit the step, until the limit no longer changes. For an undamped
cloth that is Lanczos' iteration, in general a residual Arnoldi iteration.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ..scene import Scene
from .region import mode_limit

Floats = npt.NDArray[np.float64]
Operator = Callable[[Floats], Floats]

_SAFETY = 0.97  # a little below, as the limit found approaches the true one from above
_BLOCK = 4  # modes followed at once
_MOST_VECTORS = 48  # in the space; a larger one is reduced to the limiting modes
_KEPT = 8  # modes, that it is reduced to
_MOST_PRODUCTS = 600
_SETTLED = 2e-4  # relative change of the limit over the last rounds
_ROUNDS = 4
_DOUBT = 0.01  # part by which a followed mode may yet come out below the limit, by its residual


def tangent(scene: Scene, x: Floats, v: Floats) -> tuple[Operator, Operator]:
    """Products with K [1/s^2] and C [1/s] at a state, of vectors of shape (n, 3 points).

    Both are scaled with the roots of the masses on either side; pinned points are left out. Springs
    without length have no direction and exert no force; they are left out too.
    """
    cloth, table = scene.cloth, scene.cloth.spring_table()
    scale = np.where(cloth.pinned, 0.0, cloth.mass_per_point**-0.5).reshape(-1, 1)
    x, v = x.reshape(-1, 3), v.reshape(-1, 3)
    i, j = table["i"], table["j"]
    d, w = x[j] - x[i], v[j] - v[i]
    length = np.linalg.norm(d, axis=1)
    there = length > 0
    i, j, d, w, length, table = (part[there] for part in (i, j, d, w, length, table))
    n = d / length[:, None]
    stretching = (w * n).sum(axis=1)
    turning = (w - stretching[:, None] * n) / length[:, None]
    across = table["stiffness"] * (1 - table["rest_length"] / length)
    across += table["damping"] * stretching / length
    along, damping = table["stiffness"] - across, table["damping"]
    gather = _incidence(i, j, len(x))

    def to_points(force: Floats) -> Floats:
        """Forces of shape (n, springs, 3) summed up at the points."""
        signed = np.concatenate([force, -force, np.zeros_like(force[:, :1])], axis=1)
        return (signed[:, gather].sum(axis=2) * scale).reshape(len(force), -1)

    def apart(y: Floats) -> Floats:
        y = y.reshape(len(y), -1, 3) * scale
        return y[:, j] - y[:, i]

    def stiffness(y: Floats) -> Floats:
        u = apart(y)
        radial = along * (u * n).sum(axis=2) + damping * (u * turning).sum(axis=2)
        return -to_points(across[:, None] * u + radial[..., None] * n)

    def damping_(y: Floats) -> Floats:
        radial = damping * (apart(y) * n).sum(axis=2)
        return -to_points(radial[..., None] * n) + cloth.point_damping * (
            y.reshape(len(y), -1, 3) * scale**2
        ).reshape(y.shape)

    return stiffness, damping_


def _incidence(i: npt.NDArray[np.int64], j: npt.NDArray[np.int64], points: int) -> npt.NDArray[Any]:
    """Per point the springs that begin there, those that end there (counted on), and padding."""
    point = np.concatenate([i, j])
    order = np.argsort(point, kind="stable")
    count = np.bincount(point, minlength=points)
    place = np.arange(len(point)) - np.repeat(np.cumsum(count) - count, count)
    result = np.full((points, max(count.max(initial=0), 1)), 2 * len(i))
    result[point[order], place] = order
    return result


def stable_dt_at(integrator: str, scene: Scene, x: Floats, v: Floats) -> float:
    """What `clothsim.max_stable_dt` gives with a state [s]."""
    return _SAFETY * spectral_limit(integrator, scene, x, v)


def spectral_limit(integrator: str, scene: Scene, x: Floats, v: Floats) -> float:
    """The largest stable time step [s] of the motion linearised about a state, to about 0.1 %."""
    stiffness, damping = tangent(scene, x, v)
    free = np.flatnonzero(np.repeat(~scene.cloth.pinned.ravel(), 3))
    size = 3 * scene.cloth.pinned.size
    if not len(free):
        return np.inf
    start = np.zeros((min(_BLOCK, len(free)), size))
    start[:, free] = np.random.default_rng(0).normal(size=(len(start), len(free)))
    basis, k_basis, c_basis = (np.empty((0, size)) for _ in range(3))
    extension, limits, products = start, [], 0
    while True:
        new = _orthonormal(extension, basis)
        products += len(new)
        if not len(new):
            return limits[-1]
        basis = np.concatenate([basis, new])
        k_basis = np.concatenate([k_basis, stiffness(new)])
        c_basis = np.concatenate([c_basis, damping(new)])
        own, mu, z = _limiting_modes(integrator, _dots(basis, k_basis), _dots(basis, c_basis))
        limit = float(own.min(initial=np.inf))
        limits.append(limit)
        recent = limits[-_ROUNDS:]
        if len(basis) >= len(free) or products >= _MOST_PRODUCTS:
            return min(recent)
        mode, rate = z[:_BLOCK], mu[:_BLOCK, None]
        extension = np.concatenate(
            [
                _sums(part(rate**2 * mode), basis)
                + _sums(part(rate * mode), c_basis)
                + _sums(part(mode), k_basis)
                for part in (np.real, np.imag)
            ]
        )
        # |mu|^2 is off by no more than the residual, so the limit by no more than half of that part.
        residual = np.sqrt((extension**2).sum(axis=1).reshape(2, -1).sum(axis=0))
        residual /= np.abs(rate[:, 0]) ** 2 * np.linalg.norm(mode, axis=1)
        known = (own[:_BLOCK] * (1 - residual / 2) >= (1 - _DOUBT) * limit).all()
        settled = len(recent) == _ROUNDS and max(recent) <= min(recent) * (1 + _SETTLED)
        if settled and known:
            return min(recent)
        if len(basis) + len(extension) > _MOST_VECTORS:
            parts = np.concatenate([z.real, z.imag])
            reduction = _orthonormal(parts, np.empty((0, len(basis))))
            basis, k_basis, c_basis = (_sums(reduction, part) for part in (basis, k_basis, c_basis))


# einsum, not @: products this flat gain nothing from the threads of a BLAS, which wait for each other
# where processors are busy.
def _dots(a: Floats, b: Floats) -> Floats:
    return np.einsum("ik,jk->ij", a, b)


def _sums(weights: Floats, vectors: Floats) -> Floats:
    return np.einsum("ij,jk->ik", weights, vectors)


def _orthonormal(vectors: Floats, basis: Floats) -> Floats:
    """What `vectors` add to the span of the orthonormal rows of `basis`, as orthonormal rows."""
    found = basis
    for vector in vectors:
        size = np.sqrt((vector**2).sum())
        if size == 0:
            continue
        vector = vector[None] / size
        for _ in range(2):  # twice is enough to be orthogonal to the last bit
            vector = vector - _sums(_dots(vector, found), found)
        rest = np.sqrt((vector**2).sum())
        if rest > 1e-10:
            vector = vector / rest
            vector = vector - _sums(_dots(vector, found), found)
            found = np.concatenate([found, vector / np.sqrt((vector**2).sum())])
    return found[len(basis) :]


def _limiting_modes(
    integrator: str, k: Floats, c: Floats
) -> tuple[Floats, npt.NDArray[Any], npt.NDArray[Any]]:
    """Limits, values and vectors of the projected modes that limit most, these first."""
    m = len(k)
    speed = max(np.sqrt(np.abs(k).max()), np.abs(c).max(), 1e-300)  # balances the two halves
    companion = np.block([[np.zeros((m, m)), speed * np.eye(m)], [-k / speed, -c]])
    mu, z = np.linalg.eig(companion)
    z = z[:m].T
    wave = np.abs(mu.imag) > 1e-9 * np.abs(mu)
    # A wave has omega^2 = |mu|^2 and delta = -2 Re mu; what decays without waves its own damping.
    # What grows in the exact motion too is no matter of the time step.
    omega = np.where(wave, np.abs(mu), 0.0)
    delta = np.where(wave, -2 * mu.real, -mu.real).clip(0)
    limits = mode_limit(integrator, omega, delta)
    keep = (mu.imag >= 0) & np.isfinite(limits)
    worst = np.flatnonzero(keep)[np.argsort(limits[keep])[:_KEPT]]
    return limits[worst], mu[worst], z[worst]
