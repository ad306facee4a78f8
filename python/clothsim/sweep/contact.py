"""When a sphere first changed the cloth, to the step, whatever the response.

A step with the spheres and the same step with them far away give the same bits unless a response
acted. Running every member twice would be dear, so only stretches of time in which the cloth came
near a sphere are repeated, and the step is found in them by bisection.
"""

from __future__ import annotations

import math

import numpy as np

from ..errors import UnstableError
from ..scene import Scene
from ..stepping import step
from .member import Floats, Member

_FAR = 1e6  # m
_PLACES = 9  # of a sphere in a stretch of time that are looked at
_MARGIN = 4.0  # times the way that the fastest point goes in the stretch


class ContactWatch:
    """Watches one member until its first contact; is told the state now and then."""

    def __init__(self, member: Member) -> None:
        self.member = member
        self.scene = member.scene
        self.found = math.nan
        self._far = _without_contact(self.scene)
        self._gravity = float(np.linalg.norm(self.scene.gravity))
        self._start = (0.0, self.scene.initial_position, self.scene.initial_velocity)

    @property
    def waiting(self) -> bool:
        return bool(self.scene.spheres) and math.isnan(self.found)

    def look(self, t: float, x: Floats, v: Floats, dt: float, steps: int) -> None:
        """The state at time `t`, `steps` steps of `dt` after that of the last look."""
        begin, x0, v0 = self._start
        if self.waiting and self._near(begin, t, (x0, x), (v0, v)):
            self._search(begin, x0, v0, dt, steps)
        self._start = (t, x, v)

    def _near(
        self, begin: float, end: float, xs: tuple[Floats, ...], vs: tuple[Floats, ...]
    ) -> bool:
        duration = end - begin
        speed = max(float(np.sqrt((v**2).sum(axis=-1).max())) for v in vs)
        way = _MARGIN * duration * (speed + self._gravity * duration)
        cloth = self.scene.cloth
        # A response to triangles acts before a mass point is within the contact radius.
        way += math.hypot(*cloth.spacing)
        times = np.linspace(begin, end, _PLACES)
        for sphere in self.scene.spheres:
            centers = sphere.center_at(times)
            between = float(np.linalg.norm(np.diff(centers, axis=0), axis=-1).max())
            reach = sphere.contact_radius(cloth) + way + between
            for x in xs:
                for center in centers:
                    if float(((x - center) ** 2).sum(axis=-1).min()) <= reach**2:
                        return True
        return False

    def _search(self, t: float, x: Floats, v: Floats, dt: float, steps: int) -> None:
        def touched(count: int) -> bool:
            try:
                with_spheres, without = (
                    step(scene, x, v, dt, count, t, threads=1, **self.member.numerics)
                    for scene in (self.scene, self._far)
                )
            except UnstableError:
                return True  # the run with spheres was through here
            return any(
                a.tobytes() != b.tobytes() for a, b in zip(with_spheres, without, strict=True)
            )

        if not touched(steps):
            return
        free, hit = 0, steps
        while hit - free > 1:
            middle = (free + hit) // 2
            free, hit = (free, middle) if touched(middle) else (middle, hit)
        self.found = t + hit * dt


def _without_contact(scene: Scene) -> Scene:
    """The same computation with every sphere out of reach."""
    far = tuple(s.replace(center=(_FAR, _FAR, _FAR), motion=None) for s in scene.spheres)
    return scene.replace(spheres=far)
