"""A small space that grows, with the projections of K and C on it (Galerkin)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..base import Floats

Operator = Callable[[Floats], Floats]

MOST_VECTORS = 48
"""Vectors in the space; a larger one is reduced to the modes of interest."""
_MOST_PRODUCTS = 600


class Subspace:
    """Orthonormal rows, their products with K and C, and the projected matrices `k` and `c`."""

    def __init__(self, stiffness: Operator, damping: Operator) -> None:
        self.stiffness, self.damping = stiffness, damping
        self.basis = np.empty((0, 0))
        self.products = 0

    def extend(self, vectors: Floats) -> int:
        """Extend the space by the vectors (in rows); return the number of new rows."""
        if not self.basis.shape[1]:
            empty = np.empty((0, vectors.shape[1]))
            self.basis, self._k_basis, self._c_basis = empty, empty, empty
        new = orthonormal(vectors, self.basis)
        if len(self.basis) and not len(new):
            return 0
        self.products += len(new)
        self.basis = np.concatenate([self.basis, new])
        self._k_basis = np.concatenate([self._k_basis, self.stiffness(new)])
        self._c_basis = np.concatenate([self._c_basis, self.damping(new)])
        self._project()
        return len(new)

    def _project(self) -> None:
        self.k, self.c = dots(self.basis, self._k_basis), dots(self.basis, self._c_basis)

    def full(self, size: int) -> bool:
        """Whether the space has the full dimension, or further products would be too many."""
        return len(self.basis) >= size or self.products >= _MOST_PRODUCTS

    def crowded(self, more: int) -> bool:
        return len(self.basis) + more > MOST_VECTORS

    def vectors(self, weights: Any) -> Any:
        """Vectors (in rows) with these coordinates, real or complex."""
        if np.iscomplexobj(weights):
            return sums(weights.real, self.basis) + 1j * sums(weights.imag, self.basis)
        return sums(weights, self.basis)

    def residuals(self, rate: Any, modes: Any) -> Floats:
        """(mu^2 + mu C + K) y of modes y (in rows): the real parts, then the imaginary ones."""
        rate = rate[:, None]
        return np.concatenate(
            [
                sums(part(rate**2 * modes), self.basis)
                + sums(part(rate * modes), self._c_basis)
                + sums(part(modes), self._k_basis)
                for part in (np.real, np.imag)
            ]
        )

    def reduce(self, modes: Any) -> None:
        """Keep the space that the modes (coordinates in rows) span."""
        parts = np.concatenate([modes.real, modes.imag])
        kept = orthonormal(parts, np.empty((0, len(self.basis))))
        self.basis, self._k_basis, self._c_basis = (sums(kept, rows) for rows in (self.basis, self._k_basis, self._c_basis))
        self._project()


# einsum, not @: products this flat gain nothing from the threads of a BLAS, which wait for each other
# where processors are busy.
def dots(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("ik,jk->ij", a, b))


def sums(weights: Floats, vectors: Floats) -> Floats:
    return np.asarray(np.einsum("ij,jk->ik", weights, vectors))


def orthonormal(vectors: Floats, basis: Floats) -> Floats:
    """The part of `vectors` outside the span of the orthonormal rows of `basis`, as orthonormal rows."""
    found = basis
    for vector in vectors:
        size = np.sqrt((vector**2).sum())
        if size == 0:
            continue
        vector = vector[None] / size
        for _ in range(2):  # twice is enough to be orthogonal to the last bit
            vector = vector - sums(dots(vector, found), found)
        rest = np.sqrt((vector**2).sum())
        if rest > 1e-10:
            vector = vector / rest
            vector = vector - sums(dots(vector, found), found)
            found = np.concatenate([found, vector / np.sqrt((vector**2).sum())])
    return found[len(basis) :]
