"""Prescribed motions of a sphere or a pin: where it is and how fast it goes at any time.

A motion consists of pieces (`PIECE`). With u = (t - begin) / length, the displacement on a piece
is::

    p0 + u p1 + u^2 p2 + ... + u^5 p5 + amplitude g(u)
    g(u) = sin(angle u)    or, where decay k > 0,    (1 - exp(-k u)) / (1 - exp(-k))

The pieces of a periodic motion cover one period: `begin` and `length` are then parts of it, and
frac(t / period + phase) takes the place of t. The first and the last piece of any other motion have
no end.

The classes here make the pieces. `_core.Motion` evaluates them for Python and the core, `motionAt`
(viewing/web/solver.js) for the live page, and cpp/reference/pins.hpp for the scalar reference.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from .. import _core
from ..base import check, make_read_only
from ..errors import warn_caller
from ..typing import Numbers
from .record import Record

Vectors = npt.NDArray[np.float64]

# The fields are those of MotionPiece in cpp/model/motion.hpp, with polynomial = (p0, ..., p5).
# Units: s (or parts of the period), m, rad, 1.
PIECE = np.dtype(
    [
        ("begin", "f8"),
        ("length", "f8"),
        ("polynomial", "f8", (6, 3)),
        ("amplitude", "f8", 3),
        ("angle", "f8"),
        ("decay", "f8"),
    ]
)

# Part of the range of its keys by which a smooth curve may leave it without a warning. A curve that
# turns at a key between two others leaves it by some 2 %.
_OVERSHOOT = 0.01
_MOST_STOPS = 1_000_000  # of a motion in a run, each of which costs a step


class BaseMotion(Record):
    kind: ClassVar[str]
    relative = True  # displacements count from the start, not from the origin
    _period = 0.0  # s; 0: not periodic
    _phase = 0.0  # part of the period

    @cached_property
    def pieces(self) -> npt.NDArray[Any]:
        """The pieces, of dtype `PIECE`, by their beginnings."""
        raise NotImplementedError

    @cached_property
    def core(self) -> _core.Motion:
        """This motion as the core takes it."""
        return _core.Motion(self.pieces.view(np.float64), self._period, self._phase, self.relative)

    @cached_property
    def largest_speed(self) -> float:
        """The largest speed, within 1e-3 of it [m/s]."""
        pieces = self.pieces
        phase = self._phase
        parts = np.linspace(0.0, 1.0, 65)
        times = (pieces["begin"][:, None] + parts * pieces["length"][:, None]).ravel()
        if self._period:
            times = (times - phase) * self._period
        return float(np.linalg.norm(self._velocities_at(times), axis=-1).max())

    @property
    def pieces_for_pages(self) -> dict[str, Any]:
        """The pieces as plain data."""
        pieces = [
            {name: piece[name].tolist() for name in PIECE.fields}  # type: ignore[union-attr]
            for piece in self.pieces
        ]
        return {
            "pieces": pieces,
            "period": self._period,
            "phase": self._phase,
            "relative": self.relative,
        }

    def center_at(self, t: npt.ArrayLike, center0: Numbers) -> Vectors:
        """Return the centre of the sphere at the time `t` [m], the shape of `t` with 3 appended.

        Parameters
        ----------
        t : float or array_like
            Time [s].
        center0 : sequence of 3 floats
            The ``center`` of the sphere [m].

        Examples
        --------
        >>> cs.Linear(velocity=(0, 1, 0)).center_at(0.5, (0, 0, 0))
        array([0. , 0.5, 0. ])
        """
        return self._centers_at(_check_times(t), np.array(check.vector("center0", center0)))

    def velocity_at(self, t: npt.ArrayLike) -> Vectors:
        """Return the velocity of the sphere [m/s], the derivative of `center_at`; where it jumps,
        the velocity just after.

        Parameters
        ----------
        t : float or array_like
            Time [s].

        Examples
        --------
        >>> cs.Linear(velocity=(0, 1, 0)).velocity_at(0.5)
        array([0., 1., 0.])
        """
        return self._velocities_at(_check_times(t))

    def _ends_of_pieces(self, begin: float, end: float) -> list[float]:
        """Return the times between `begin` and `end` at which a piece ends."""
        begins = self.pieces["begin"].tolist()
        period = self._period
        phase = self._phase
        times = begins[1:]
        if period:
            first, last = (math.floor(t / period + phase) for t in (begin, end))
            if (last - first) * len(begins) > _MOST_STOPS:
                least = len(begins) * (end - begin) / _MOST_STOPS
                raise ValueError(
                    f"period must be at least {least:.3g} s, as error control ends a step at each "
                    f"turn of {end - begin:g} s, got {period:g} s of {self!r}: give dt"
                )
            times = [(n + b - phase) * period for n in range(first, last + 1) for b in begins]
        return [t for t in times if begin < t < end]

    def _centers_at(self, t: Vectors, center0: Vectors) -> Vectors:
        return self._offsets_and_velocities_at(t)[..., :3] + (center0 if self.relative else 0.0)

    def _velocities_at(self, t: Vectors) -> Vectors:
        return self._offsets_and_velocities_at(t)[..., 3:].copy()

    def _offsets_and_velocities_at(self, t: Vectors) -> Vectors:
        return self.core.states(t.ravel()).reshape(*t.shape, 6)

    def to_dict(self) -> dict[str, Any]:
        return {"kind": self.kind, **super().to_dict()}

    @classmethod
    def _check_argument_names(cls, data: Mapping[str, Any], *more: str) -> dict[str, Any]:
        arguments = super()._check_argument_names(data, "kind", *more)
        check.choice(f"{cls.__name__} kind", arguments.pop("kind"), (cls.kind,))
        return arguments


def _check_times(t: npt.ArrayLike) -> Vectors:
    return check.array("t", t, kind="a finite number or an array of finite numbers")


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Linear(BaseMotion):
    """Constant velocity: c(t) = c0 + velocity t, with c0 the sphere's ``center``.

    Parameters
    ----------
    velocity : sequence of 3 floats
        Velocity of the sphere [m/s].

    Examples
    --------
    >>> cs.Linear((1.0, 0.0, 0.0)).center_at(0.5, (0.0, -0.5, 0.5)).tolist()
    [0.5, -0.5, 0.5]
    """

    velocity: tuple[float, float, float]

    kind: ClassVar[str] = "linear"

    @check.check_names
    def __init__(self, velocity: Numbers) -> None:
        self._set_attributes(velocity=check.vector("velocity", velocity))

    @cached_property
    def pieces(self) -> npt.NDArray[Any]:
        return _make_pieces([0.0], [1.0], (np.zeros((1, 3)), [self.velocity]))


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Reciprocate(BaseMotion):
    """Back and forth about the sphere's ``center``, fast at first and slow at the turning points.

    The centre travels between the turning points c0 - u distance/2 and c0 + u distance/2, with u
    the unit vector along `direction`. With T the `period`, k the `deceleration` and
    w = frac(t/T + phase)::

        s, q = (+1, 2w) if w < 1/2 else (-1, 2w - 1)     way there or back, done part of it
        g(q) = (1 - exp(-k q)) / (1 - exp(-k))           q for k = 0
        c(t) = c0 + s (g(q) - 1/2) distance u
        v(t) = s k exp(-k q) / (1 - exp(-k)) (2/T) distance u     s (2/T) distance u for k = 0

    Kim et al. (section 6) slow their sphere down by linear interpolation. A sphere that goes a
    fixed fraction of the remaining way in every frame follows an exponential, here scaled so that
    it reaches the turning point exactly after half a period. There its velocity jumps.

    Parameters
    ----------
    direction : sequence of 3 floats
        Direction of the travel, any length but zero.
    distance : float, default 1.0
        Distance between the turning points [m], > 0.
    period : float, default 3.6
        Time there and back [s], > 0.
    deceleration : float, default 5.0
        The k of the formulas, dimensionless, >= 0. The sphere arrives at a turning point exp(-k)
        times as fast as it leaves. 0 gives constant speed.
    phase : float, default 0.0
        Part of the period that is over at t = 0, 0 <= phase < 1. With 0 the sphere starts at
        c0 - u distance/2 towards +u, with 0.5 at c0 + u distance/2 towards -u.

    Examples
    --------
    >>> motion = cs.Reciprocate((1, 0, 0), distance=1.0, period=2.0)
    >>> motion.center_at([0.0, 1.0, 2.0], (0.0, -0.5, 0.5)).tolist()
    [[-0.5, -0.5, 0.5], [0.5, -0.5, 0.5], [-0.5, -0.5, 0.5]]
    >>> motion.velocity_at([0.0, 0.5, 0.999999])[:, 0].round(4).tolist()
    [5.0339, 0.4132, 0.0339]
    """

    direction: tuple[float, float, float]
    distance: float
    period: float
    deceleration: float
    phase: float

    kind: ClassVar[str] = "reciprocate"

    @check.check_names
    def __init__(
        self,
        direction: Numbers,
        distance: float = 1.0,
        period: float = 3.6,
        deceleration: float = 5.0,
        phase: float = 0.0,
    ) -> None:
        if not any(vector := check.vector("direction", direction)):
            raise ValueError(f"direction must not be the zero vector, got {direction!r}")
        self._set_attributes(
            direction=vector,
            distance=check.number("distance", distance, minimum=0, exclusive=True),
            period=check.number("period", period, minimum=0, exclusive=True),
            deceleration=check.number("deceleration", deceleration, minimum=0),
            phase=_check_phase(phase),
        )
        self._set_attributes(_period=self.period, _phase=self.phase)

    @cached_property
    def pieces(self) -> npt.NDArray[Any]:
        way = self.distance * np.array(self.direction) / math.hypot(*self.direction)
        ways = np.stack([way, -way])
        if self.deceleration:
            return _make_pieces(
                [0.0, 0.5], 0.5, [-0.5 * ways], amplitude=ways, decay=self.deceleration
            )
        return _make_pieces([0.0, 0.5], 0.5, [-0.5 * ways, ways])


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Sinusoid(BaseMotion):
    """Harmonic motion about the sphere's ``center``: c(t) = c0 + amplitude sin(2 pi (frequency t +
    phase)).

    A driven pin begins at its initial position, where the sine has the value of t = 0.

    Parameters
    ----------
    amplitude : sequence of 3 floats
        Displacement at the turning point [m].
    frequency : float
        Periods per second [Hz], > 0.
    phase : float, default 0.0
        Part of the period that is over at t = 0, 0 <= phase < 1. 0.25 starts at rest at the turning
        point.

    Examples
    --------
    >>> motion = cs.Sinusoid((0.0, 0.2, 0.0), frequency=0.5)
    >>> motion.center_at([0.0, 0.5, 1.5], (1.0, 0.0, 0.0)).tolist()
    [[1.0, 0.0, 0.0], [1.0, 0.2, 0.0], [1.0, -0.2, 0.0]]
    """

    amplitude: tuple[float, float, float]
    frequency: float
    phase: float

    kind: ClassVar[str] = "sinusoid"

    @check.check_names
    def __init__(self, amplitude: Numbers, frequency: float, phase: float = 0.0) -> None:
        self._set_attributes(
            amplitude=check.vector("amplitude", amplitude),
            frequency=check.number("frequency", frequency, minimum=0, exclusive=True),
            phase=_check_phase(phase),
        )
        self._set_attributes(_period=1.0 / self.frequency, _phase=self.phase)

    @cached_property
    def pieces(self) -> npt.NDArray[Any]:
        # A piece is half a period: the velocity is monotone on it.
        return _make_pieces(
            [0.0, 0.5], 0.5, [], amplitude=np.outer((1, -1), self.amplitude), angle=math.pi
        )


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Keyframes(BaseMotion):
    """A table of times and centres or displacements, with straight lines or a smooth curve between
    them.

    Before the first time and from the last time on the sphere rests. With straight lines, the
    velocity at a time of the table is that of the line that begins there. ``smooth=True`` is the
    cubic spline through the centres that begins and ends at rest (a clamped spline), with
    continuous velocity and acceleration. It may swing beyond the centres, above all where they
    stand still for a while. ``smooth="rest"`` stays between them: it rests at every time of the
    table, and each way is that of minimum jerk, 10 u^3 - 15 u^4 + 6 u^5 with u from 0 to 1, also
    with continuous velocity and acceleration.

    `centers` are absolute, so the sphere's own ``center`` has no effect. `offsets` are
    displacements from the sphere's ``center`` or from the pin's initial position, so that many pins
    can share a motion.

    Parameters
    ----------
    times : sequence of floats
        Times [s], at least 2, increasing.
    centers : array_like, optional
        Centres [m], shape (len(times), 3).
    offsets : array_like, optional
        Displacements from the start [m], shape (len(times), 3), in place of `centers`.
    smooth : bool or "rest", default False
        True for the cubic spline, "rest" for a curve that rests at every time.

    Warns
    -----
    UserWarning
        If the spline leaves the range of its centres or displacements by more than 1 % of it.

    Examples
    --------
    >>> motion = cs.Keyframes([0.0, 1.0, 3.0], [(0, 0, 0), (1, 0, 0), (1, 4, 0)])
    >>> motion.center_at([-1.0, 0.5, 2.0, 9.0], (0, 0, 0)).tolist()
    [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [1.0, 2.0, 0.0], [1.0, 4.0, 0.0]]
    >>> path = [(0, 0, 0), (0, 1, 0), (0, 0, 0)]
    >>> curve = cs.Keyframes([0.0, 1.0, 2.0], path, smooth=True)
    >>> curve.center_at(0.5, (0, 0, 0)).tolist(), curve.velocity_at([0.0, 1.0])[:, 1].tolist()
    ([0.0, 0.5, 0.0], [0.0, 0.0])
    """

    times: Vectors
    centers: Vectors | None
    offsets: Vectors | None
    smooth: bool | Literal["rest"]

    kind: ClassVar[str] = "keyframes"

    @check.check_names
    def __init__(
        self,
        times: Numbers,
        centers: npt.ArrayLike | None = None,
        offsets: npt.ArrayLike | None = None,
        smooth: bool | Literal["rest"] = False,
    ) -> None:
        count = len(check.list_of_items("times", times, None, "finite numbers", 2))
        times = check.array("times", times, (count,))
        check.check_all("times", times, np.diff(times, prepend=-np.inf) > 0, "strictly increasing")
        places = {"centers": centers, "offsets": offsets}
        tables = {
            name: check.array(name, value, (count, 3))
            for name, value in places.items()
            if value is not None
        }
        if len(tables) != 1:
            raise ValueError(
                "one of centers and offsets must be given, got "
                f"{' and '.join(tables) or 'none of them'}"
            )
        ((name, table),) = tables.items()
        if isinstance(smooth, str):
            check.choice("smooth", smooth, ("rest",))
        else:
            smooth = check.boolean("smooth", smooth, "True, False or 'rest'")
        self._set_attributes(times=make_read_only(times), smooth=smooth, relative=name == "offsets")
        self._set_attributes(**{**dict.fromkeys(places), name: make_read_only(table)})
        if self.smooth is True:
            self._warn_of_overshoot(table)

    def _warn_of_overshoot(self, keys: Vectors) -> None:
        u = np.linspace(0, 1, 17)[:, None]
        polynomial = self.pieces["polynomial"][1:-1]
        curve = np.tensordot(u ** np.arange(6), polynomial, ([1], [1]))
        low = keys.min(axis=0)
        high = keys.max(axis=0)
        excess = np.maximum(low - curve, curve - high)
        largest = float(excess.max())
        span = float((high - low).max())
        if largest > _OVERSHOOT * span:
            at = np.unravel_index(excess.argmax(), excess.shape)
            warn_caller(
                f"the smooth curve leaves the range of its keys by {largest:.3g} m, "
                f"{largest / span:.2g} of it, after t = {self.times[at[1]]:g} s; "
                "smooth='rest' stays between them",
                UserWarning,
            )

    @cached_property
    def pieces(self) -> npt.NDArray[Any]:
        times = self.times
        places = self.offsets if self.centers is None else self.centers
        assert places is not None
        lengths = np.diff(times)[:, None]
        ways = np.diff(places, axis=0)
        curve = [places[:-1], ways]
        if self.smooth == "rest":
            zero = np.zeros_like(ways)
            curve = [places[:-1], zero, zero, 10 * ways, -15 * ways, 6 * ways]
        elif self.smooth:
            speeds = _spline_velocities(lengths, ways / lengths)
            begins = lengths * speeds[:-1]
            ends = lengths * speeds[1:]
            curve = [places[:-1], begins, 3 * ways - 2 * begins - ends, begins + ends - 2 * ways]
        rest = (np.zeros((1, 3)),) * (len(curve) - 1)
        curves = [
            np.concatenate(parts)
            for parts in zip((places[:1], *rest), curve, (places[-1:], *rest), strict=True)
        ]
        return _make_pieces([times[0] - 1.0, *times], [1.0, *lengths[:, 0], 1.0], curves)


def _spline_velocities(h: Vectors, d: Vectors) -> Vectors:
    """Return the velocities of the clamped spline at its times; `h` are the durations and `d` the
    mean velocities between them.

    The acceleration is continuous at each inner time (de Boor, A Practical Guide to Splines, IV).
    """
    v = np.zeros((len(h) + 1, 3))
    v[1:-1] = 3 * (h[1:] * d[:-1] + h[:-1] * d[1:])
    diagonal = 2 * (h[:-1] + h[1:])
    for k in range(1, len(diagonal)):  # elimination in the tridiagonal system
        part = h[k + 1] / diagonal[k - 1]
        diagonal[k] = diagonal[k] - part * h[k - 1]
        v[k + 1] -= part * v[k]
    for k in reversed(range(len(diagonal))):
        v[k + 1] = (v[k + 1] - h[k] * v[k + 2]) / diagonal[k]
    return v


def _make_pieces(
    begin: Numbers,
    length: Any,
    polynomial: Any,
    amplitude: Any = 0.0,
    angle: float = 0.0,
    decay: float = 0.0,
) -> npt.NDArray[Any]:
    """Return pieces of these values; `polynomial` may leave out its last coefficients."""
    pieces = np.zeros(len(begin), PIECE)
    for name, values in (
        ("begin", begin),
        ("length", length),
        ("amplitude", amplitude),
        ("angle", angle),
        ("decay", decay),
    ):
        pieces[name] = values
    for k, coefficients in enumerate(polynomial):
        pieces["polynomial"][:, k] = coefficients
    return make_read_only(pieces)


def _check_phase(value: float) -> float:
    if (phase := check.number("phase", value, minimum=0)) >= 1.0:
        raise ValueError(f"phase must be a finite number >= 0 and < 1, got {value!r}")
    return phase


Motion = Linear | Reciprocate | Sinusoid | Keyframes
MOTIONS: dict[str, type[BaseMotion]] = {
    m.kind: m for m in (Linear, Reciprocate, Sinusoid, Keyframes)
}


def check_motion(name: str, value: Any) -> Motion | None:
    """Return `value` if it is a motion or None."""
    if value is not None and not isinstance(value, (Linear, Reciprocate, Sinusoid, Keyframes)):
        raise TypeError(
            f"{name} must be Linear, Reciprocate, Sinusoid, Keyframes or None, got "
            f"{check.value_text(value)}"
        )
    return value


def motion_from_dict(data: Mapping[str, Any]) -> Motion:
    """Return the motion of `data`: a "kind" of `MOTIONS`, and the arguments of that class."""
    if not isinstance(data, Mapping):
        raise TypeError(f"motion must be a mapping with a 'kind', got {check.value_text(data)}")
    kind = check.choice("motion kind", data.get("kind", ""), MOTIONS)
    return MOTIONS[kind].from_dict(data)  # type: ignore[return-value]
