"""The numba kernel as a work for timing, with their arrays prepared from a scene."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

import clothsim as cs
import numpy as np
from timing import Work

from .numpy_peer import spring_kinds

# Row and column offsets of the springs that the kernel is written for, in its order.
_KINDS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0))
_FAR = 1e3  # m; where border points are, out of reach and finite when squared


def import_kernels() -> Any:
    """Return the kernel's module; raise an ImportError where numba cannot be imported."""
    if find_spec("numba") is None:
        raise ImportError("numba is not installed: run pip install numba")
    try:
        from . import numba_kernels
    except Exception as error:  # an OSError where a library of its own cannot be loaded
        raise ImportError(f"numba cannot be imported: {type(error).__name__}: {error}") from error
    return numba_kernels


def set_threads(threads: int) -> None:
    """Make numba use `threads` threads from here on."""
    import numba

    numba.set_num_threads(threads)


class NumbaPeer(Work):
    """RK4 by numba: planes, branch-free unrolled neighbours, fastmath; a scene or a batch."""

    def __init__(
        self,
        scene: cs.Scene | Sequence[cs.Scene],
        x: np.ndarray,
        v: np.ndarray,
        dt: float,
        dtype: type[Any],
        threads: int,
    ) -> None:
        self.kernels = kernels = import_kernels()
        self.threads = threads
        scenes = [scene] if isinstance(scene, cs.Scene) else list(scene)
        self.batched = not isinstance(scene, cs.Scene)
        cloth = scenes[0].cloth
        rows, columns = cloth.shape
        border = kernels.BORDER
        self.interior = (Ellipsis, slice(border, border + rows), slice(border, border + columns))
        members = len(scenes)
        shape = (members, 6, rows + 2 * border, columns + 2 * border)
        state = np.zeros(shape, dtype)
        state[:, :3] = _FAR
        xv = np.concatenate([x, v], axis=-1).reshape(members, rows, columns, 6)
        state[self.interior] = np.moveaxis(xv, -1, 1)
        spring = np.stack([_strided_springs(member, dtype) for member in scenes])
        at = np.arange(columns)
        column = [at + 1 < columns, at >= 1, at + 2 < columns, at >= 2]
        force: np.ndarray = np.zeros((members, 3 * rows * columns), dtype)
        self.state = state if self.batched else state[0]

        def flat(array: np.ndarray) -> np.ndarray:
            array = array.reshape(members, -1)
            return array if self.batched else array[0]

        self.arguments: tuple[Any, ...] = (
            flat(state),
            flat(state.copy()),
            flat(state.copy()),
            tuple(flat(force.copy()) for _ in range(3)),
            (
                spring if self.batched else spring[0],
                np.array(column, dtype).ravel(),
                np.array(scenes[0].gravity, dtype),
                (~cloth.pinned).astype(dtype).ravel(),
            ),
            (dtype(1), dtype(dt), dtype(dt / 2), dtype(dt / 6)),
        )
        of_shape = kernels.strided(cloth.shape)
        self.kernel = of_shape.serial if threads == 1 else of_shape.parallel
        if self.batched:
            self.kernel = of_shape.batch

    def prepare(self) -> None:
        set_threads(self.threads)

    def run(self, steps: int) -> None:
        self.kernel(steps, 1 if self.batched else self.threads, *self.arguments)

    @property
    def positions(self) -> np.ndarray:
        return np.moveaxis(self.state[self.interior], -3, -1)[..., :3]

    @property
    def velocities(self) -> np.ndarray:
        return np.moveaxis(self.state[self.interior], -3, -1)[..., 3:]


class NumbaSlopes:
    """The numba kernel's forces as a right-hand side dy/dt = f(t, y) for a general solver.

    y has 6 rows columns entries: the planes of x, y, z and of the three velocities.
    """

    def __init__(self, scene: cs.Scene, threads: int) -> None:
        x, v = scene.initial_position, scene.initial_velocity
        peer = NumbaPeer(scene, x, v, 1.0, np.float64, threads)
        self.threads = threads
        self.shape = (6, *scene.cloth.shape)
        of_shape = peer.kernels.strided(scene.cloth.shape)
        self.kernel = of_shape.parallel_slopes if threads > 1 else of_shape.serial_slopes
        self.state = peer.arguments[0]
        self.scene = peer.arguments[4]
        self.start = np.moveaxis(np.concatenate([x, v], axis=-1), -1, 0).ravel()

    def __call__(self, t: float, y: np.ndarray) -> np.ndarray:
        slope = np.empty_like(y)
        self.kernel(self.threads, y, slope, self.state, self.scene, 1.0)
        return slope

    def points(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities, shape (rows, columns, 3)."""
        fields = np.moveaxis(y.reshape(self.shape), 0, -1)
        return fields[..., :3], fields[..., 3:]


def _strided_springs(scene: cs.Scene, dtype: type[Any]) -> np.ndarray:
    """Stiffness, stiffness x rest length and damping per mass of the six kinds; 0 if left out."""
    mass = scene.cloth.mass_per_point[0, 0]
    present = {(r, c): (k, k * rest, damping) for r, c, k, rest, damping in spring_kinds(scene)}
    if unknown := sorted(set(present) - set(_KINDS)):
        raise ValueError(f"the numba kernel has no springs with the offsets {unknown}")
    return np.asarray(
        np.array([present.get(offset, (0, 0, 0)) for offset in _KINDS], dtype) / dtype(mass)
    )
