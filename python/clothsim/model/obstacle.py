"""A sphere that keeps cloth out: its place, its motion and its response to contact."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar, get_args

import numpy as np
import numpy.typing as npt

from .. import _core
from ..base import Floats, check
from ..typing import Numbers, Offset, Response
from .cloth import Cloth
from .motion import Linear, Motion, check_motion, motion_from_dict
from .record import Record

Self = TypeVar("Self", bound="Obstacle")
RESPONSES: tuple[Response, ...] = get_args(Response)
LAYER = ("thickness", "stiffness", "dissipation", "slip_speed")
# The defaults of the layer, found on cloths that fall on a sphere (docs/contact.md).
_THICKNESS = 0.25  # of the smallest structural rest length
_STIFFNESS = 10.0  # of the largest spring stiffness
_DISSIPATION = 2.0  # over the speed that the layer takes from a point
_FASTEST = 1.0  # m/s, of that speed in the default dissipation
_SLIP = 0.01  # of that speed
_FASTEST_SLIP = 0.01  # m/s
OFFSETS: tuple[Offset, ...] = get_args(Offset)


def lengths_of_offsets(cloth: Cloth) -> dict[str, float]:
    """Return the length of the cloth in eq 13 [m] by the name of an offset."""
    return {"edge": max(cloth.spacing), "cell": math.hypot(*cloth.spacing)}


class Obstacle(Record):
    """What a sphere and a plane have in common."""

    center: tuple[float, float, float]
    radius: float
    motion: Motion | None
    response: Response
    offset: Offset | float
    thickness: float | None
    stiffness: float | None
    dissipation: float | None
    slip_speed: float | None
    friction: float
    as_printed: bool
    _has_own_restitution: bool
    _kind: str  # what it is called in texts and names
    _place_name: str  # the argument that says where it is

    def _set_response(
        self, motion: Any, response: Any, restitution: Any, friction: Any, **layer: Any
    ) -> None:
        if isinstance(response, str) and response == "continuous":
            raise ValueError(
                "response must be one of 'penalty', 'reflect', 'ray', got 'continuous', which has "
                "left: 'penalty' takes its place"
            )
        check.choice("response", response, RESPONSES)
        penalty = response == "penalty"
        if penalty and restitution is not None:
            raise ValueError(
                f"restitution must be None with response 'penalty', got {restitution!r}: "
                "dissipation takes its place, 0 for an elastic contact"
            )
        for name, value in layer.items():
            if value is None:
                continue
            if not penalty:
                raise ValueError(
                    f"{name} must be None with response {response!r}, got {value!r}: it belongs "
                    "to response 'penalty'; restitution and friction serve here"
                )
            layer[name] = check.number(name, value, minimum=0, exclusive=name != "dissipation")
        has_own = restitution is not None
        if has_own:
            restitution = check.number("restitution", restitution, minimum=0, maximum=1)
        else:
            restitution = None if penalty else 1.0
        self._set_attributes(
            motion=check_motion("motion", motion),
            response=response,
            _has_own_restitution=has_own,
            restitution=restitution,
            friction=check.number("friction", friction, minimum=0),
            **layer,
        )

    @property
    def damped(self) -> bool:
        """Whether the force of its layer depends on velocities."""
        return self.response == "penalty" and (self.friction > 0 or self.dissipation != 0)

    def _arguments_by_name(self) -> dict[str, Any]:
        values = super()._arguments_by_name()
        return values if self._has_own_restitution else {**values, "restitution": None}

    @classmethod
    def from_dict(cls: type[Self], data: Mapping[str, Any]) -> Self:
        arguments = cls._check_argument_names(data)
        if arguments.get("motion") is not None:
            arguments["motion"] = motion_from_dict(arguments["motion"])
        return cls(**arguments)

    def center_at(self, t: npt.ArrayLike = 0.0) -> npt.NDArray[np.float64]:
        """Return the centre at the time `t` [m], the shape of `t` with 3 appended.

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
        """Return the velocity of the centre at the time `t` [m/s], the shape of `t` with 3
        appended.

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
        """Return the length that the contact radius adds to the true radius [m].

        For "edge" it is O = sqrt((D/2)^2 + R^2) - R (eq 13 of Kim et al.), with R the radius and D
        the largest distance between neighbours at rest. For "cell" D is the diagonal of a cell at
        rest, at most 2 R.

        Parameters
        ----------
        cloth : Cloth
            The cloth that meets this sphere.

        Examples
        --------
        >>> cloth = cs.Cloth(shape=(2, 2), size=(4, 4))
        >>> cs.Sphere(radius=1.5, offset="edge").offset_length(cloth)
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

    def layer(self, cloth: Cloth) -> dict[str, float]:
        """Return the parameters of the layer of response "penalty", as resolved for a cloth.

        A parameter that is None follows from the cloth, with h the thickness, k the stiffness, m
        the mean mass of a point, w the largest speed of the motion and V = h sqrt(k / (2 m)), the
        speed that the layer takes from a point: h is a quarter of the smallest structural rest
        length, k the larger of 10 times the largest spring stiffness and 2 m (w/h)^2, the
        dissipation 2 / min(V, 1 m/s), the slip speed min(V / 100, 0.01 m/s).

        Parameters
        ----------
        cloth : Cloth
            The cloth that meets this obstacle.

        Returns
        -------
        dict
            "thickness" [m], "stiffness" [N/m], "dissipation" [s/m], "slip_speed" [m/s].

        Examples
        --------
        >>> layer = cs.Sphere().layer(cs.Cloth(shape=(32, 32), stiffness=35_000.0))
        >>> round(layer["thickness"], 5), layer["stiffness"], layer["slip_speed"]
        (0.00806, 350000.0, 0.01)
        """
        check.instance("cloth", cloth, Cloth)
        if self.response != "penalty":
            raise ValueError(
                f"response must be 'penalty' for a layer, got an obstacle with {self.response!r}"
            )
        mass = float(cloth.mass_per_point.mean())
        thickness = self.thickness
        stiffness = self.stiffness
        if thickness is None:
            thickness = _THICKNESS * min(length for length in cloth.spacing if length > 0)
        if stiffness is None:
            springs = max(cloth.family_stiffness.values(), default=0.0)
            speed = self.motion.largest_speed if self.motion else 0.0
            stiffness = max(_STIFFNESS * springs, 2 * mass * (speed / thickness) ** 2)
            if stiffness == 0:
                raise ValueError(
                    "stiffness must be given for an obstacle of a cloth without springs, got None"
                )
        fastest = thickness * math.sqrt(stiffness / (2 * mass))
        dissipation = self.dissipation
        slip_speed = self.slip_speed
        if dissipation is None:
            dissipation = _DISSIPATION / min(fastest, _FASTEST)
        if slip_speed is None:
            slip_speed = min(_SLIP * fastest, _FASTEST_SLIP)
        return {
            "thickness": thickness,
            "stiffness": stiffness,
            "dissipation": dissipation,
            "slip_speed": slip_speed,
        }

    def height(self, x: npt.ArrayLike, t: float = 0.0) -> npt.NDArray[np.float64]:
        """Return the height of places over the surface at the time `t` [m]; below it negative.

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
        return self._heights_over_surface(np.asarray(x, float) - self.center_at(t))

    def _heights_over_surface(self, displacement: Floats) -> Floats:
        """Return the heights over the surface of places at a `displacement` from the centre [m]."""
        raise NotImplementedError

    def _normal_at_measuring_place(self, gravity: Numbers, x: Floats | None) -> Floats:
        """Return the normal at the place from which the core measures points of a cloth at `x`."""
        raise NotImplementedError

    def _size_text(self, cloth: Cloth) -> str:
        raise NotImplementedError

    def _copy_at_rest(self: Self, center: npt.ArrayLike) -> Self:
        """Return the obstacle at rest at `center`."""
        return self.replace(**{self._place_name: center, "motion": None})

    def _copy_with_layer(self: Self, **changes: Any) -> Self:
        """Return the obstacle with response "penalty" and further `changes`."""
        if self.response != "penalty":
            changes |= {"response": "penalty", "restitution": None}
        if self.as_printed:
            changes["as_printed"] = False
        return self.replace(**changes)

    def contact_radius(self, cloth: Cloth) -> float:
        """Return the distance from the centre below which a mass point is in contact [m]:
        ``radius`` + ``offset_length(cloth)``.

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
    """A sphere that keeps cloth out, by a force or by the two responses of Kim et al. (section 5).

    "penalty" is a smooth force in a layer over the surface, a part of the equation of motion, so
    that order, error control and derivatives hold through contact. With d the depth in the layer of
    thickness h, n the normal, u the velocity relative to the sphere and s its part across n, the
    push is F = k d^3 / h^2 (1 - w / sqrt(1 + w^2)), w = c u.n, and the friction is
    -mu F s / sqrt(s.s + v_s^2) (docs/contact.md). "reflect" and "ray" test the end of a step; fast
    points pass between two steps, and the responses can make energy.

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
    response : {"penalty", "reflect", "ray"}, default "penalty"
        "reflect" (method 1, eq 7) reflects the velocity and keeps the position. "ray" (method 2, eq
        8-12) moves the point back along its velocity to the contact radius, but no further than it
        came in the step, then reflects the velocity.
    offset : {"cell", "edge", "none"} or float, default "cell"
        Length that the contact radius adds to `radius`: that of eq 13 for the cells at rest, so
        that triangles of an unstretched cloth stay out ("cell"); for the structural springs
        ("edge"); 0 ("none"); or a length [m], >= 0.
    thickness, stiffness, dissipation : float, optional
        With "penalty": h [m] and k [N/m], > 0, and c [s/m], >= 0, where 0 is an elastic contact.
        `layer` has the defaults, which follow from the cloth. A thinner layer costs evaluations as
        h^-1/2.
    friction : float, default 0.0
        Coefficient of Coulomb friction mu, >= 0.
    slip_speed : float, optional
        With "penalty": v_s [m/s], > 0, the slip below which friction falls to 0. Default: see
        `layer`.
    restitution : float, optional
        With the paper's two: normal velocity after a contact over that before it, 0 <= restitution
        <= 1. Default: 1. The attribute holds the number in use, None with "penalty".
    as_printed : bool, default False
        True follows the paper as printed: a moving sphere's velocity is ignored, and a point's
        velocity is reflected even if it is leaving. With "ray" and "reflect" alone.

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
    thickness: float | None
    stiffness: float | None
    dissipation: float | None
    friction: float
    slip_speed: float | None
    restitution: float | None
    as_printed: bool

    _kind = "sphere"
    _place_name = "center"

    @check.check_names
    def __init__(
        self,
        center: Numbers = (0.0, 0.0, 0.0),
        radius: float = 0.25,
        motion: Motion | None = None,
        response: Response = "penalty",
        offset: Offset | float = "cell",
        thickness: float | None = None,
        stiffness: float | None = None,
        dissipation: float | None = None,
        friction: float = 0.0,
        slip_speed: float | None = None,
        restitution: float | None = None,
        as_printed: bool = False,
    ) -> None:
        self._set_attributes(
            center=check.vector("center", center),
            radius=check.number("radius", radius, minimum=0, exclusive=True),
            offset=_check_offset(offset),
            as_printed=check.boolean("as_printed", as_printed),
        )
        self._set_response(
            motion,
            response,
            restitution,
            friction,
            thickness=thickness,
            stiffness=stiffness,
            dissipation=dissipation,
            slip_speed=slip_speed,
        )
        if self.as_printed and response not in ("ray", "reflect"):
            raise ValueError(
                f"as_printed must be False with response {response!r}, which the paper does not "
                "have; accepted with 'ray' and 'reflect'"
            )

    def _heights_over_surface(self, displacement: Floats) -> Floats:
        return np.asarray(np.linalg.norm(displacement, axis=-1) - self.radius)

    def _normal_at_measuring_place(self, gravity: Numbers, x: Floats | None) -> Floats:
        """Return the direction against gravity; with "penalty" that to the middle of the cloth."""
        if x is not None and self.response == "penalty":
            displacement = x.mean(axis=(0, 1)) - self.center_at(0.0)
            distance = float(np.linalg.norm(displacement))
            if 0 < distance < np.inf:
                return np.asarray(displacement / distance)
        up = -np.array(gravity) if any(gravity) else np.array((0.0, 1.0, 0.0))
        return np.asarray(up / np.linalg.norm(up))

    def _size_text(self, cloth: Cloth) -> str:
        return f"contact radius {self.contact_radius(cloth):.6g} m"


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
    response : {"penalty", "reflect", "ray"}, default "penalty"
        As for `Sphere`.
    thickness, stiffness, dissipation, friction, slip_speed, restitution : float, optional
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
    thickness: float | None
    stiffness: float | None
    dissipation: float | None
    friction: float
    slip_speed: float | None
    restitution: float | None

    radius = math.inf
    offset = "none"
    as_printed = False
    _kind = "plane"
    _place_name = "point"

    @check.check_names
    def __init__(
        self,
        point: Numbers = (0.0, 0.0, 0.0),
        normal: Numbers = (0.0, 1.0, 0.0),
        motion: Motion | None = None,
        response: Response = "penalty",
        thickness: float | None = None,
        stiffness: float | None = None,
        dissipation: float | None = None,
        friction: float = 0.0,
        slip_speed: float | None = None,
        restitution: float | None = None,
    ) -> None:
        self._set_attributes(
            point=check.vector("point", point), normal=check.vector("normal", normal)
        )
        if not any(self.normal):
            raise ValueError(f"normal must not be the zero vector, got {normal!r}")
        self._set_attributes(center=self.point)
        self._set_response(
            motion,
            response,
            restitution,
            friction,
            thickness=thickness,
            stiffness=stiffness,
            dissipation=dissipation,
            slip_speed=slip_speed,
        )

    @property
    def unit_normal(self) -> npt.NDArray[np.float64]:
        """The normal, of length 1."""
        n = np.array(self.normal)
        n /= np.abs(n).max()
        return np.asarray(n / np.linalg.norm(n))

    def _heights_over_surface(self, displacement: Floats) -> Floats:
        return np.asarray(displacement @ self.unit_normal)

    def _normal_at_measuring_place(self, gravity: Numbers, x: Floats | None) -> Floats:
        normal = self.unit_normal
        return np.asarray(normal / np.linalg.norm(normal))

    def _size_text(self, cloth: Cloth) -> str:
        return "a plane"


_STILL = Linear((0.0, 0.0, 0.0))


def name_of_kind(obstacles: Iterable[Sphere | Plane]) -> str:
    """Return what obstacles are called in texts: "sphere", "plane" or "sphere or plane"."""
    kinds = {obstacle._kind for obstacle in obstacles} or {Sphere._kind}
    return " or ".join(sorted(kinds, reverse=True))


def _check_offset(value: Any) -> Offset | float:
    if not isinstance(value, str):
        return check.number("offset", value, minimum=0)
    if value not in OFFSETS:
        raise ValueError(f"offset must be one of {OFFSETS} or a length >= 0 [m], got {value!r}")
    return value
