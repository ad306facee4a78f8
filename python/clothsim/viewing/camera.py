"""The view of a picture: in perspective, or orthographic, so that lengths can be compared."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base import Floats, check
from ..typing import Numbers

DISTANCE = 2.0  # of the eye in perspective, in longer sides of the view; as a lens of 70 mm sees
# Longer sides of the cloth up to which a sphere is framed; at half, one that flies towards it comes
# from nowhere.
NEAR = 2.0
MARGIN = 0.05  # around what a view in perspective shows, as a part of half its longer side
# Half the longer side of the narrowest view, in longer sides of the cloth: a cloth without extent
# is seen as a place.
NARROWEST = 0.02
FARTHEST = 1e100  # m from the origin, of what is framed; squares of longer lengths overflow
DIRECTIONS = {
    "corner": (1.0, 0.6, 1.3),
    "front": (0.0, 0.0, 1.0),
    "back": (0.0, 0.0, -1.0),
    "left": (-1.0, 0.0, 0.0),
    "right": (1.0, 0.0, 0.0),
    "top": (0.0, 1.0, 0.0),
    "below": (0.0, -1.0, 0.0),
}
"""Named views: from the scene towards the eye. A cloth with default pins swings across "front"."""


@dataclass(frozen=True, init=False)
class Camera:
    """A view of a scene.

    Parameters
    ----------
    direction : sequence of 3 floats
        Vector from the scene to the eye, of any length but zero. In the picture y is up; in a view
        along y, -z is up.
    target : sequence of 3 floats
        The point in the middle of the picture [m].
    width, height : float
        Size of the part of the plane through `target` that the picture shows [m], > 0.
    distance : float, optional
        Distance of the eye from `target` [m], > 0. Default: an orthographic view, in which equal
        lengths look equal.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above; the message names it.

    Examples
    --------
    >>> camera = cs.Camera((0, 0, 1), target=(0.5, -0.5, 0.5), width=1.5, height=1.2)
    >>> scene = cs.scenes.paper_static()
    >>> cs.picture(scene, camera=camera, width=300).pixels.shape
    (240, 300, 3)
    """

    direction: tuple[float, float, float]
    target: tuple[float, float, float]
    width: float
    height: float
    distance: float | None

    def __init__(
        self,
        direction: Numbers,
        target: Numbers,
        width: float,
        height: float,
        distance: float | None = None,
    ) -> None:
        lengths = {"width": width, "height": height, "distance": distance}
        values = {
            name: check.vector(name, value)
            for name, value in (("direction", direction), ("target", target))
        }
        values |= {
            n: v if v is None else check.number(n, v, minimum=0, exclusive=True)
            for n, v in lengths.items()
        }
        if not any(values["direction"]):
            raise ValueError(f"direction must not be the zero vector, got {direction!r}")
        self.__dict__.update(values)

    def axes(self) -> Floats:
        """Return the right, up and towards-the-eye unit vectors as rows, shape (3, 3).

        Examples
        --------
        >>> cs.Camera((0, 0, 2), (0, 0, 0), 1.0, 1.0).axes().tolist()
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
        """
        depth = np.array(self.direction, float)
        depth /= np.linalg.norm(depth)
        up = (0.0, 1.0, 0.0) if np.hypot(depth[0], depth[2]) > 1e-9 else (0.0, 0.0, -1.0)
        right = np.cross(up, depth)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(depth, right), depth])

    @classmethod
    def around(cls, direction: Any, points: npt.ArrayLike, margin: float = 0.03) -> Camera:
        """Return the orthographic view along `direction` that holds all points, no taller than
        wide.

        Parameters
        ----------
        direction : sequence of 3 floats
            From the points to the eye.
        points : array_like
            Points [m], shape (..., 3).
        margin : float, default 0.03
            Space around them, as a part of their larger extent.

        Examples
        --------
        >>> camera = cs.Camera.around((0, 0, 1), [(0, 0, 0), (2, 1, 0)], margin=0.0)
        >>> camera.width, camera.height
        (2.0, 1.0)
        """
        axes = cls(direction, (0.0, 0.0, 0.0), 1.0, 1.0).axes()
        places = np.asarray(points, float).reshape(-1, 3) @ axes.T
        low = places.min(axis=0)
        high = places.max(axis=0)
        extent = (high - low)[:2].max()
        width, height = (high - low)[:2] + 2 * margin * (extent if extent > 0 else 1.0)
        x, y, z = (float(k) for k in 0.5 * (low + high) @ axes)
        return cls(direction, (x, y, z), float(max(width, height)), float(height))


def view_direction(value: Any) -> tuple[float, float, float]:
    """Return the direction for a name or a vector."""
    if isinstance(value, str):
        return DIRECTIONS[check.choice("camera", value, DIRECTIONS)]
    if isinstance(value, (Iterable, np.ndarray)):
        x, y, z = check.vector("camera", value)
        if x or y or z:
            return x, y, z
    names = ", ".join(map(repr, DIRECTIONS))
    raise ValueError(
        "camera must be a Camera, a direction of 3 numbers that are not all 0, or one of "
        f"{names}, got {check.value_text(value)}"
    )


def is_wide(sphere: Any, scene: Any) -> bool:
    """Return whether a sphere is ground or wall to the cloth."""
    return bool(2 * sphere.radius >= max(scene.cloth.size))


def nearest_place_on_plane(plane: Any, place: npt.ArrayLike, t: float = 0.0) -> Floats:
    """Return the place of a `Plane` that is nearest to another [m]."""
    return np.asarray(np.asarray(place, float) - plane.height(place, t) * plane.unit_normal)


def _framed_points(scene: Any, x: Floats, t: npt.ArrayLike, axes: Floats) -> Iterator[Floats]:
    """Yield what a picture frames, along `axes`, shape (3, n): the mass points, and the outline of
    each sphere near them.

    A wide sphere has no outline: where the cloth touches it, the mass points are framed.
    """
    # `@` would wake BLAS's threads, which then spin beside the picture.
    low = np.full((3, 1), np.inf)
    high = np.full((3, 1), -np.inf)
    for frame in x:
        places = np.einsum("pk,ak->ap", frame.reshape(-1, 3), axes)
        low = np.fmin(low, places.min(axis=1, keepdims=True))
        high = np.fmax(high, places.max(axis=1, keepdims=True))
        yield places
    side = max(scene.cloth.size)
    for sphere in scene.spheres:
        centers = np.einsum(
            "pk,ak->ap", np.atleast_2d(sphere.center_at(np.asarray(t, float))), axes
        )
        offsets = centers - np.clip(centers, low - NEAR * side, high + NEAR * side)
        near = (np.abs(offsets) <= sphere.radius).all(axis=0)
        if near.any() and not is_wide(sphere, scene):
            ends = sphere.radius * np.concatenate([np.eye(3), -np.eye(3)]).T
            yield (centers[:, near, None] + ends[:, None]).reshape(3, -1)


def extremes_along_axes(
    scene: Any, x: Floats, t: npt.ArrayLike, axes: Floats
) -> tuple[Floats, Floats]:
    """Return the ends along `axes` of cloth and spheres near it at all times."""
    low, high = zip(
        *((part.min(axis=1), part.max(axis=1)) for part in _framed_points(scene, x, t, axes))
    )
    return np.min(low, axis=0), np.max(high, axis=0)


def eye_position(camera: Camera, scene: Any) -> Floats:
    """Return the position of the eye [m]; for an orthographic view, that of a perspective view."""
    usual = DISTANCE * max(camera.width, camera.height, *scene.cloth.size)
    return np.asarray(camera.target + (camera.distance or usual) * camera.axes()[2])


def distance_to_extremes(scene: Any, x: Floats, t: npt.ArrayLike, target: Floats) -> float:
    """Return a distance from `target` that holds all of `extremes_along_axes` [m]."""
    low, high = extremes_along_axes(scene, x, t, np.eye(3))
    return float(np.linalg.norm(np.maximum(high - target, target - low)))


def make_camera(value: Any, scene: Any, x: Floats, t: npt.ArrayLike) -> Camera:
    """Return the camera for the argument `camera` and states x, shape (frames, rows, columns, 3).

    A direction gives a perspective view of the cloth and the spheres near it at all times `t`.
    """
    if isinstance(value, Camera):
        return value
    direction = view_direction("corner" if value is None else value)
    axes = Camera(direction, (0.0, 0.0, 0.0), 1.0, 1.0).axes()
    low, high = extremes_along_axes(scene, x, t, axes)
    farthest = max(np.abs(low).max(), np.abs(high).max())
    if not farthest <= FARTHEST:
        raise ValueError(
            f"x must be places at most {FARTHEST:g} m from the origin to be drawn, got one "
            f"{farthest:g} m away"
        )
    camera = Camera.around(direction, np.stack([low, high]) @ axes)
    distance = DISTANCE * max(camera.width, camera.height)
    middle = axes @ camera.target
    parts = (part - middle[:, None] for part in _framed_points(scene, x, t, axes))
    sides = np.max(
        [np.abs(places[:2] * distance / (distance - places[2])).max(axis=1) for places in parts],
        axis=0,
    )
    # In a view of one place only, its sides would be rounding.
    if sides.max() < NARROWEST * max(scene.cloth.size):
        sides = np.full(2, NARROWEST * max(scene.cloth.size))
    width, height = 2 * (sides + MARGIN * sides.max())
    return replace(
        camera, width=float(max(width, height)), height=float(height), distance=float(distance)
    )
