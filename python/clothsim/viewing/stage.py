"""Objects of the live viewer in space: cloth, spheres, pins, and the arrows that drag them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ..model.mesh import triangles
from .camera import camera_for
from .drawing import PIN_SIZE
from .playground import Playground
from .raster import CLOTH_BACK, CLOTH_FRONT, PIN, SPHERE

MOST_GIZMOS = 16  # pins that can be dragged; more would hide the cloth
BLUE, SAND, GREY, DARK = ((255 * color).round().astype(int).tolist() for color in (CLOTH_FRONT, CLOTH_BACK, SPHERE, PIN))


class Stage:
    """Meshes and handles of a viser server that follow a playground.

    Parameters
    ----------
    server : viser.ViserServer
    playground : Playground
    attempt : callable
        Calls its argument; a refusal is shown in the browser.
    """

    def __init__(self, server: Any, playground: Playground, attempt: Callable[[Callable[[], None]], bool]) -> None:
        self.server, self.playground, self._attempt = server, playground, attempt
        self._dragging: dict[str, Any] = {}  # name of a handle -> the client that holds it
        self._drawn: Any = None  # what the last picture shows: nothing is sent while it stays
        server.scene.set_up_direction("+y")
        x = playground.positions()
        self._build_cloth(x)
        self._build_spheres()
        self._build_pins(x)
        self._place_camera(x)

    def _build_cloth(self, x: npt.NDArray[np.float64]) -> None:
        faces = triangles(self.playground.scene.cloth.shape).astype(np.uint32)
        self._cloth = [
            self.server.scene.add_mesh_simple(
                f"/cloth/{side}",
                x.reshape(-1, 3).astype(np.float32),
                faces,
                color=color,
                side=side,
                cast_shadow=False,
                receive_shadow=False,
            )
            for side, color in (("front", BLUE), ("back", SAND))
        ]

    def _build_spheres(self) -> None:
        self.balls, self.gizmos = [], []
        for k, (sphere, center) in enumerate(zip(self.playground.scene.spheres, self.playground.centers())):
            ball = self.server.scene.add_icosphere(
                f"/spheres/{k}",
                1.0,
                GREY,
                subdivisions=4,
                scale=sphere.radius,
                position=tuple(center),
                cast_shadow=False,
                receive_shadow=False,
            )
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

    def _place_camera(self, x: npt.NDArray[np.float64]) -> None:
        camera = camera_for(None, self.playground.scene, x[None], [0.0])
        towards = np.array(camera.direction) / np.linalg.norm(camera.direction)
        away = 1.2 * max(camera.width, camera.height)
        start = self.server.initial_camera
        start.look_at, start.position, start.up = camera.target, tuple(camera.target + away * towards), (0.0, 1.0, 0.0)

    def _gizmo(self, name: str, size: float, place: Any, drag: Callable[[Any], None]) -> Any:
        handle = self.server.scene.add_transform_controls(
            name, scale=size, disable_rotations=True, position=tuple(place), depth_test=False, opacity=0.6
        )

        def moved(event: Any) -> None:
            if event.phase == "start":
                self._dragging[name] = event.client_id
            place = tuple(map(float, event.target.position))
            self._attempt(lambda: drag(place))
            if event.phase == "end":
                self._dragging.pop(name, None)

        handle.on_update(moved)
        return handle

    def let_go(self, client: Any) -> None:
        """Let handles of a lost client follow the scene again."""
        for name in [name for name, holder in self._dragging.items() if holder == client.client_id]:
            del self._dragging[name]

    def release(self) -> None:
        """Let all handles follow the scene again."""
        self._dragging.clear()

    def draw(self) -> None:
        """Send the present state, if it differs from the last one sent."""
        play = self.playground
        with play.lock:
            x, centers = play.positions().astype(np.float32), play.centers()
            radii = [sphere.radius for sphere in play.scene.spheres]
            state = (play.time, radii, frozenset(self._dragging))
        if state == self._drawn or not np.isfinite(x).all():
            return
        self._drawn = state
        with self.server.atomic():
            for mesh in self._cloth:
                mesh.vertices = x.reshape(-1, 3)
            for ball, gizmo, center, radius in zip(self.balls, self.gizmos, centers, radii):
                ball.position, ball.scale = tuple(center), radius
                self._follow(gizmo, center)
            for dot, gizmo, point in zip(self._dots, self.pin_gizmos, self._pins):
                dot.position = tuple(x[point])
                self._follow(gizmo, x[point])

    def _follow(self, gizmo: Any, place: Any) -> None:
        if gizmo.name not in self._dragging:
            gizmo.position = tuple(place)
