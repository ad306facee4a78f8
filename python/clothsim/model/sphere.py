"""A sphere that keeps cloth out: its place, its motion and its response to contact."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar, get_args

import numpy as np
import numpy.typing as npt

from .. import _core
from ..base import check
from ..typing import Numbers, Offset, Response
from .cloth import Cloth
from .motion import Linear, Motion, checked_motion, motion_from_dict
from .record import Record

Self = TypeVar("Self", bound="Obstacle")
RESPONSES: tuple[Response, ...] = get_args(Response)
_RESTITUTION = {"continuous": 0.0, "ray": 1.0, "reflect": 1.0}  # where none is given
OFFSETS: tuple[Offset, ...] = get_args(Offset)


def lengths_of_offsets(cloth: Cloth) -> dict[str, float]:
    """The length of the cloth in eq 13 [m] by the name of an offset."""
    return {"edge": max(cloth.spacing), "cell": math.hypot(*cloth.spacing)}


class Obstacle(Record):
    """What a sphere and a plane have in common."""

    center: tuple[float, float, float]
    radius: float
    motion: Motion | None
    response: Response
    offset: Offset | float
    _has_own_restitution: bool

    def _set_response(self, motion: Any, response: Any, restitution: Any, friction: Any) -> None:
        self._set(
            motion=checked_motion("motion", motion),
            response=check.choice("response", response, RESPONSES),
            _has_own_restitution=restitution is not None,
            restitution=_RESTITUTION[response]
            if restitution is None
            else check.number("restitution", restitution, minimum=0, maximum=1),
            friction=check.number("friction", friction, minimum=0),
        )

    def _values(self) -> dict[str, Any]:
        values = super()._values()
        return values if self._has_own_restitution else {**values, "restitution": None}

    @property
    def in_cells(self) -> bool:
        """Whether the contact radius of each mass point follows from its deformed cells."""
        return self.offset == "cell" and self.response == "continuous"

    @classmethod
    def from_dict(cls: type[Self], data: Mapping[str, Any]) -> Self:
        arguments = cls._arguments(data)
        if arguments.get("motion") is not None:
            arguments["motion"] = motion_from_dict(arguments["motion"])
        return cls(**arguments)

    def center_at(self, t: npt.ArrayLike = 0.0) -> npt.NDArray[np.float64]:
        """Centre at the time `t` [m], the shape of `t` with 3 appended.

        Parameters
        ----------
        t : float or array_like, default 0.0
            Time [s].

        Examples
        --------
        >>> cs.Sphere(motion=cs.Linear(velocity=(0, 1, 0))).center_at(0.5)
        array([0. , 0.5, 0. ])
        """
        return (self.motion or _STILL).center_at(t, self.center)

    def velocity_at(self, t: npt.ArrayLike = 0.0) -> npt.NDArray[np.float64]:
        """Velocity of the centre at the time `t` [m/s], the shape of `t` with 3 appended.

        Parameters
        ----------
        t : float or array_like, default 0.0
            Time [s].

        Examples
        --------
        >>> cs.Sphere(motion=cs.Linear(velocity=(0, 1, 0))).velocity_at(0.5)
        array([0., 1., 0.])
        """
        return (self.motion or _STILL).velocity_at(t)

    def offset_length(self, cloth: Cloth) -> float:
        """Length that the contact radius adds to the true radius [m].

        For "edge" it is O = sqrt((D/2)^2 + R^2) - R (eq 13 of Kim et al.), with R the radius and D
        the largest distance between neighbours at rest. "cell" has no fixed length: the value is
        the most that a corner of an unstretched cell needs, sqrt(rho^2 + R^2) - R. Here rho is half
        the diagonal of the cell, at most R.

        Parameters
        ----------
        cloth : Cloth
            The cloth that meets this sphere.

        Examples
        --------
        >>> cs.Sphere(radius=1.5, offset="edge").offset_length(cs.Cloth(shape=(2, 2), size=(4, 4)))
        1.0
        """
        check.instance("cloth", cloth, Cloth)
        if isinstance(self.offset, float):
            return self.offset
        if self.offset == "none":  # a plane has no offset
            return 0.0
        length = lengths_of_offsets(cloth)[self.offset]
        return _core.edge_offset(
            self.radius, min(length, 2 * self.radius) if self.offset == "cell" else length
        )

    def height(self, x: npt.ArrayLike, t: float = 0.0) -> npt.NDArray[np.float64]:
        """Height of places over the surface at the time `t` [m]; below it negative.

        Parameters
        ----------
        x : array_like
            Places [m], shape (..., 3).
        t : float, default 0.0
            Time [s].

        Examples
        --------
        >>> float(cs.Sphere(radius=0.25).height((0.0, 1.0, 0.0)))
        0.75
        """
        away = np.asarray(x, float) - self.center_at(t)
        return np.asarray(
            away @ self.unit_normal
            if isinstance(self, Plane)
            else np.linalg.norm(away, axis=-1) - self.radius
        )

    def contact_radius(self, cloth: Cloth) -> float:
        """Distance from the centre below which a mass point is in contact [m]: ``radius`` +
        ``offset_length(cloth)``.

        Parameters
        ----------
        cloth : Cloth
            The cloth that meets this sphere.

        Examples
        --------
        >>> cs.Sphere(radius=0.25, offset=0.01).contact_radius(cs.Cloth())
        0.26
        """
        return self.radius + self.offset_length(cloth)


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Sphere(Obstacle):
    """A sphere that cloth cannot enter, with continuous contact or the two responses of Kim et al.
    (section 5).

    A mass point is in contact when its distance to the centre is less than the contact radius,
    ``radius`` plus the offset. Responses use the velocity of the point relative to the sphere, and
    only approaching points respond. With `as_printed` they use the absolute velocity, and leaving
    points respond too.

    "reflect" and "ray" test the end of a step. Fast points pass between two steps, and the
    responses can make energy. "continuous" finds the time of impact within the step, with point and
    sphere on straight lines, in double. The point responds there and moves on for the rest of the
    step. No point passes at any speed, and an impact makes no energy (docs/contact.md).

    Parameters
    ----------
    center : sequence of 3 floats, default (0, 0, 0)
        Centre [m]. With a `motion` it is the point of reference: for `Linear` the place at t = 0,
        for `Reciprocate` and `Sinusoid` the middle of the travel. `Keyframes` with centres ignores
        it.
    radius : float, default 0.25
        True radius [m], > 0.
    motion : Linear, Reciprocate, Sinusoid or Keyframes, optional
        Default: the sphere stands still.
    response : {"continuous", "ray", "reflect"}, default "continuous"
        "continuous" responds at the time of impact. "reflect" (method 1, eq 7) reflects the
        velocity and keeps the position. "ray" (method 2, eq 8-12) moves the point back along its
        velocity to the contact radius, then reflects the velocity.
    offset : {"cell", "edge", "none"} or float, default "cell"
        Length that the contact radius adds to `radius`. "cell" is the length of eq 13 for the cells
        of each point as they are deformed, so that no triangle dips in. A step in which all points
        touch takes 1.4 times as long as one without spheres (single: 1.6). A cell must be smaller
        than the sphere, so a small sphere needs a finer cloth; otherwise you get a
        `ContactWarning`. With "ray" and "reflect" the cells are those at rest. "edge" is the length
        of eq 13, which keeps the middle of an unstretched structural spring outside. "none" is 0,
        and a number is that length [m], >= 0.
    restitution : float, optional
        Normal velocity after a contact over that before it, 0 <= restitution <= 1. Default: 0 with
        "continuous", as cloth does not bounce, and 1 with the paper's two responses. The attribute
        holds the number in use; ``replace(response=...)`` takes the default of the new response.
        With "continuous", if a point would bounce and return within one step, it stays at the
        surface and keeps the speed of the bounce.
    friction : float, default 0.0
        Coefficient of Coulomb friction, >= 0.
    as_printed : bool, default False
        True follows the paper as printed: a moving sphere's velocity is ignored, and a point's
        velocity is reflected even if it is leaving. Not with "continuous", which the paper does not
        have.
    push_out_speed : float, default 1.0
        With the response "continuous", speed at which points that start inside the contact radius
        are pushed out [m/s], > 0. It is not added to their velocity.

    Examples
    --------
    >>> ball = cs.Sphere(center=(0.5, -0.5, 0.5), motion=cs.Linear((0, 1, 0)))
    >>> ball.center_at(0.25).tolist()
    [0.5, -0.25, 0.5]
    >>> round(ball.contact_radius(cs.Cloth()), 6)
    0.251038
    """

    center: tuple[float, float, float]
    radius: float
    motion: Motion | None
    response: Response
    offset: Offset | float
    restitution: float
    friction: float
    as_printed: bool
    push_out_speed: float

    @check.named
    def __init__(
        self,
        center: Numbers = (0.0, 0.0, 0.0),
        radius: float = 0.25,
        motion: Motion | None = None,
        response: Response = "continuous",
        offset: Offset | float = "cell",
        restitution: float | None = None,
        friction: float = 0.0,
        as_printed: bool = False,
        push_out_speed: float = 1.0,
    ) -> None:
        self._set(
            center=check.vector("center", center),
            radius=check.number("radius", radius, minimum=0, exclusive=True),
            offset=_offset(offset),
            as_printed=check.boolean("as_printed", as_printed),
            push_out_speed=check.number(
                "push_out_speed", push_out_speed, minimum=0, exclusive=True
            ),
        )
        self._set_response(motion, response, restitution, friction)
        if self.as_printed and response == "continuous":
            raise ValueError(
                "as_printed must be False with response 'continuous', which the paper does not have"
            )


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Plane(Obstacle):
    """A plane that keeps cloth on the side to which its normal points: a floor or a wall, a sphere
    of no curvature.

    It stands where a `Sphere` stands, in `Scene.spheres` too, and has the laws of its responses.
    The distance of a point is its height over the plane. A triangle is outside if its corners are,
    so a plane needs no offset.

    Parameters
    ----------
    point : sequence of 3 floats, default (0, 0, 0)
        A place on the plane [m]. In precision "single" take one near the cloth. With a `motion` it
        is the point of reference, as `Sphere.center` is.
    normal : sequence of 3 floats, default (0, 1, 0)
        Direction out of the plane, of any length > 0.
    motion : Linear, Reciprocate or Keyframes, optional
        Default: the plane stands still.
    response : {"continuous", "ray", "reflect"}, default "continuous"
        As for `Sphere`.
    restitution, friction : float, optional
        As for `Sphere`.

    Examples
    --------
    >>> cloth = cs.Cloth((8, 8), mass=1.0, stiffness=500.0, damping=1.0, pins=())
    >>> scene = cs.Scene(cloth, cs.Plane((0, -1, 0)))
    >>> bool(cs.simulate(scene, 1.0).x[-1][..., 1].min() >= -1)
    True
    """

    point: tuple[float, float, float]
    normal: tuple[float, float, float]
    motion: Motion | None
    response: Response
    restitution: float
    friction: float

    radius, as_printed, push_out_speed = math.inf, False, 1.0  # what a sphere has of its own
    offset = "none"

    @check.named
    def __init__(
        self,
        point: Numbers = (0.0, 0.0, 0.0),
        normal: Numbers = (0.0, 1.0, 0.0),
        motion: Motion | None = None,
        response: Response = "continuous",
        restitution: float | None = None,
        friction: float = 0.0,
    ) -> None:
        self._set(point=check.vector("point", point), normal=check.vector("normal", normal))
        if not any(self.normal):
            raise ValueError(f"normal must not be the zero vector, got {normal!r}")
        self._set(center=self.point)
        self._set_response(motion, response, restitution, friction)

    @property
    def unit_normal(self) -> npt.NDArray[np.float64]:
        """The normal, of length 1."""
        n = np.array(self.normal)
        n /= np.abs(n).max()
        return np.asarray(n / np.linalg.norm(n))


_STILL = Linear((0.0, 0.0, 0.0))


def place_name(obstacle: Sphere | Plane) -> str:
    """The argument that says where a sphere or plane is."""
    return "point" if isinstance(obstacle, Plane) else "center"


def kind_name(obstacles: Iterable[Sphere | Plane]) -> str:
    """What they are called in texts: "sphere", "plane" or "sphere or plane"."""
    kinds = {isinstance(one, Plane) for one in obstacles}
    if len(kinds) > 1:
        return "sphere or plane"
    return "plane" if True in kinds else "sphere"


def held(obstacle: Sphere | Plane, center: npt.ArrayLike) -> Sphere | Plane:
    """The sphere or plane at rest at `center`."""
    return obstacle.replace(**{place_name(obstacle): center, "motion": None})


def continuous(obstacle: Sphere | Plane, **changes: Any) -> Sphere | Plane:
    """The sphere or plane with response "continuous", which the paper does not have, and with
    further `changes`.
    """
    mended = {"as_printed": False} if obstacle.as_printed else {}
    return obstacle.replace(response="continuous", **mended, **changes)


def _offset(value: Any) -> Offset | float:
    if not isinstance(value, str):
        return check.number("offset", value, minimum=0)
    if value not in OFFSETS:
        instead = (
            "; use 'cell', and more mass points where a sphere is smaller than a cell"
            if value == "face"
            else ""
        )
        raise ValueError(
            f"offset must be one of {OFFSETS} or a length >= 0 [m], got {value!r}{instead}"
        )
    return value
