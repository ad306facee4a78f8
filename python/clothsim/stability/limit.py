"""The largest stable time step: guaranteed for a scene, or by the modes that limit it near a given
state.

About a state (x, v) the cloth moves as M y'' + C y' + K y = 0 with the tangent matrices of the
spring forces. A spring along d = l n, whose ends have the relative velocity w, has the force f = (k
(l - L) + c (w . n)) n. With P = 1 - n n^T,

    df/dd = k n n^T + k (1 - L/l) P + c ((w . n) P + n (P w)^T) / l,      df/dw = c n n^T

A mode is a pair (mu, y) with (mu^2 + mu C + K) y = 0 (M is scaled away). Only the few modes that
limit the time step are needed, so the problem is projected onto a small space (Galerkin). K and C
keep their symmetry and definiteness, and no projected mode lies outside the range of the true ones.
Residuals of the limiting modes extend the space until the limit no longer changes. For an undamped
cloth that is Lanczos' iteration, in general a residual Arnoldi iteration.

The step matrix of a Runge-Kutta method is a function of the first-order system's matrix, so both
have the same modes. The step matrix S(h) of a splitting method, of z = (x, h v), mixes the modes
where K and C do not commute: its eigenvalues leave the unit circle before those of any single mode.
The space then grows by the accelerations that the stages of the full step give for the eigenvectors
that leave first. Once these lie in the space, the projected step of that eigenvector is the full
step.

A compressed spring buckles: K has a negative eigenvalue, and a mode of the equation grows without
alternating. A step reproduces that growth, so it does not count as instability of the step. A
growing eigenvector counts as buckling where K is negative along its velocity, and damping along it
is within the limit of pure damping. Other growth counts as growth of the equation only up to the
number of its growing modes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import repeat
from typing import Any, NamedTuple, overload

import numpy as np
import numpy.typing as npt

from .. import _core
from ..base import Floats, check
from ..engine.options import Options, cached_plan
from ..engine.state import check_start_time, list_scenes
from ..methods.bound import stable_dt
from ..methods.integrators import METHODS, check_integrator_name
from ..methods.region import has_notch, splitting_step, stable_dt_of_modes
from ..model.scene import Scene
from ..typing import Integrator

Operator = Callable[[Floats], Floats]

_SAFETY = 0.97  # The computed limit approaches the true one from above.
_NOISE = 1e-12  # of the rest length: four digits of a direction are left, of coordinates near 1 m
_BLOCK = 4  # modes that are followed side by side
# A method that modes in the middle can limit takes all modes of up to so many coordinates, in 1 s.
_DENSE = 400
_LEAST_MODES = 8  # modes that a space is reduced to
_MOST_VECTORS = 48  # vectors of a space
_MOST_PRODUCTS = 600
_SETTLED = 1e-3  # relative change of the limit over the last rounds
_ROUNDS = 6
_DOUBT = 0.01  # part by which a followed mode may yet come out below the limit, by its residual
# Growth per step that counts, by the sign of Re lambda. Damped springs that turn make modes grow by
# some 1e-3 a step without alternating, in the equation too. Twice of either growth moves the limit
# by less than 1 %.
_GROWTH = {-1: 1e-3, 1: 1e-2}
_FOLLOWED = 2  # eigenvectors of a step matrix per sign of Re lambda
_RATIO = 1.08  # between the steps tried; an unstable interval narrower than that is passed over
_PRECISION = 2e-4  # of the limit in a space
_RESIDUAL = 0.02  # of S z = lambda z: moves lambda, and the limit, by about 1 % at most


@overload
def max_stable_dt(
    scene: Scene,
    integrator: Integrator = "rk4",
    x: npt.ArrayLike | None = None,
    v: npt.ArrayLike | None = None,
    t: float | None = None,
) -> float: ...
@overload
def max_stable_dt(scene: Sequence[Scene], *arguments: Any, **options: Any) -> Floats: ...
@check.check_names
def max_stable_dt(
    scene: Scene | Sequence[Scene],
    integrator: Integrator = "rk4",
    x: npt.ArrayLike | None = None,
    v: npt.ArrayLike | None = None,
    t: float | None = None,
) -> float | Floats:
    """Return the largest stable time step: guaranteed for all states except extreme states, or at
    the state (x, v).

    A mode of the cloth has a frequency omega and a damping rate delta: x'' = -omega^2 x - delta x'.
    A mode does not grow if the integrator's amplification matrix of (omega dt, delta dt) has no
    eigenvalue above 1 in size. Without a state, omega^2 <= lambda and a largest delta bound all
    modes, and the step is stable for every pair up to these bounds. The guarantee holds where no
    spring is shorter than half its rest length. With spring damping, c w/l must also be at most K,
    where w is the relative speed of a spring's ends and l its length. In other states a run at this
    step may be unstable. Compressed springs buckle at any step, because their modes grow in the
    exact solution too.

    With a state, the step is 3 % below the limit of the forces linearised at that state. A moving
    cloth has other modes: in the paper's swing the limit falls to 11 % below its value at rest.
    docs/stability.md has the bounds and the methods.

    Parameters
    ----------
    scene : Scene or sequence of Scene
        Of a sequence, the result and the states are arrays with an entry for each scene.
    integrator : str, default "rk4"
        A name of `integrators`.
    x : array_like, optional
        Positions [m], shape (rows, columns, 3).
    v : array_like, optional
        With `x`: velocities [m/s], same shape. Default: at rest.
    t : float, optional
        With `x`: time of the state [s]. Required where an obstacle of response "penalty" moves.

    Returns
    -------
    float
        Time step [s]; infinite where nothing limits it, 0 where every time step amplifies some
        motion, as "explicit_euler" does with motion that nothing damps.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above. Also if a spring of the state is shorter than 1e-12 of its
        rest length, but not of length 0. The message names the spring's ends.

    Examples
    --------
    >>> scene = cs.scenes.paper_swing(bend=True)
    >>> f"{cs.max_stable_dt(scene):.3e}"
    '8.526e-04'
    >>> f"{cs.max_stable_dt(scene, x=scene.initial_position):.2e}"
    '1.73e-03'
    """
    if not isinstance(scene, Scene):
        scenes = list_scenes(scene)
        batch_shape = (len(scenes), *scenes[0].cloth.shape, 3)
        xs = repeat(None) if x is None else check.array("x", x, batch_shape)
        vs = repeat(None) if v is None else check.array("v", v, batch_shape)
        members = zip(scenes, xs, vs)
        return np.array([max_stable_dt(member, integrator, x, v, t) for member, x, v in members])
    integrator = check_integrator_name(integrator, fixed=True)
    if x is None:
        if v is not None:
            raise ValueError("v must be None without x, got velocities alone")
        if t is not None:
            raise ValueError(f"t must be None without x, got {check.value_text(t)}")
        return stable_dt(scene, integrator)
    time = check_start_time(t, [scene] if scene.has_layers or scene.wind else [])
    shape = (*scene.cloth.shape, 3)
    x = check.array("x", x, shape)
    v = np.zeros(shape) if v is None else check.array("v", v, shape)
    return _SAFETY * spectral_limit(integrator, scene, x, v, time)


def tangent_products(
    scene: Scene, x: Floats, v: Floats, t: float = 0.0
) -> tuple[Operator, Operator]:
    """Make functions that multiply vectors of shape (n, 3 points) with K [1/s^2] and C [1/s] at a
    state.

    Contact and wind at the time `t` are included. Both are scaled with the roots of the masses on
    either side; pinned points are left out. Springs without length have no direction and exert no
    force; they are left out too.
    """
    cloth = scene.cloth
    table = cloth.spring_table()
    scale = np.where(cloth.pinned, 0.0, cloth.mass_per_point**-0.5).reshape(-1, 1)
    x = x.reshape(-1, 3)
    v = v.reshape(-1, 3)
    i = table["i"]
    j = table["j"]
    with np.errstate(over="ignore", invalid="ignore"):
        d = x[j] - x[i]
        w = v[j] - v[i]
        length = np.linalg.norm(d, axis=1)
    if not np.isfinite(length).all():
        raise ValueError(
            "x must have springs whose length has a finite square, got ends up to "
            f"{np.abs(x).max():.3g} m from the origin"
        )
    has_length = length > 0
    tiny = np.flatnonzero(has_length & (length < _NOISE * table["rest_length"]))
    if len(tiny):
        ends = [divmod(int(end[tiny[0]]), cloth.columns) for end in (i, j)]
        raise ValueError(
            f"x must have the ends of every spring together or apart, got {length[tiny[0]]:.3g} m "
            f"between mass points {ends[0]} and {ends[1]}: less than rounding leaves of the "
            "spring's direction"
        )
    i, j, d, w, length, table = (part[has_length] for part in (i, j, d, w, length, table))
    n = d / length[:, None]
    stretching = (w * n).sum(axis=1)
    turning = (w - stretching[:, None] * n) / length[:, None]
    lateral = table["stiffness"] * (1 - table["rest_length"] / length)
    lateral += table["damping"] * stretching / length
    axial = table["stiffness"] - lateral
    damping = table["damping"]
    place = np.concatenate([i, j])

    def sum_at_points(force: Floats) -> Floats:
        """Sum up forces of shape (n, springs, 3) at the points."""
        ends = np.concatenate([force, -force], axis=1)
        at_points = [[np.bincount(place, part[:, k], len(x)) for k in range(3)] for part in ends]
        return np.reshape(np.swapaxes(at_points, 1, 2) * scale, (len(force), -1))

    def spring_differences(y: Floats) -> Floats:
        y = y.reshape(len(y), -1, 3) * scale
        return np.subtract(y[:, j], y[:, i])

    acting = [
        force.damping_blocks(cloth.core, x.reshape(*cloth.shape, 3), v.reshape(*cloth.shape, 3), t)
        for force in scene.core_forces
    ]
    layers = None
    if scene.has_layers:
        plan = cached_plan(scene, Options())
        layers = _core.contact_derivatives(
            plan, x.reshape(*cloth.shape, 3), v.reshape(*cloth.shape, 3), t
        )

    def multiply_contact_blocks(y: Floats, blocks: Floats) -> Floats:
        at_points = y.reshape(len(y), -1, 3) * scale
        return np.asarray((np.einsum("pij,npj->npi", blocks, at_points) * scale).reshape(y.shape))

    def multiply_stiffness(y: Floats) -> Floats:
        u = spring_differences(y)
        radial = axial * (u * n).sum(axis=2) + damping * (u * turning).sum(axis=2)
        force = sum_at_points(lateral[:, None] * u + radial[..., None] * n)
        return -force if layers is None else multiply_contact_blocks(y, layers[0]) - force

    def multiply_damping(y: Floats) -> Floats:
        radial = damping * (spring_differences(y) * n).sum(axis=2)
        force = -sum_at_points(radial[..., None] * n)
        for points, blocks in acting:
            force = force + _multiply_point_blocks(points, blocks, y, scale)
        return force if layers is None else force + multiply_contact_blocks(y, layers[1])

    return multiply_stiffness, multiply_damping


def _multiply_point_blocks(
    points: npt.NDArray[np.int64], blocks: Floats, y: Floats, scale: Floats
) -> Floats:
    """Multiply vectors of shape (n, 3 points) with a matrix of blocks between points."""
    target, source = points.T
    by_source = (y.reshape(len(y), -1, 3) * scale)[:, source]
    products = np.einsum("pij,npj->nip", blocks, by_source)
    sums = [[np.bincount(target, row, len(scale)) for row in rows] for rows in products]
    return np.reshape(np.swapaxes(sums, 1, 2) * scale, y.shape)


def spectral_limit(integrator: str, scene: Scene, x: Floats, v: Floats, t: float = 0.0) -> float:
    """Compute the largest stable time step [s] of the motion linearised about a state, to some 1 %.

    With dopri5 and more than 400 free coordinates it may miss slow modes of little damping, which
    grow by up to some 1e-3 a step.
    """
    operators = tangent_products(scene, x, v, t)
    free = np.flatnonzero(np.repeat(~scene.cloth.pinned.ravel(), 3))
    size = 3 * scene.cloth.pinned.size
    if not len(free):
        return np.inf
    if has_notch(integrator) and len(free) <= _DENSE:
        rows = np.eye(size)[free]
        k, c = (product(rows)[:, free].T for product in operators)
        return float(limiting_modes(integrator, k, c)[0].min(initial=np.inf))
    start = np.zeros((min(_BLOCK, len(free)), size))
    start[:, free] = np.random.default_rng(0).normal(size=(len(start), len(free)))
    space = Subspace(*operators, len(free))
    limit, leaders = space.search_limit(start, lambda _: _limit_by_modes(integrator, space))
    if METHODS[integrator].family != "splitting" or not np.isfinite(limit):
        return limit
    space = Subspace(*operators, len(free))
    start = np.concatenate([start, leaders])
    return space.search_limit(
        start, lambda guess: _limit_by_step_matrix(integrator, space, guess or limit)
    )[0]


class SpaceLimit(NamedTuple):
    """The limit [s] in a space, the coordinates (in rows) of the modes that set it, vectors outside
    the space to which these lead, and whether the limit is that of the whole cloth too.
    """

    limit: float
    modes: npt.NDArray[Any]
    outside: npt.NDArray[Any]
    for_cloth: bool


class Subspace:
    """Orthonormal rows, their products with K and C, and the projected matrices `k` and `c`."""

    def __init__(self, stiffness: Operator, damping: Operator, size: int) -> None:
        self.operators = (stiffness, damping)
        self.size = size  # free coordinates
        self.rows: list[Floats] = []  # the basis, and its products with K and C
        self.products = 0

    def search_limit(
        self, start: Floats, examine: Callable[[float], SpaceLimit]
    ) -> tuple[float, Floats]:
        """Extend the space until the limit of `examine` no longer changes, and return the limit and
        the modes that set it.
        """
        self.rows = [start[:0]] * 3
        extension = start
        limits = [0.0]
        while self._extend(extension):
            step = examine(limits[-1])
            limits.append(step.limit)
            recent = limits[1:][-_ROUNDS:]
            leaders = _weighted_sums(_stack_real_and_imaginary(step.modes[:_BLOCK]), self.rows[0])
            settled = len(recent) == _ROUNDS and max(recent) <= min(recent) * (1 + _SETTLED)
            full = len(self.rows[0]) >= self.size or self.products >= _MOST_PRODUCTS
            if full or not np.isfinite(step.limit) or (settled and step.for_cloth):
                break
            extension = _stack_real_and_imaginary(step.outside)
            if len(self.rows[0]) + len(extension) > _MOST_VECTORS:
                basis = _orthonormal_rest(
                    _stack_real_and_imaginary(step.modes), np.empty((0, len(self.rows[0])))
                )
                self.rows = [_weighted_sums(basis, rows) for rows in self.rows]
        return min(recent), leaders

    def _extend(self, vectors: Floats) -> bool:
        new = _orthonormal_rest(vectors, self.rows[0])
        if not len(new):
            return False
        self.products += len(new)
        parts = (new, *(product(new) for product in self.operators))
        self.rows = [np.concatenate([rows, part]) for rows, part in zip(self.rows, parts)]
        self.k, self.c = (_dot_products(self.rows[0], product) for product in self.rows[1:])
        return True


def _stack_real_and_imaginary(rows: npt.NDArray[Any]) -> Floats:
    """Stack the real parts of rows, then their imaginary parts."""
    return np.concatenate([rows.real, rows.imag])


# Products this flat gain nothing from the threads of a BLAS, which `@` would start: they wait for
# each other where processors are busy.
def _dot_products(a: Any, b: Any) -> Any:
    return np.einsum("ik,jk->ij", a, b)


def _weighted_sums(weights: Any, vectors: Any) -> Any:
    return np.einsum("ij,jk->ik", weights, vectors)


def _orthonormal_rest(vectors: Floats, basis: Floats) -> Floats:
    """Return the part of `vectors` outside the span of orthonormal `basis`, as orthonormal rows."""
    rest: Floats = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)
    for _ in range(2):  # Twice is enough to be orthogonal to the last bit.
        rest = rest - _weighted_sums(_dot_products(rest, basis), basis)
        columns, triangle = np.linalg.qr(rest.T)
        rest = columns.T[np.abs(np.diag(triangle)) > 1e-10]
    return rest


def solve_modes(k: Floats, c: Floats) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Solve for the 2 n eigenvalues mu of y'' + C y' + K y = 0 [1/s] and eigenvectors (columns)."""
    m = len(k)
    # This speed balances the two halves.
    speed = max(np.sqrt(np.abs(k).max(initial=0)), np.abs(c).max(initial=0), 1e-300)
    mu, z = np.linalg.eig(np.block([[np.zeros((m, m)), speed * np.eye(m)], [-k / speed, -c]]))
    return mu, z[:m]


