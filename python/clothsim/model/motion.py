"""Prescribed motions of a sphere or a pin: where it is and how fast it goes at any time.

A motion has two methods, ``center_at(t, center0)`` and ``velocity_at(t)``, where `center0` is the sphere's own centre.
The velocity is the exact derivative of the centre. At a kink of the path it is the velocity just after the kink.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from ..base import check
from ..base.record import frozen
from ..typing import Numbers
from .motion_base import BaseMotion, Vectors


@dataclass(frozen=True, eq=False, repr=False)
class Linear(BaseMotion):
    """Constant velocity: c(t) = c0 + velocity t, with c0 the sphere's ``center``.

    Parameters
    ----------
    velocity : sequence of 3 floats
        Velocity of the sphere [m/s].

    Raises
    ------
    ValueError, TypeError
        If `velocity` is not three finite numbers.

    Examples
    --------
    >>> import clothsim as cs
    >>> motion = cs.Linear((1.0, 0.0, 0.0))
    >>> motion.center_at(0.5, (0.0, -0.5, 0.5)).tolist()
    [0.5, -0.5, 0.5]
    >>> motion.velocity_at(0.5).tolist()
    [1.0, 0.0, 0.0]
    """

    velocity: tuple[float, float, float]

    kind: ClassVar[str] = "linear"

    if TYPE_CHECKING:  # the constructors take more than the fields hold

        def __init__(self, velocity: Numbers) -> None: ...

    def __post_init__(self) -> None:
        self._set(velocity=check.vector("velocity", self.velocity))

    def _center(self, t: Vectors, center0: Vectors) -> Vectors:
        way: Vectors = t[..., None] * np.array(self.velocity)
        return center0 + way

    def _velocity(self, t: Vectors) -> Vectors:
        return np.broadcast_to(self.velocity, (*t.shape, 3)).copy()


@dataclass(frozen=True, eq=False, repr=False)
class Reciprocate(BaseMotion):
    """Back and forth about the sphere's ``center``, fast at first and slow at the turning points.

    The centre travels between the turning points c0 - u distance/2 and c0 + u distance/2, with u
    the unit vector along `direction`. With T the `period`, k the `deceleration` and
    w = frac(t/T + phase)::

        s, q = (+1, 2w) if w < 1/2 else (-1, 2w - 1)     way there or back, done part of it
        g(q) = (1 - exp(-k q)) / (1 - exp(-k))           q for k = 0
        c(t) = c0 + s (g(q) - 1/2) distance u
        v(t) = s k exp(-k q) / (1 - exp(-k)) (2/T) distance u     s (2/T) distance u for k = 0

    Kim et al. (section 6) move their sphere over unit length about the cloth's centre and slow it
    down by linear interpolation. A sphere that goes a fixed fraction of the remaining way in every frame follows an
    exponential, if frames are short. Here the exponential is scaled so that the sphere reaches the turning point
    exactly after half a period.

    Parameters
    ----------
    direction : sequence of 3 floats
        Direction of the travel, any length but zero.
    distance : float, default 1.0
        Distance between the turning points [m], > 0.
    period : float, default 3.6
        Time there and back [s], > 0.
    deceleration : float, default 5.0
        The k of the formulas, dimensionless, >= 0. The sphere arrives at a turning point exp(-k) times as fast as it
        leaves. 0 gives constant speed.
    phase : float, default 0.0
        Part of the period that is over at t = 0, 0 <= phase < 1. With 0 the sphere starts at
        c0 - u distance/2 towards +u, with 0.5 at c0 + u distance/2 towards -u.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.

    Examples
    --------
    >>> import clothsim as cs
    >>> motion = cs.Reciprocate((1, 0, 0), distance=1.0, period=2.0)
    >>> motion.center_at([0.0, 1.0, 2.0], (0.0, -0.5, 0.5)).tolist()
    [[-0.5, -0.5, 0.5], [0.5, -0.5, 0.5], [-0.5, -0.5, 0.5]]
    >>> speed = motion.velocity_at([0.0, 0.5, 0.999999])[:, 0]
    >>> [round(float(v), 4) for v in speed]
    [5.0339, 0.4132, 0.0339]
    """

    direction: tuple[float, float, float]
    distance: float = 1.0
    period: float = 3.6
    deceleration: float = 5.0
    phase: float = 0.0

    kind: ClassVar[str] = "reciprocate"

    if TYPE_CHECKING:

        def __init__(
            self,
            direction: Numbers,
            distance: float = 1.0,
            period: float = 3.6,
            deceleration: float = 5.0,
            phase: float = 0.0,
        ) -> None: ...

    def __post_init__(self) -> None:
        direction = check.vector("direction", self.direction)
        if math.hypot(*direction) == 0.0:
            raise ValueError(f"direction must not be the zero vector, got {self.direction!r}")
        phase = check.number("phase", self.phase, minimum=0)
        if phase >= 1.0:
            raise ValueError(f"phase must be a finite number >= 0 and < 1, got {self.phase!r}")
        self._set(
            direction=direction,
            distance=check.number("distance", self.distance, minimum=0, exclusive=True),
            period=check.number("period", self.period, minimum=0, exclusive=True),
            deceleration=check.number("deceleration", self.deceleration, minimum=0),
            phase=phase,
        )

    @property
    def unit_direction(self) -> tuple[float, float, float]:
        """`direction` scaled to length 1."""
        length = math.hypot(*self.direction)
        x, y, z = (component / length for component in self.direction)
        return x, y, z

    def kinks(self, begin: float, end: float) -> list[float]:
        first, last = (math.floor(2 * (t / self.period + self.phase)) for t in (begin, end))
        if last - first > _MOST_KINKS:
            least = 2 * (end - begin) / _MOST_KINKS
            raise ValueError(
                f"period must be at least {least:.3g} s, as error control ends a step at each turning point of "
                f"{end - begin:g} s, got {self.period:g}: give dt"
            )
        times = ((n / 2 - self.phase) * self.period for n in range(first, last + 1))
        return [t for t in times if begin < t < end]

    def _way(self, t: Vectors) -> tuple[Vectors, Vectors]:
        """(s, q) of the class's formulas."""
        turns = t / self.period + self.phase
        w = turns - np.floor(turns)
        back = w >= 0.5
        return np.where(back, -1.0, 1.0), 2.0 * w - back

    def _center(self, t: Vectors, center0: Vectors) -> Vectors:
        sign, q = self._way(t)
        k = self.deceleration
        done = np.expm1(-k * q) / math.expm1(-k) if k else q
        along: Vectors = sign * (done - 0.5) * self.distance
        way: Vectors = along[..., None] * np.array(self.unit_direction)
        return center0 + way

    def _velocity(self, t: Vectors) -> Vectors:
        sign, q = self._way(t)
        k = self.deceleration
        slope = k * np.exp(-k * q) / -math.expm1(-k) if k else np.ones_like(q)
        along: Vectors = sign * slope * (2.0 / self.period) * self.distance
        velocity: Vectors = along[..., None] * np.array(self.unit_direction)
        return velocity


