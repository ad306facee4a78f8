"""The scene: one cloth, the spheres it meets, gravity and the initial state, as plain data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _core
from ..base import check, make_read_only
from ..base.services import find_service
from ..base.text import format_count
from ..typing import Integrator, Kernel, Numbers, Precision
from .cloth import Cloth
from .motion import Keyframes, Motion
from .obstacle import Plane, Sphere
from .record import Record
from .wind import Wind

SCHEMA = 2
"""Version of the layout of ``Scene.to_dict``."""

# A motion may begin this part of the cloth's size, and of its distance from the origin, off the
# pin. Half is far above the rounding of float64. Twice would hide a displacement of 2 nm on a sheet
# of a metre.
_PLACE_ROUNDING = 1e-9


@dataclass(frozen=True)
class DrivenPins:
    """Pins that share a motion."""

    motion: Motion
    rows: npt.NDArray[np.int64]  # of their points
    columns: npt.NDArray[np.int64]
    starts: npt.NDArray[
        np.float64
    ]  # (pins, 3): the ``center0`` with which each begins at its initial position [m]

    def places_at(self, t: float) -> npt.NDArray[np.float64]:
        """Return the places at the time `t` [m], shape (pins, 3)."""
        return np.broadcast_to(self.motion._centers_at(np.array(t), self.starts), self.starts.shape)


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Scene(Record):
    """A cloth, the spheres it meets, gravity and the initial state.

    Scenes are immutable, equal by value, and plain data (``to_dict``).

    Parameters
    ----------
    cloth : Cloth
        The cloth.
    spheres : Sphere, Plane or a sequence of them, default ()
        The spheres and planes. A contact pass treats them in this order.
    gravity : sequence of 3 floats, default (0, -9.80665, 0)
        Acceleration of every point that is not pinned [m/s^2].
    position : array_like, optional
        Initial positions [m], shape (rows, columns, 3). Default: the flat sheet in the plane
        y = 0, ``cloth.rest_positions``.
    velocity : array_like, optional
        Initial velocities [m/s], shape (rows, columns, 3). Default: at rest. Zero at the pinned
        points.
    force : array_like, optional
        Force on each mass point [N], shape (rows, columns, 3), constant in time.
        `Stepper.set_force` changes it between calls. Default: none. A force that depends on time
        and state is the argument `force` of `simulate`.
    wind : Wind, optional
        Moving air that presses on the triangles. Default: none.

    Attributes
    ----------
    initial_position, initial_velocity : numpy.ndarray
        Initial state [m], [m/s], shape (rows, columns, 3), read-only.

    Examples
    --------
    >>> scene = cs.Scene(cs.Cloth(shape=(8, 12)), cs.Sphere(center=(0.5, -0.5, 0.5)))
    >>> scene.initial_position.shape
    (8, 12, 3)
    >>> cs.Scene.from_dict(scene.to_dict()) == scene
    True
    >>> scene.replace(spheres=()).spheres
    ()
    """

    cloth: Cloth
    spheres: tuple[Sphere | Plane, ...]
    gravity: tuple[float, float, float]
    position: npt.NDArray[np.float64] | None
    velocity: npt.NDArray[np.float64] | None
    force: npt.NDArray[np.float64] | None
    wind: Wind | None

    @check.check_names
    def __init__(
        self,
        cloth: Cloth,
        spheres: Sphere | Plane | Iterable[Sphere | Plane] = (),
        gravity: Numbers = (0.0, -9.80665, 0.0),
        position: npt.ArrayLike | None = None,
        velocity: npt.ArrayLike | None = None,
        force: npt.ArrayLike | None = None,
        wind: Wind | None = None,
    ) -> None:
        self._set_attributes(wind=None if wind is None else check.instance("wind", wind, Wind))
        shape = (*check.instance("cloth", cloth, Cloth).shape, 3)
        self._set_attributes(
            cloth=cloth, spheres=_check_spheres(spheres), gravity=check.vector("gravity", gravity)
        )
        for name, value in (("position", position), ("velocity", velocity), ("force", force)):
            self._set_attributes(
                **{name: None if value is None else make_read_only(check.array(name, value, shape))}
            )
        if (velocities := self.velocity) is not None:
            for r, c in np.argwhere(cloth.pinned & velocities.any(axis=-1)).tolist():
                motion = cloth.driven.get((r, c))
                if motion is None or not np.allclose(velocities[r, c], motion.velocity_at(0.0)):
                    raise ValueError(
                        f"velocity must be 0 at pinned points, got {velocities[r, c].tolist()} at "
                        f"point {(r, c)}; "
                        "Cloth(pins={(row, column): cs.Linear(velocity)}) drives a pin"
                    )
        for (r, c), motion in cloth.driven.items():
            if not isinstance(motion, Keyframes):  # the others begin where the pin is
                continue
            place = self.initial_position[r, c]
            begins = motion.center_at(0.0, place)
            if np.abs(begins - place).max() > _PLACE_ROUNDING * (
                max(self.cloth.size) + np.abs(place).max()
            ):
                raise ValueError(
                    f"pins[{(r, c)}] must start at its initial position {place.tolist()}, got a "
                    f"motion that is at {begins.tolist()} at t = 0; Keyframes(times, offsets=...) "
                    "takes displacements from the start"
                )

    def replace(self, **changes: Any) -> Scene:
        cloth = changes.get("cloth")
        own = self.cloth
        if (
            isinstance(cloth, Cloth)
            and len(changes) == 1
            and cloth.pins is own.pins
            and cloth.shape is own.shape
        ):
            if cloth.size is own.size:  # all other arguments fit
                forget = ["_spare_states", "_plans"]
                if cloth.drag != own.drag:
                    forget.append("core_forces")
                if self.has_layers:
                    forget.append("core_spheres")  # their layers follow from the cloth
                return self._copy_with_values(forget, cloth=cloth)
        return super().replace(**changes)

    @property
    def initial_position(self) -> npt.NDArray[np.float64]:
        return self.cloth.rest_positions if self.position is None else self.position

    @cached_property
    def _spare_states(self) -> dict[Any, Any]:
        """States for the next call with this scene; see `clothsim.engine.stepping`."""
        return {}

    @cached_property
    def initial_velocity(self) -> npt.NDArray[np.float64]:
        if self.velocity is not None and not self.cloth.driven:
            return self.velocity
        velocity = (
            np.zeros((*self.cloth.shape, 3)) if self.velocity is None else self.velocity.copy()
        )
        for pin, motion in self.cloth.driven.items():
            velocity[pin] = motion.velocity_at(0.0)
        return make_read_only(velocity)

    @cached_property
    def driven_pins(self) -> list[DrivenPins]:
        """The driven pins, one entry for each motion."""
        pins: dict[Motion, list[tuple[int, int]]] = {}
        for pin, motion in self.cloth.driven.items():
            pins.setdefault(motion, []).append(pin)
        groups = []
        for motion, points in pins.items():
            rows, columns = np.array(points).T
            places = self.initial_position[rows, columns]
            begin = 0.0 if isinstance(motion, Keyframes) else motion.center_at(0.0, (0, 0, 0))
            groups.append(DrivenPins(motion, rows, columns, places - begin))
        return groups

    @cached_property
    def core_spheres(self) -> list[_core.Sphere]:
        """The spheres and planes as the core takes them."""
        return [core_sphere(sphere, self) for sphere in self.spheres]

    @cached_property
    def core_forces(self) -> list[_core.Force]:
        """The forces beside springs, gravity and contact, as the core takes them."""
        drag = self.cloth.drag
        wind = self.wind
        forces = [_core.Force("drag", [drag], _core.Motion())] if drag else []
        return [*forces, wind.core] if wind else forces

    @cached_property
    def has_layers(self) -> bool:
        """Whether an obstacle responds by a force in a layer."""
        return any(sphere.response == "penalty" for sphere in self.spheres)

    @property
    def damped(self) -> bool:
        """Whether forces depend on velocities: those of damped springs, drag, wind, and contact
        with dissipation or friction.
        """
        return (
            self.cloth.damped
            or bool(self.core_forces)
            or any(sphere.damped for sphere in self.spheres)
        )

    @cached_property
    def core_pins(self) -> dict[str, Any]:
        """Driven pins as the core takes them: motions, and (point, start, index of the motion) in
        the order of points.
        """
        groups = self.driven_pins
        columns = self.cloth.columns
        pins = [
            (int(r) * columns + int(c), start, k)
            for k, group in enumerate(groups)
            for r, c, start in zip(group.rows, group.columns, group.starts)
        ]
        return {
            "pin_motions": [group.motion.core for group in groups],
            "driven_pins": sorted(pins, key=lambda pin: pin[0]),
        }

    @check.check_names
    def explain(
        self,
        precision: Precision = "double",
        kernel: Kernel = "auto",
        threads: int | None = None,
        integrator: Integrator = "rk4",
    ) -> Any:
        """List the work of a step of this scene, the parts left out, and the term that limits the
        step.

        Parameters
        ----------
        precision, kernel, threads, integrator
            As for `step`.

        Returns
        -------
        mapping
            Of the step what is computed, what is left out, and by what; "max_stable_dt", the step
            that is guaranteed to be stable [s], and "limited_by", the term that limits it, with its
            springs and the value below which the other term limits the step. It prints as a table.

        Examples
        --------
        >>> cs.scenes.paper_swing().explain()["springs"]
        3906
        >>> account = cs.Scene(cs.Cloth(mass=0.2)).explain(integrator="velocity_verlet")
        >>> for part in account["limited_by"].split("; "):
        ...     print(part)
        the damping of structural and bend springs, 100 N s/m, limits it
        below 0.647 N s/m the stiffness would
        """
        return find_service("explain")(self, precision, kernel, threads, integrator)

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        """Return lines, and a picture of the initial state, for a notebook."""
        bundle: dict[str, Any] = find_service("scene_bundle")(self)
        return bundle

    @check.check_names
    def to_live_html(
        self, path: str | Path, dt: float | None = None, title: str | None = None
    ) -> Path:
        """Write one self-contained page that simulates the scene in a browser, and return its path.

        The page runs the compute shader of `backend="gpu"` by WebGPU, in compensated float32, and
        makes no request. A pointer turns and zooms the view, and drags spheres and pinned mass
        points. Controls change the cloth, the contact, gravity and the time step. What is shown is
        recorded, and can be saved as a page of its own. Without WebGPU the page plays a short run
        of the scene.

        Parameters
        ----------
        path : path-like
            File to write. The shader has no `force`, no wind and no driven pins.
        dt : float, optional
            Time step [s], > 0. Default: half of the stable time step.
        title : str, optional
            Heading of the page. Default: the shape of the cloth.

        Examples
        --------
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = cs.scenes.paper_static().to_live_html(folder + "/live.html")
        ...     path.name, path.stat().st_size < 400_000
        ('live.html', True)
        """
        page: Path = find_service("write_live_page")(self, path, dt, title)
        return page

    def to_dict(self) -> dict[str, Any]:
        return {"schema": SCHEMA, **super().to_dict()}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Scene:
        arguments = cls._check_argument_names(data, "schema")
        schema = check.integer("schema", arguments.pop("schema"))
        if schema != SCHEMA:
            raise ValueError(f"schema must be {SCHEMA}, the version read here, got {schema}")
        arguments["cloth"] = Cloth.from_dict(arguments["cloth"])
        if arguments.get("wind") is not None:
            arguments["wind"] = Wind.from_dict(arguments["wind"])
        spheres = arguments.get("spheres", ())
        if not isinstance(spheres, (list, tuple)):
            raise TypeError(f"spheres must be a list of mappings, got {check.value_text(spheres)}")
        arguments["spheres"] = tuple(
            (Plane if {"normal", "point"} & set(values) else Sphere).from_dict(values)
            for values in spheres
        )
        return cls(**arguments)


def core_sphere(sphere: Sphere | Plane, scene: Scene | None = None) -> _core.Sphere:
    """Return the sphere or plane in the form of the core, without offset if no scene is given."""
    offset = 0.0
    layer: dict[str, float] = {}
    if scene is None:
        normal = sphere._normal_at_measuring_place((0.0, 0.0, 0.0), None)
    else:
        normal = sphere._normal_at_measuring_place(scene.gravity, scene.initial_position)
        offset = sphere.offset_length(scene.cloth)
        if sphere.response == "penalty":
            speed = sphere.motion.largest_speed if sphere.motion else 0.0
            layer = {**sphere.layer(scene.cloth), "speed": speed}
    return _core.Sphere(
        center=sphere.center,
        radius=sphere.radius,
        offset=offset,
        response=sphere.response,
        as_printed=sphere.as_printed,
        restitution=sphere.restitution or 0.0,
        friction=sphere.friction,
        motion=sphere.motion.core if sphere.motion else _core.Motion(),
        normal=normal,
        **layer,
    )


def turning_times(scene: Scene, begin: float, end: float) -> list[float]:
    """Return times between `begin` and `end` at which motions of pins, spheres and wind turn, or
    pass a time of their table [s].

    Between two of them every motion is smooth: error control ends its steps there.
    """
    motions = {pins.motion for pins in scene.driven_pins}
    things = (*scene.spheres, scene.wind)
    motions |= {thing.motion for thing in things if thing and thing.motion}
    return sorted({t for motion in motions for t in motion._ends_of_pieces(begin, end)})


def cloth_text(scene: Scene) -> str:
    rows, columns = scene.cloth.shape
    return f"{rows} x {columns} mass points"


def spheres_text(scene: Scene) -> str:
    """Return the numbers of spheres and planes, and their responses."""
    spheres = scene.spheres
    if not spheres:
        return "no sphere"
    numbers = Counter(sphere._kind for sphere in spheres)
    text = " and ".join(format_count(numbers[kind], kind) for kind in sorted(numbers, reverse=True))
    responses = Counter(
        f"{'moving, ' if s.motion else ''}response "
        f"{s.response}{' as printed' if s.as_printed else ''}"
        for s in spheres
    )
    parts = [kind if n == len(spheres) else f"{n} {kind}" for kind, n in responses.items()]
    return f"{text} ({'; '.join(parts)})"


def _check_spheres(value: Any) -> tuple[Sphere | Plane, ...]:
    accepted = "a Sphere, a Plane or a sequence of them"
    if isinstance(value, (Sphere, Plane)):
        return (value,)
    if not np.iterable(value) or isinstance(value, (Set, Mapping)):  # the order of spheres counts
        raise TypeError(f"spheres must be {accepted}, got {check.value_text(value)}")
    spheres = tuple(value)
    for k, sphere in enumerate(spheres):
        if not isinstance(sphere, (Sphere, Plane)):
            raise TypeError(
                f"spheres must be {accepted}, got {check.value_text(sphere)} at index {k}"
            )
    return spheres