def limiting_modes(
    integrator: str, k: Floats, c: Floats
) -> tuple[Floats, npt.NDArray[Any], npt.NDArray[Any]]:
    """Return limits, eigenvalues and eigenvectors (rows) of the modes of (K, C), smallest limit
    first.
    """
    mu, z = solve_modes(k, c)
    wave = np.abs(mu.imag) > 1e-9 * np.abs(mu)
    # A wave has omega^2 = |mu|^2 and delta = -2 Re mu. A mode that decays without waves has its own
    # damping. The time step does not cause growth of the exact motion.
    omega = np.where(wave, np.abs(mu), 0.0)
    delta = np.where(wave, -2 * mu.real, -mu.real).clip(0)
    limits = stable_dt_of_modes(integrator, omega, delta)
    keep = (mu.imag >= 0) & np.isfinite(limits)
    worst = np.flatnonzero(keep)[np.argsort(limits[keep])[:_LEAST_MODES]]
    return limits[worst], mu[worst], z.T[worst]


def _limit_by_modes(integrator: str, space: Subspace) -> SpaceLimit:
    """Return the largest step at which every single mode is stable."""
    limits, mu, z = limiting_modes(integrator, space.k, space.c)
    limit = float(limits.min(initial=np.inf))
    mode = z[:_BLOCK]
    rate = mu[:_BLOCK, None]
    parts = (rate**2 * mode, mode, rate * mode)
    outside = sum(_weighted_sums(part, rows) for part, rows in zip(parts, space.rows))
    # |mu|^2 is off by no more than the residual, so the limit by no more than half of that part.
    size = np.abs(rate[:, 0]) ** 2 * np.linalg.norm(mode, axis=1)
    residual = np.linalg.norm(outside, axis=1) / size
    reaches = limits[:_BLOCK] * (1 - residual / 2) >= (1 - _DOUBT) * limit
    return SpaceLimit(limit, modes=z, outside=outside, for_cloth=bool(reaches.all()))


