"""The energy watch of the core (`EnergyWatch`) for the adapter, for runs above the guaranteed time step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .. import _core
from ..model.as_core import core_cloth
from ..model.scene import Scene
from .planes import arrays_of


class EnergyWatch:
    """Detects that unstable steps made nearly all of a cloth's energy, as long as no sphere has touched the cloth."""

    def __init__(self, scene: Scene) -> None:
        self._scene, self._cloth = scene, core_cloth(scene)
        cloth = scene.cloth
        row, column = cloth.spacing
        held = sum(
            cloth.family_stiffness[family]
            / 2
            * ((rows * row) ** 2 + (columns * column) ** 2)
            * (2 if rows and columns else 1)
            for family, rows, columns in _core.spring_kinds
            if family in cloth.families
        )
        self._negligible = _core.negligible_part * cloth.rows * cloth.columns * held
        self.restart()

    def restart(self) -> None:
        """Forget the first state of the run."""
        self._start: float | None = None

    def runaway_point(self, x: np.ndarray, v: np.ndarray) -> int | None:
        """The index of the fastest mass point if the energy has run away, else None.

        Parameters
        ----------
        x, v : numpy.ndarray
            Positions [m] and velocities [m/s], float64, shape (rows, columns, 3).
        """
        kinetic, elastic, gravity, _ = _core.energy(self._cloth, self._scene.gravity, None, x, v)
        total = kinetic + elastic + gravity
        if self._start is None:
            self._start = total
        made = total - self._start
        if not (made > self._negligible and made > _core.runaway_part * (kinetic + elastic)):
            return None
        return int((v**2).sum(axis=-1).argmax())


class EnergyWatches:
    """Energy watches of the members whose energy only the time step can raise."""

    def __init__(self, scenes: Sequence[Scene]) -> None:
        self._scenes = scenes
        self._watches: dict[int, EnergyWatch] = {}
        self._watched: list[int] = []

    def restart(self) -> None:
        """Forget the states where runs began."""
        for watch in self._watches.values():
            watch.restart()

    def choose(self, dt: float, stable_dt: Sequence[float], frozen: Sequence[bool], contacts: Sequence[int]) -> bool:
        """Watch the members whose guaranteed step is below `dt` [s]. Return whether there are such members.

        A sphere may give energy from its first response on. The adapter does not count responses of "continuous"
        spheres, so members with such a sphere are not watched.
        """
        self._watched = [
            member
            for member, scene in enumerate(self._scenes)
            if not frozen[member]
            and not contacts[member]
            and dt > stable_dt[member]
            and all(sphere.response != "continuous" for sphere in scene.spheres)
        ]
        for member in self._watched:
            if member not in self._watches:
                self._watches[member] = EnergyWatch(self._scenes[member])
        return bool(self._watched)

    def runaway(self, planes: np.ndarray, contacts: Sequence[int]) -> tuple[int, int] | None:
        """The first watched member whose energy has run away, and its fastest mass point.

        Parameters
        ----------
        planes : numpy.ndarray
            The state, shape (members, 6, points), float64.
        contacts : sequence of int
            Responses so far, per member.
        """
        for member in self._watched:
            if contacts[member]:
                continue
            x, v = arrays_of(planes[member], (*self._scenes[member].cloth.shape, 3))
            point = self._watches[member].runaway_point(x, v)
            if point is not None:
                return member, point
        return None
