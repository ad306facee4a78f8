"""Prescribed motions of a sphere: where its centre is and how fast it goes at any time.

A motion has two methods, ``center_at(t, center0)`` and ``velocity_at(t)``, where `center0` is the sphere's own centre.
The velocity is the exact derivative of the centre. At a kink of the path it is the velocity just after the kink.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np
import numpy.typing as npt

from ..base import check
from ..base.keywords import suggesting
from ..base.record import Record, frozen
from ..typing import Numbers

Vectors = npt.NDArray[np.float64]
Self = TypeVar("Self", bound="_Motion")


def _times(t: npt.ArrayLike) -> Vectors:
    accepted = "t must be a finite number or an array of finite numbers"
    given = check.as_array("t", t, accepted.removeprefix("t must be "))
    if given.dtype.kind not in "iuf":
        raise TypeError(f"{accepted}, got {check.shown(t)}")
    if not np.isfinite(given).all():
        raise ValueError(f"{accepted}, got {check.shown(t)}")
    return given.astype(np.float64)


class _Motion(Record):
    kind: ClassVar[str]

    def center_at(self, t: npt.ArrayLike, center0: Numbers) -> Vectors:
        """Centre of the sphere at the time `t`.

        Parameters
        ----------
        t : float or array_like
            Time [s]; any shape, negative times too.
        center0 : sequence of 3 floats
            The ``center`` of the sphere [m].

        Returns
        -------
        numpy.ndarray
            Positions [m], the shape of `t` with 3 appended.

        Examples
        --------
        >>> import clothsim as cs
        >>> cs.Linear(velocity=(0, 1, 0)).center_at(0.5, (0, 0, 0))
        array([0. , 0.5, 0. ])
        """
        return self._center(_times(t), np.array(check.vector("center0", center0)))

    def velocity_at(self, t: npt.ArrayLike) -> Vectors:
        """Velocity of the sphere at the time `t`; at a kink of the path, the velocity just after the kink.

        Parameters
        ----------
        t : float or array_like
            Time [s]; any shape, negative times too.

        Returns
        -------
        numpy.ndarray
            Velocities [m/s], the shape of `t` with 3 appended.

        Examples
        --------
        >>> import clothsim as cs
        >>> cs.Linear(velocity=(0, 1, 0)).velocity_at(0.5)
        array([0., 1., 0.])
        """
        return self._velocity(_times(t))

    def _center(self, t: Vectors, center0: Vectors) -> Vectors:
        raise NotImplementedError

    def _velocity(self, t: Vectors) -> Vectors:
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """Plain data as JSON and TOML can hold them, with the motion's name under "kind".

        Returns
        -------
        dict

        Examples
        --------
        >>> import clothsim as cs
        >>> cs.Linear(velocity=(0, 1, 0)).to_dict()
        {'kind': 'linear', 'velocity': [0.0, 1.0, 0.0]}
        """
        return {"kind": self.kind, **super().to_dict()}

    @classmethod
    def from_dict(cls: type[Self], data: Mapping[str, Any]) -> Self:
        """The motion that `data` (as from ``to_dict``) describes.

        Parameters
        ----------
        data : mapping
            "kind", the name of this motion, and its arguments.

        Returns
        -------
        instance of this class

        Raises
        ------
        ValueError
            For an unknown or missing key, another motion's "kind", or a refused value.
        TypeError
            If `data` is no mapping.

        Examples
        --------
        >>> import clothsim as cs
        >>> cs.Linear.from_dict({"kind": "linear", "velocity": [0, 1, 0]}).velocity
        (0.0, 1.0, 0.0)
        """
        arguments = cls._arguments(data, "kind")
        check.choice(f"{cls.__name__} kind", arguments.pop("kind"), (cls.kind,))
        return cls(**arguments)


@suggesting
@dataclass(frozen=True, eq=False, repr=False)
class Linear(_Motion):
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


@suggesting
@dataclass(frozen=True, eq=False, repr=False)
class Reciprocate(_Motion):
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


@suggesting
@dataclass(frozen=True, eq=False, repr=False)
class Keyframes(_Motion):
    """A table of times and centres, with straight lines at constant speed between them.

    Between times[n] and times[n + 1] the centre is centers[n] + (t - times[n]) v with
    v = (centers[n + 1] - centers[n]) / (times[n + 1] - times[n]). Before the first time the sphere rests at the first
    centre. From the last time on, it rests at the last centre. At a time of the table the velocity is that of the line
    that begins there.

    The centres are absolute, so the sphere's own ``center`` has no effect.

    Parameters
    ----------
    times : sequence of floats
        Times [s], at least 2, increasing.
    centers : array_like
        Centres [m], shape (len(times), 3).

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
    """

    times: Vectors
    centers: Vectors

    kind: ClassVar[str] = "keyframes"

    if TYPE_CHECKING:

        def __init__(self, times: Numbers, centers: npt.ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        count = check.size("times", self.times)
        if count < 2:
            raise ValueError(f"times must have at least 2 entries, got {count}")
        times = check.array("times", self.times, (count,))
        later = np.concatenate([[True], np.diff(times) > 0])
        check.check_all("times", times, later, "strictly increasing")
        centers = check.array("centers", self.centers, (count, 3))
        self._set(times=frozen(times), centers=frozen(centers))

    def _segment(self, t: Vectors) -> tuple[Vectors, Vectors, Vectors]:
        """For the line at the time `t`: the time since its start, its start and its velocity."""
        last = len(self.times) - 1
        n = np.searchsorted(self.times, t, side="right") - 1
        at = np.clip(n, 0, last)
        velocities = np.zeros_like(self.centers)
        velocities[:-1] = np.diff(self.centers, axis=0) / np.diff(self.times)[:, None]
        velocity = np.where((n < 0)[..., None], 0.0, velocities[at])
        return (t - self.times[at])[..., None], self.centers[at], velocity

    def _center(self, t: Vectors, center0: Vectors) -> Vectors:
        elapsed, start, velocity = self._segment(t)
        return start + elapsed * velocity

    def _velocity(self, t: Vectors) -> Vectors:
        return self._segment(t)[2]


Motion = Linear | Reciprocate | Keyframes
MOTIONS: dict[str, type[_Motion]] = {m.kind: m for m in (Linear, Reciprocate, Keyframes)}


def motion_from_dict(data: Mapping[str, Any]) -> Motion:
    """The motion that `data` describes, of the class that its "kind" names.

    Parameters
    ----------
    data : mapping
        "kind" ("linear", "reciprocate" or "keyframes") and the arguments of that motion.

    Returns
    -------
    Linear, Reciprocate or Keyframes

    Raises
    ------
    ValueError
        For an unknown kind or key, a missing one, or a refused value.
    TypeError
        If `data` is no mapping.

    Examples
    --------
    >>> from clothsim.model.motion import motion_from_dict
    >>> motion_from_dict({"kind": "linear", "velocity": [1, 0, 0]})
    Linear(velocity=(1.0, 0.0, 0.0))
    """
    if not isinstance(data, Mapping):
        raise TypeError(f"motion must be a mapping with a 'kind', got {check.shown(data)}")
    kind = check.choice("motion kind", data.get("kind", ""), MOTIONS)
    return MOTIONS[kind].from_dict(data)  # type: ignore[return-value]