def _limit_by_step_matrix(integrator: str, space: Subspace, guess: float) -> SpaceLimit:
    """Return the largest step at which the step matrix of a splitting method is stable."""
    limit = _search_step_matrix_limit(integrator, space.k, space.c, guess)
    if not np.isfinite(limit):
        return SpaceLimit(limit, modes=space.k[:0], outside=space.k[:0], for_cloth=True)
    values, vectors = np.linalg.eig(
        step_matrix(integrator, space.k, space.c, limit * (1 + 10 * _PRECISION))
    )
    sides = [np.flatnonzero((sign * values.real >= 0) & (values.imag >= 0)) for sign in _GROWTH]
    largest = [side[np.argsort(-np.abs(values[side]))[:_FOLLOWED]] for side in sides]
    indices = np.concatenate(largest)
    values = values[indices, None]
    z = vectors[:, indices].T
    x, w = (
        _weighted_sums(_stack_real_and_imaginary(part), space.rows[0])
        for part in np.split(z, 2, axis=1)
    )

    def acceleration(x: Floats, w: Floats) -> Floats:
        stiffness, damping = space.operators
        return -limit * limit * stiffness(x) - limit * damping(w)

    *end, stages = splitting_step(integrator, acceleration, x, w)
    images, vectors = (
        part[: len(z)] + 1j * part[len(z) :] for part in (np.hstack(end), np.hstack([x, w]))
    )
    residual = np.linalg.norm(images - values * vectors, axis=1) / np.linalg.norm(z, axis=1)
    # The residuals of vectors that do not grow have no effect on the limit.
    grows = np.abs(values[:, 0]) > 1 + _GROWTH[-1]
    return SpaceLimit(
        limit,
        modes=np.concatenate(np.split(z, 2, axis=1)),
        outside=np.concatenate(stages),
        for_cloth=bool((residual <= _RESIDUAL)[grows].all()),
    )


