"""The fastest and the most damped motion of a cloth about a state, by power iteration."""

from __future__ import annotations

import math

import numpy as np

from .integration import integrators
from .plan import core_cloth
from .runs import Floats, Options, perturbation, rms, size_of
from .scene import Scene
from .stability.region import box_limit

_FIRST_PRODUCTS, _PRODUCTS = 8, 2  # to find it, and to follow it to a later state
_DISPLACEMENT = 1e-7  # of the size, by which derivatives are taken


class Stiffest:
    """Bounds of frequency and damping that a cloth has where it is.

    Roughly, for the price of a few force evaluations; `stability.spectrum` finds the limit itself.
    Those of `mode_bounds` hold in any state, and are nearly twice too large about most. A product
    with K = -da/dx or C = -da/dv costs one force evaluation, as a difference of two; following the
    run from state to state, the vector stays close to the fastest motion, so that few are enough.

    Attributes
    ----------
    omega, delta : float
        Largest angular frequency and damping rate [1/s], from a few percent below.
    evaluations : int
        Force evaluations it took.
    """

    def __init__(self, scene: Scene, options: Options) -> None:
        scene = scene.replace(spheres=())
        self._state = options.replace(precision="double", integrator="rk4").state(scene)
        self._displacement = _DISPLACEMENT * size_of(scene)
        self._vector = perturbation(scene, self._displacement)
        self.evaluations = 0
        self._bounds = core_cloth(scene).mode_bounds
        x, v = scene.initial_position, scene.initial_velocity
        at_rest, other = self._accelerations(x, v), self._vector
        self.delta = 0.0
        for _ in range(_FIRST_PRODUCTS if self._bounds[1] else 0):
            self.delta, other = self._product(at_rest, x, v + other, other)
        self.omega = 0.0
        self._follow(at_rest, x, v, _FIRST_PRODUCTS)
        self.delta = min(self.delta, self._bounds[1])

    def look(self, x: Floats, v: Floats) -> None:
        """Follow them to the state (x, v)."""
        before = self.omega
        self._follow(self._accelerations(x, v), x, v, _PRODUCTS)
        # What springs are damped by changes as their stiffness does: both by their directions.
        if before and self.omega:
            self.delta = min(self.delta * (self.omega / before) ** 2, self._bounds[1])

    def limit(self, integrator: str, damping: float = 1.0) -> float:
        """The stable time step [s], with that part of the damping."""
        if not integrators()[integrator].explicit or not (self.omega or self.delta):
            return math.inf
        return box_limit(integrator, self.omega, damping * self.delta)

    def _follow(self, at_rest: Floats, x: Floats, v: Floats, products: int) -> None:
        square = 0.0
        for _ in range(products):
            found, self._vector = self._product(at_rest, x + self._vector, v, self._vector)
            square = max(square, found)
        self.omega = math.sqrt(min(square, self._bounds[0]))

    def _product(self, at_rest: Floats, x: Floats, v: Floats, vector: Floats) -> tuple[float, Floats]:
        """By how much a product makes the vector longer, and its direction."""
        change = self._accelerations(x, v) - at_rest
        size = rms(change)
        if not 0 < size < math.inf:
            return 0.0, vector
        return size / self._displacement, change * (self._displacement / size)

    def _accelerations(self, x: Floats, v: Floats) -> Floats:
        result = np.empty_like(x)
        self._state.core.load(x, v)
        self._state.core.accelerations(result, self._state.threads)
        self.evaluations += 1
        return result