@dataclass(frozen=True, eq=False, repr=False)
class Keyframes(BaseMotion):
    """A table of times and centres or displacements, with straight lines at constant speed between them.

    Between times[n] and times[n + 1] the centre is centers[n] + (t - times[n]) v with
    v = (centers[n + 1] - centers[n]) / (times[n + 1] - times[n]). Before the first time the sphere rests at the first
    centre. From the last time on, it rests at the last centre. At a time of the table the velocity is that of the line
    that begins there.

    `centers` are absolute, so the sphere's own ``center`` has no effect. `offsets` are displacements from the sphere's
    ``center`` or from the pin's initial position, so that many pins can share a motion.

    Parameters
    ----------
    times : sequence of floats
        Times [s], at least 2, increasing.
    centers : array_like, optional
        Centres [m], shape (len(times), 3).
    offsets : array_like, optional
        Displacements from the start [m], shape (len(times), 3), in place of `centers`.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.

    Examples
    --------
    >>> import clothsim as cs
    >>> motion = cs.Keyframes([0.0, 1.0, 3.0], [(0, 0, 0), (1, 0, 0), (1, 4, 0)])
    >>> motion.center_at([-1.0, 0.5, 2.0, 9.0], (0, 0, 0)).tolist()
    [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [1.0, 2.0, 0.0], [1.0, 4.0, 0.0]]
    >>> motion.velocity_at([-1.0, 0.5, 1.0, 3.0]).tolist()
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 0.0]]
    >>> cs.Keyframes([0.0, 1.0], offsets=[(0, 0, 0), (0, 2, 0)]).center_at(0.5, (1, 0, 0)).tolist()
    [1.0, 1.0, 0.0]
    """

    times: Vectors
    centers: Vectors | None = None
    offsets: Vectors | None = None

    kind: ClassVar[str] = "keyframes"

    if TYPE_CHECKING:

        def __init__(
            self, times: Numbers, centers: npt.ArrayLike | None = None, offsets: npt.ArrayLike | None = None
        ) -> None: ...

    def __post_init__(self) -> None:
        count = check.size("times", self.times)
        if count < 2:
            raise ValueError(f"times must have at least 2 entries, got {count}")
        times = check.array("times", self.times, (count,))
        later = np.concatenate([[True], np.diff(times) > 0])
        check.check_all("times", times, later, "strictly increasing")
        given = {name: getattr(self, name) for name in ("centers", "offsets") if getattr(self, name) is not None}
        if len(given) != 1:
            raise ValueError(f"one of centers and offsets must be given, got {' and '.join(given) or 'none of them'}")
        self._set(times=frozen(times), **{n: frozen(check.array(n, v, (count, 3))) for n, v in given.items()})

    @property
    def places(self) -> Vectors:
        """`centers` or `offsets`, whichever is given."""
        places = self.offsets if self.centers is None else self.centers
        assert places is not None
        return places

    def kinks(self, begin: float, end: float) -> list[float]:
        return [float(t) for t in self.times if begin < t < end]

    def _segment(self, t: Vectors) -> tuple[Vectors, Vectors, Vectors]:
        """For the line at the time `t`: the time since its start, its start and its velocity."""
        last = len(self.times) - 1
        n = np.searchsorted(self.times, t, side="right") - 1
        at = np.clip(n, 0, last)
        velocities = np.zeros_like(self.places)
        velocities[:-1] = np.diff(self.places, axis=0) / np.diff(self.times)[:, None]
        velocity = np.where((n < 0)[..., None], 0.0, velocities[at])
        return (t - self.times[at])[..., None], self.places[at], velocity

    def _center(self, t: Vectors, center0: Vectors) -> Vectors:
        elapsed, start, velocity = self._segment(t)
        return start + elapsed * velocity + (center0 if self.centers is None else 0.0)

    def _velocity(self, t: Vectors) -> Vectors:
        return self._segment(t)[2]


_MOST_KINKS = 1_000_000  # of a motion in a run, each of which costs a step

Motion = Linear | Reciprocate | Keyframes
MOTIONS: dict[str, type[BaseMotion]] = {m.kind: m for m in (Linear, Reciprocate, Keyframes)}


def motion_from_dict(data: Mapping[str, Any]) -> Motion:
    """The motion that `data` describes: "kind" ("linear", "reciprocate" or "keyframes"), and the arguments of that class."""
    if not isinstance(data, Mapping):
        raise TypeError(f"motion must be a mapping with a 'kind', got {check.shown(data)}")
    kind = check.choice("motion kind", data.get("kind", ""), MOTIONS)
    return MOTIONS[kind].from_dict(data)  # type: ignore[return-value]