def step_matrix(integrator: str, k: Floats, c: Floats, h: float) -> Floats:
    """Compute the step matrix S(h) of dense K and C, shape (2 n, 2 n)."""
    x, w = np.split(np.eye(2 * len(k)), 2, axis=1)
    x, w, _ = splitting_step(integrator, lambda x, w: -h * h * x @ k.T - h * w @ c.T, x, w)
    return np.concatenate([x, w], axis=1).T


def step_amplifies_modes(
    integrator: str, k: Floats, c: Floats, flow: npt.NDArray[Any], h: float
) -> bool:
    """Tell whether a step of h [s] amplifies modes that do not grow in the equation, with dense K
    [1/s^2] and C [1/s].

    `flow` has the eigenvalues mu of the equation, whose modes go as e^(mu t) [1/s].
    """
    step = step_matrix(integrator, k, c, h)
    values = np.linalg.eigvals(step)
    real = np.abs(values.imag) <= 1e-9 * np.abs(values)
    if (values[real].real > 1 + _GROWTH[1]).any():
        values, vectors = np.linalg.eig(step)
        real = np.abs(values.imag) <= 1e-9 * np.abs(values)
        indices = np.flatnonzero(real & (values.real > 1 + _GROWTH[1]))
        w = vectors[len(k) :, indices].real.T
        size = np.maximum((w**2).sum(axis=1), 1e-300)
        along_k, along_c = (((w @ part.T) * w).sum(axis=1) / size for part in (k, c))
        buckles = (along_k < 0) & (h * along_c < METHODS[integrator].real_limit)
        if not buckles.all():
            return True
    flow = flow[np.abs(flow.imag) > 1e-9 * np.abs(flow)]
    exact = np.exp((flow * h).real.clip(max=50.0) + 1j * (flow * h).imag)
    waves = values[~real | (values.real < 0)]
    for sign, growth in _GROWTH.items():
        if _count_growing_values(waves, sign, growth) > _count_growing_values(
            exact, sign, growth / 2
        ):
            return True
    return False


def _count_growing_values(values: npt.NDArray[Any], sign: int, growth: float) -> int:
    """Count the eigenvalues of a step that grow by more than `growth`, with that sign of Re."""
    return int(np.count_nonzero((np.abs(values) > 1 + growth) & (sign * values.real >= 0)))


def _search_step_matrix_limit(integrator: str, k: Floats, c: Floats, guess: float) -> float:
    """Search for the limit in a space: the first rising step that is unstable, then bisection."""
    mu, _ = solve_modes(k, c)
    if not np.abs(mu).max(initial=0) > 0:
        return np.inf
    unstable = partial(step_amplifies_modes, integrator, k, c, mu)
    low = 0.7 * guess
    while unstable(low):
        low *= 0.5
    high = low * _RATIO
    while not unstable(high):
        low = high
        high = high * _RATIO
        if high * np.abs(mu).max() > 1e6:
            return np.inf
    while high > (1 + _PRECISION) * low:
        middle = np.sqrt(low * high)
        if unstable(middle):
            high = middle
        else:
            low = middle
    return float(low)
