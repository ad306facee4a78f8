"""The modes that limit the time step, for a cloth near a given state.

About a state (x, v) the cloth moves as M y'' + C y' + K y = 0 with the tangent matrices of the
spring forces. A spring along d = l n, with ends that move apart with w, has the force f = (k (l -
L) + c (w . n)) n. With P = 1 - n n^T,

    df/dd = k n n^T + k (1 - L/l) P + c ((w . n) P + n (P w)^T) / l,      df/dw = c n n^T

A mode is a pair (mu, y) with (mu^2 + mu C + K) y = 0 (M is scaled away). Only the few modes that
limit the time step are needed, so the problem is projected on a small space (Galerkin). K and C
keep their symmetry and their signs, and no projected mode is beyond the true ones. Residuals of the
limiting modes extend the space until the limit no longer changes. For an undamped cloth that is
Lanczos' iteration, in general a residual Arnoldi iteration.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..base import Floats
from ..methods.data import METHODS
from ..methods.region import mode_limit, notched
from ..model.scene import Scene
from .step_matrix import step_limit
from .subspace import Operator, Subspace

_NOISE = 1e-12  # of the rest length: four digits of a direction are left, of coordinates near 1 m
_SAFETY = 0.97  # a little below, as the limit found approaches the true one from above
_BLOCK = 4  # modes followed at once
_DENSE = 400  # coordinates; a method that modes in the middle can limit takes all of up to so many, in 1 s
_KEPT = 8  # modes, that it is reduced to
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
    near = np.flatnonzero(there & (length < _NOISE * table["rest_length"]))
    if len(near):
        ends = [divmod(int(end[near[0]]), cloth.columns) for end in (i, j)]
        raise ValueError(
            f"x must have the ends of every spring together or apart, got {length[near[0]]:.3g} m "
            f"between mass points {ends[0]} and {ends[1]}: less than rounding leaves of the spring's "
            "direction"
        )
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
        signed = np.concatenate([force, -force, np.zeros((len(force), 1, 3))], axis=1)
        return np.reshape(signed[:, gather].sum(axis=2) * scale, (len(force), -1))

    def apart(y: Floats) -> Floats:
        y = y.reshape(len(y), -1, 3) * scale
        return np.subtract(y[:, j], y[:, i])

    def stiffness(y: Floats) -> Floats:
        u = apart(y)
        radial = along * (u * n).sum(axis=2) + damping * (u * turning).sum(axis=2)
        return -to_points(across[:, None] * u + radial[..., None] * n)

    def damping_(y: Floats) -> Floats:
        radial = damping * (apart(y) * n).sum(axis=2)
        at_points = (y.reshape(len(y), -1, 3) * scale**2).reshape(y.shape)
        return np.asarray(cloth.drag * at_points - to_points(radial[..., None] * n))

    return stiffness, damping_


def _incidence(i: npt.NDArray[np.int64], j: npt.NDArray[np.int64], points: int) -> npt.NDArray[Any]:
    """Indices of springs per point: springs that begin at the point, then springs that end there, then padding."""
    point = np.concatenate([i, j])
    order = np.argsort(point, kind="stable")
    count = np.bincount(point, minlength=points)
    place = np.arange(len(point)) - np.repeat(np.cumsum(count) - count, count)
    result = np.full((points, max(count.max(initial=0), 1)), 2 * len(i))
    result[point[order], place] = order
    return result


def stable_dt_at(integrator: str, scene: Scene, x: Floats, v: Floats) -> float:
    """Value of `clothsim.max_stable_dt` with a state [s]."""
    return _SAFETY * spectral_limit(integrator, scene, x, v)


def spectral_limit(integrator: str, scene: Scene, x: Floats, v: Floats) -> float:
    """The largest stable time step [s] of the motion linearised about a state, to about 1 %.

    With dopri5 and more than 400 free coordinates it may miss slow modes of little damping, which
    grow by up to some 1e-3 a step.
    """
    stiffness, damping = tangent(scene, x, v)
    free = np.flatnonzero(np.repeat(~scene.cloth.pinned.ravel(), 3))
    size = 3 * scene.cloth.pinned.size
    if not len(free):
        return np.inf
    if notched(integrator) and len(free) <= _DENSE:
        rows = np.eye(size)[free]
        k, c = (product(rows)[:, free].T for product in (stiffness, damping))
        return float(_limiting_modes(integrator, k, c)[0].min(initial=np.inf))
    start = np.zeros((min(_BLOCK, len(free)), size))
    start[:, free] = np.random.default_rng(0).normal(size=(len(start), len(free)))
    limit, modes = _limit_of_modes(integrator, stiffness, damping, start, len(free))
    if METHODS[integrator].family != "splitting" or not np.isfinite(limit):
        return limit
    begin = np.concatenate([start, modes])
    return step_limit(integrator, stiffness, damping, begin, len(free), limit)


def _limit_of_modes(
    integrator: str, stiffness: Operator, damping: Operator, start: Floats, size: int
) -> tuple[float, Floats]:
    """The largest step at which every single mode is stable, and the most limiting modes."""
    space = Subspace(stiffness, damping)
    space.extend(start)
    limits: list[float] = []
    while True:
        own, mu, z = _limiting_modes(integrator, space.k, space.c)
        limit = float(own.min(initial=np.inf))
        limits.append(limit)
        recent = limits[-_ROUNDS:]
        modes = space.vectors(np.concatenate([z[:_BLOCK].real, z[:_BLOCK].imag]))
        if space.full(size) or not len(own):
            return min(recent), modes
        mode, rate = z[:_BLOCK], mu[:_BLOCK]
        extension = space.residuals(rate, mode)
        # |mu|^2 is off by no more than the residual, so the limit by no more than half of that part.
        residual = np.sqrt((extension**2).sum(axis=1).reshape(2, -1).sum(axis=0))
        residual /= np.abs(rate) ** 2 * np.linalg.norm(mode, axis=1)
        known = (own[:_BLOCK] * (1 - residual / 2) >= (1 - _DOUBT) * limit).all()
        settled = len(recent) == _ROUNDS and max(recent) <= min(recent) * (1 + _SETTLED)
        if settled and known:
            return min(recent), modes
        if space.crowded(len(extension)):
            space.reduce(z)
        if not space.extend(extension):
            return min(recent), modes


def _limiting_modes(integrator: str, k: Floats, c: Floats) -> tuple[Floats, npt.NDArray[Any], npt.NDArray[Any]]:
    """Step limits, eigenvalues and eigenvectors of projected modes, the most limiting first."""
    m = len(k)
    speed = max(np.sqrt(np.abs(k).max()), np.abs(c).max(), 1e-300)  # balances the two halves
    linear = np.block([[np.zeros((m, m)), speed * np.eye(m)], [-k / speed, -c]])
    mu, z = np.linalg.eig(linear)
    z = z[:m].T
    wave = np.abs(mu.imag) > 1e-9 * np.abs(mu)
    # A wave has omega^2 = |mu|^2 and delta = -2 Re mu. A mode that decays without waves has its own damping. Growth of the
    # exact motion is no matter of the time step.
    omega = np.where(wave, np.abs(mu), 0.0)
    delta = np.where(wave, -2 * mu.real, -mu.real).clip(0)
    limits = mode_limit(integrator, omega, delta)
    keep = (mu.imag >= 0) & np.isfinite(limits)
    worst = np.flatnonzero(keep)[np.argsort(limits[keep])[:_KEPT]]
    return limits[worst], mu[worst], z[worst]
