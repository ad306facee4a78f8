"""Moving air that presses on the triangles of a cloth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from .. import _core
from ..base import check
from ..typing import Numbers
from .motion import Motion, check_motion, motion_from_dict
from .record import Record


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Wind(Record):
    """Wind: pressure and shear of moving air on the triangles of a cloth.

    A triangle of the area A and the unit normal n meets air of the velocity u relative to the mean
    of its corners, with un = u.n and ut the part of u across n. Its force

        density / 2 A (normal sqrt(un^2 + w^2) un n + tangential sqrt(ut.ut + w^2) ut)

    acts on each corner with a third; w is 0.01 m/s. The triangles are those of `triangles`. The
    force is a part of the equation of motion, so that order, error control and derivatives hold in
    it; a triangle that turns through the wind has all but a kink in its force, which costs methods
    of high order steps. It is that of a plate in a flow: no lift from a wake, and no air that the
    cloth drags along.

    Parameters
    ----------
    velocity : sequence of 3 floats, default (0, 0, 0)
        Velocity of the air [m/s]. Air at rest slows a cloth down.
    density : float, default 1.225
        Density of the air [kg/m^3], >= 0.
    normal : float, default 1.2
        Coefficient of the pressure, >= 0. A square plate across a flow has 1.1 to 1.2.
    tangential : float, default 0.05
        Coefficient of the shear, both sides together, >= 0.
    motion : Linear, Reciprocate, Sinusoid or Keyframes, optional
        Its velocity is added to `velocity`: gusts. A `Sinusoid` with the amplitude a [m] and the
        frequency f makes gusts of 2 pi f a. The velocity of `Keyframes` is less smooth than a
        method of order 4 can use: it falls to some order 3 at a fixed step. Default: the wind is
        steady.

    Examples
    --------
    A flag in gusts between 4 and 8 m/s, once a second:

    >>> gusts = cs.Sinusoid(amplitude=(2 / (2 * 3.14159), 0, 0), frequency=1.0)
    >>> wind = cs.Wind((6.0, 0.0, 0.5), motion=gusts)
    >>> pins = [(row, 0) for row in range(8)]
    >>> flag = cs.Cloth((8, 12), (0.6, 0.9), 0.1, stiffness=50.0, damping=0.01, pins=pins)
    >>> run = cs.simulate(cs.Scene(flag, wind=wind), 0.5, rtol=1e-4)
    >>> run.report["error_estimate"]["rms"] < 1e-4
    True
    """

    velocity: tuple[float, float, float]
    density: float
    normal: float
    tangential: float
    motion: Motion | None

    @check.check_names
    def __init__(
        self,
        velocity: Numbers = (0.0, 0.0, 0.0),
        density: float = 1.225,
        normal: float = 1.2,
        tangential: float = 0.05,
        motion: Motion | None = None,
    ) -> None:
        self._set_attributes(
            velocity=check.vector("velocity", velocity),
            density=check.number("density", density, minimum=0),
            normal=check.number("normal", normal, minimum=0),
            tangential=check.number("tangential", tangential, minimum=0),
            motion=check_motion("motion", motion),
        )

    @cached_property
    def core(self) -> _core.Force:
        """The wind as the core takes it."""
        speed = self.motion.largest_speed if self.motion else 0.0
        values = [*self.velocity, self.density, self.normal, self.tangential, speed]
        return _core.Force("wind", values, self.motion.core if self.motion else _core.Motion())

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Wind:
        arguments = cls._check_argument_names(data)
        if "motion" in arguments:
            arguments["motion"] = motion_from_dict(arguments["motion"])
        return cls(**arguments)
