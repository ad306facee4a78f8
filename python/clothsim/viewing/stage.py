"""Objects of the live viewer in space: cloth, spheres, pins, the arrows that drag them, and a scale.

viser colours a mesh as a whole. A coloured cloth is therefore `BANDS` meshes, each with the triangles of one part of the
colour scale.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from ..base import Floats
from ..model.mesh import triangles
from .camera import camera_for, extremes
from .lettering import length_in_words, nice_length
from .palette import TITLES, TOP_PART, Scale, scale_of, values_of
from .picture import PIN_SIZE
from .playground import Playground
from .raster import CLOTH_BACK, CLOTH_FRONT, PENETRATION, PIN, SPHERE

BANDS = 16  # meshes of a coloured cloth; at half, steps of colour hide folds, at twice a picture takes twice the messages
PARTS = 4  # of a triangle's edge where it is inside a sphere; the seen outline is that fine
LIFT = 1.003  # of a sphere's radius: where the inside is shown, clear of the sphere as it is drawn with flat triangles
MOST_GIZMOS = 16  # pins that can be dragged; more would hide the cloth
BLUE, SAND, GREY, DARK, RED = (
    (255 * color).round().astype(int).tolist() for color in (CLOTH_FRONT, CLOTH_BACK, SPHERE, PIN, PENETRATION)
)
PICKED = (204, 121, 167)
NO_SHADOWS = {"cast_shadow": False, "receive_shadow": False}

NOTHING = np.zeros((3, 3), np.float32)  # corners of a triangle without area: a mesh needs one


class Stage:
    """Meshes and handles of a viser server that follow a playground.

    `attempt` calls its argument; a refusal is shown in the browser. `color` is "faces", "stretch", "speed" or "depth", and
    `scale` the colour scale of the last picture.
    """

    def __init__(self, server: Any, playground: Playground, attempt: Callable[[Callable[[], None]], bool]) -> None:
        self.server, self.playground, self._attempt = server, playground, attempt
        self._dragging: dict[str, Any] = {}  # name of a handle -> the client that holds it
        self._wanted: dict[str, Callable[[], None]] = {}  # the newest drag of each handle, until `drag`
        self._drawn: Any = None  # what the last picture shows: nothing is sent while it stays
        self.color, self.scale = "faces", cast("Scale | None", None)
        self.picked: tuple[int, int] | None = None
        self._faces = triangles(playground.scene.cloth.shape).astype(np.uint32)
        server.scene.set_up_direction("+y")
        x = playground.positions()
        self._build_cloth(x)
        self._build_spheres()
        self._build_pins(x)
        self._build_scale(x)
        self._place_camera(x)

    def _mesh(self, name: str, color: Any, side: str, x: Any = NOTHING, faces: Any = ((0, 1, 2),)) -> Any:
        return self.server.scene.add_mesh_simple(name, np.float32(x), np.uint32(faces), color=color, side=side, **NO_SHADOWS)

    def _build_cloth(self, x: Floats) -> None:
        sides = (("front", BLUE), ("back", SAND))
        self._cloth = [self._mesh(f"/cloth/{side}", color, side, x.reshape(-1, 3), self._faces) for side, color in sides]
        self._bands = [self._mesh(f"/cloth/band {k}", GREY, "double") for k in range(BANDS)]
        self._inside = self._mesh("/inside", RED, "double")
        self._mark = self.server.scene.add_icosphere(
            "/picked", 1.5 * PIN_SIZE * max(self.playground.scene.cloth.size), PICKED, visible=False
        )

    def _build_spheres(self) -> None:
        self.balls, self.gizmos = [], []
        for k, (sphere, center) in enumerate(zip(self.playground.scene.spheres, self.playground.centers())):
            place = {"scale": sphere.radius, "position": tuple(center)}
            ball = self.server.scene.add_icosphere(f"/spheres/{k}", 1.0, GREY, subdivisions=4, **place, **NO_SHADOWS)
            self.balls.append(ball)

            def drag(place: Any, k: int = k) -> None:
                self.playground.drag_sphere(k, place)

            self.gizmos.append(self._gizmo(f"/drag/sphere {k}", 1.3 * sphere.radius, center, drag))

    def _build_pins(self, x: npt.NDArray[np.float64]) -> None:
        cloth = self.playground.scene.cloth
        size = max(cloth.size)
        self._pins = [(int(row), int(column)) for row, column in np.argwhere(cloth.pinned)][:MOST_GIZMOS]
        self._dots, self.pin_gizmos = [], []
        for k, point in enumerate(self._pins):
            place = tuple(x[point])
            self._dots.append(self.server.scene.add_icosphere(f"/pins/{k}", PIN_SIZE * size, DARK, position=place))

            def drag(place: Any, point: tuple[int, int] = point) -> None:
                self.playground.drag_pin(point, place)

            self.pin_gizmos.append(self._gizmo(f"/drag/pin {k}", 0.12 * size, place, drag))

    def _build_scale(self, x: Floats) -> None:
        """A length below the scene, and the clock."""
        low, high = extremes(self.playground.scene, x[None], [0.0], np.eye(3))
        size = max(self.playground.scene.cloth.size)
        self._length = nice_length(0.5 * size)
        end = np.array((low[0], min(low[1], high[1] - size) - 0.3 * size, high[2]))
        other, rise = end + (self._length, 0.0, 0.0), np.array((0.0, 0.02 * size, 0.0))
        lines = [(end, other), (end - rise, end + rise), (other - rise, other + rise)]
        self.server.scene.add_line_segments("/scale", np.array(lines), DARK, thickness=2.0, thickness_units="screen")
        self._clock = self.server.scene.add_label("/scale/clock", "", position=tuple((end + other) / 2 - rise))

    def show_clock(self) -> None:
        text = f"{length_in_words(self._length)}, t = {self.playground.time:.3f} s"
        if self._clock.text != text:
            self._clock.text = text

    def _place_camera(self, x: Floats) -> None:
        camera = camera_for(None, self.playground.scene, x[None], [0.0])
        towards = np.array(camera.direction) / np.linalg.norm(camera.direction)
        away = 1.2 * max(camera.width, camera.height)
        start = self.server.initial_camera
        start.look_at, start.position, start.up = camera.target, tuple(camera.target + away * towards), (0.0, 1.0, 0.0)

    def _gizmo(self, name: str, size: float, place: Any, drag: Callable[[Any], None]) -> Any:
        handle = self.server.scene.add_transform_controls(
            name, scale=size, disable_rotations=True, position=tuple(place), depth_test=False, opacity=0.6
        )

        # viser awaits it before it reads the next message. A thread of its pool might take an older place last.
        async def moved(event: Any) -> None:
            if event.phase == "start":
                self._dragging[name] = event.client_id
            place = tuple(map(float, event.target.position))
            self._wanted[name] = lambda: drag(place)
            if event.phase == "end":
                self._dragging.pop(name, None)

        handle.on_update(moved)
        return handle

    def drag(self) -> None:
        """Send spheres and pins where they were dragged since the last call."""
        for name in list(self._wanted):
            self._attempt(self._wanted.pop(name))

    def let_go(self, client: Any) -> None:
        """Let handles of a lost client follow the scene again."""
        for name in [name for name, holder in self._dragging.items() if holder == client.client_id]:
            del self._dragging[name]

    def release(self) -> None:
        """Let all handles follow the scene again."""
        self._dragging.clear()
        self._wanted.clear()

    def paint(self, color: str) -> None:
        """Colour the cloth by "stretch", "speed" or "depth", or its sides ("faces")."""
        self.scale, self.color = None, color

    def draw(self) -> None:
        """Send the present state, if it differs from the last one sent."""
        play = self.playground
        with play.lock:
            x, v, centers = play.positions(), np.array(play.stepper.velocities), play.centers()
            radii = [sphere.radius for sphere in play.scene.spheres]
            state = (play.time, radii, centers.tobytes(), frozenset(self._dragging), self.color, self.picked)
            if state == self._drawn or not np.isfinite(x).all():
                return
            values = values_of(self.color, play.scene, x[None], v[None], np.array([play.time]))
        self._drawn = state
        points = x.reshape(-1, 3).astype(np.float32)
        with self.server.atomic():
            for mesh in self._cloth:
                mesh.visible, mesh.vertices = values is None, points
            for mesh in self._bands:
                mesh.visible = values is not None
            if values is not None:
                self._paint_bands(points, values[0])
            _show(self._inside, inside_spheres(x.reshape(-1, 3)[self._faces], centers, radii))
            for ball, gizmo, center, radius in zip(self.balls, self.gizmos, centers, radii):
                ball.position, ball.scale = tuple(center), radius
                self._follow(gizmo, center)
            for dot, gizmo, point in zip(self._dots, self.pin_gizmos, self._pins):
                dot.position = tuple(x[point])
                self._follow(gizmo, x[point])
            self._mark.visible = self.picked is not None
            if self.picked is not None:
                self._mark.position = tuple(x[self.picked])

    def _paint_bands(self, points: npt.NDArray[np.float32], values: Floats) -> None:
        """Give each triangle to the band of its mean value; the top of the scale is 1, 2 or 5 times a power of ten."""
        most = max(float(np.quantile(values, TOP_PART)), 0.01 / TITLES[self.color][2])
        top = self.scale.high if self.scale else 0.0
        if not 0.2 * top <= most <= top:
            top = nice_length(2.5 * most)
        scale = scale_of(self.color, values, (0.0, top))
        if self.scale is None:
            for band, color in zip(self._bands, scale.colors(top * (np.arange(BANDS) + 0.5) / BANDS)):
                band.color = tuple(int(round(255 * part)) for part in color)
        self.scale = scale
        levels = (BANDS * values.reshape(-1)[self._faces].mean(axis=1) / top).clip(0, BANDS - 1).astype(int)
        for k, band in enumerate(self._bands):
            _show(band, points[self._faces[levels == k]])

    def _follow(self, gizmo: Any, place: Any) -> None:
        if gizmo.name not in self._dragging:
            gizmo.position = tuple(place)

    def pick(self, origin: Any, direction: Any) -> None:
        """Choose the mass point next to the place of the cloth that a ray from the eye meets first, or none."""
        with self.playground.lock:
            x, centers = self.playground.positions().reshape(-1, 3), self.playground.centers()
            radii = [sphere.radius for sphere in self.playground.scene.spheres]
        origin, ray = np.array(origin), np.array(direction) / np.linalg.norm(direction)
        reach = np.inf
        for seen, radius in zip(centers - origin, radii):
            along = seen @ ray
            across = radius**2 + along**2 - seen @ seen
            if across > 0 < along:
                # Cloth that dips into the sphere can be picked too.
                reach = min(reach, along - np.sqrt(across) + max(self.playground.scene.cloth.spacing))
        distances, weights = _hits(x[self._faces], origin, ray)
        first = int(np.argmin(distances))
        self.picked = None
        if distances[first] < reach:
            row, column = divmod(int(self._faces[first, np.argmax(weights[first])]), self.playground.scene.cloth.shape[1])
            self.picked = row, column


def _hits(corners: Floats, origin: Floats, ray: Floats) -> tuple[Floats, Floats]:
    """Where a ray meets triangles, shape (n, 3, 3): the distance, or infinity, and the weights of the corners there."""
    one, two, seen = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], origin - corners[:, 0]
    across, turned = np.cross(ray, two), np.cross(seen, one)
    size = (one * across).sum(axis=1)
    size = np.where(size == 0, np.nan, size)
    b, c, along = (seen * across).sum(axis=1) / size, turned @ ray / size, (two * turned).sum(axis=1) / size
    weights = np.stack([1 - b - c, b, c], axis=1)
    return np.where((weights >= 0).all(axis=1) & (along > 0), along, np.inf), weights


def _show(mesh: Any, corners: npt.NDArray[Any]) -> None:
    """Let a mesh show triangles, shape (triangles, 3, 3); without any, one of no area."""
    points = corners.reshape(-1, 3) if len(corners) else NOTHING
    if not len(corners) and len(mesh.vertices) == len(NOTHING):
        return
    mesh.vertices = points.astype(np.float32)
    mesh.faces = np.arange(len(points), dtype=np.uint32).reshape(-1, 3)


_SUBS = [((i, j), (i + 1, j), (i, j + 1)) for i in range(PARTS) for j in range(PARTS - i)]
_SUBS += [((i + 1, j), (i + 1, j + 1), (i, j + 1)) for i in range(PARTS - 1) for j in range(PARTS - 1 - i)]
_WEIGHTS = np.array([[(PARTS - i - j, i, j) for i, j in sub] for sub in _SUBS]) / PARTS  # (PARTS^2, 3, 3)


def inside_spheres(corners: Floats, centers: Floats, radii: list[float]) -> Floats:
    """The parts of triangles, shape (n, 3, 3), that are inside spheres, as triangles on the spheres."""
    found = [np.zeros((0, 3, 3))]
    for center, radius in zip(centers, radii):
        reach = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=-1).max(axis=1)
        near = np.linalg.norm(corners.mean(axis=1) - center, axis=-1) < radius + reach
        small = np.einsum("swk,nkd->nswd", _WEIGHTS, corners[near] - center).reshape(-1, 3, 3)
        distance = np.linalg.norm(small, axis=-1, keepdims=True)
        chosen = (distance < (1 - 1e-6) * radius).any(axis=(1, 2))
        small, distance = small[chosen], distance[chosen]
        found.append(center + small * np.maximum(distance, LIFT * radius) / np.maximum(distance, 1e-12))
    return np.concatenate(found)
