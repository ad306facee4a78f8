"""The live viewer: a `Playground` in the browser, by viser (extra "view").

viser serves the page and keeps it in step over a websocket. One thread here steps and draws 30 times a
second; what a reader moves arrives on other threads and waits for the playground's lock.
"""

from __future__ import annotations

import atexit
import math
from collections import deque
from collections.abc import Callable
from threading import Event, Thread
from time import perf_counter
from typing import Any

import numpy as np

from ..base import check
from ..base.extras import needed
from ..model.mesh import triangles
from ..model.scene import Scene
from ..run.result import Run
from .camera import camera_for
from .picture import PIN_SIZE
from .playground import Playground

FPS = 30.0  # pictures a second
SHARE = 0.7  # part of the time between two pictures that stepping may take; drawing needs the rest
CURVES = 200  # entries of a curve, CURVE_RATE a second of wall time
CURVE_RATE = 10.0
MOST_GIZMOS = 16  # pins that can be dragged; more would hide the cloth
BLUE, SAND, GREY, DARK = (69, 120, 184), (222, 186, 115), (205, 207, 212), (38, 38, 38)


class Viewer:
    """A live viewer that runs until `stop`; made by `clothsim.view`.

    Attributes
    ----------
    url : str
        Where the browser finds it.
    playground : Playground
        The scene, its stepper and its clock.
    """

    def __init__(self, playground: Playground, host: str, port: int) -> None:
        viser = needed("viser", "the live viewer", "view")
        self.playground = playground
        self.server = viser.ViserServer(host=host, port=port, label="clothsim", verbose=False)
        shown = "localhost" if host in ("127.0.0.1", "0.0.0.0") else host
        self.url = f"http://{shown}:{self.server.get_port()}"
        self._over = Event()
        self._dragging: set[str] = set()
        self._samples: deque[tuple[float, float, float]] = deque(maxlen=CURVES)
        self._settled = False  # False: a reset has to be shown in the controls
        self._drawn: Any = None  # what the last picture shows: nothing is sent while it stays
        self._build_scene()
        self._build_controls(viser)
        self._thread = Thread(target=self._loop, name="clothsim view", daemon=True)
        self._thread.start()
        atexit.register(self.stop)  # a thread inside the core must not outlive the interpreter

    # The scene.

    def _build_scene(self) -> None:
        scene, add = self.playground.scene, self.server.scene
        add.set_up_direction("+y")
        x = self.playground.positions()
        faces = triangles(scene.cloth.shape).astype(np.uint32)
        self._cloth = [
            add.add_mesh_simple(
                f"/cloth/{side}",
                x.reshape(-1, 3).astype(np.float32),
                _up(faces, scene),
                color=color,
                side=side,
                cast_shadow=False,
                receive_shadow=False,
            )
            for side, color in (("front", BLUE), ("back", SAND))
        ]
        size = max(scene.cloth.size)
        self._balls, self._gizmos = [], []
        for k, sphere in enumerate(scene.spheres):
            center = tuple(sphere.center_at(0.0))
            ball = add.add_icosphere(
                f"/spheres/{k}",
                1.0,
                GREY,
                subdivisions=4,
                scale=sphere.radius,
                position=center,
                cast_shadow=False,
                receive_shadow=False,
            )
            self._balls.append(ball)
            self._gizmos.append(self._gizmo(f"/drag/sphere {k}", 1.3 * sphere.radius, center, self._sphere_dragger(k)))
        self._pins = [(int(row), int(column)) for row, column in np.argwhere(scene.cloth.pinned)]
        self._dots, self._pin_gizmos = [], []
        for k, point in enumerate(self._pins[:MOST_GIZMOS]):
            place = tuple(x[point])
            self._dots.append(add.add_icosphere(f"/pins/{k}", PIN_SIZE * size, DARK, position=place))
            self._pin_gizmos.append(self._gizmo(f"/drag/pin {k}", 0.12 * size, place, self._pin_dragger(point)))
        camera = camera_for(None, scene, x[None], [0.0])
        towards = np.array(camera.direction) / np.linalg.norm(camera.direction)
        self.server.initial_camera.look_at = camera.target
        away = 1.2 * max(camera.width, camera.height)
        self.server.initial_camera.position = tuple(camera.target + away * towards)
        self.server.initial_camera.up = (0.0, 1.0, 0.0)

    def _gizmo(self, name: str, size: float, place: Any, drag: Callable[[Any], object]) -> Any:
        handle = self.server.scene.add_transform_controls(
            name, scale=size, disable_rotations=True, position=place, depth_test=False, opacity=0.6
        )

        def moved(event: Any) -> None:
            if event.phase == "start":
                self._dragging.add(name)
            drag(event.target.position)
            if event.phase == "end":
                self._dragging.discard(name)

        handle.on_update(moved)
        return handle

    def _sphere_dragger(self, k: int) -> Callable[[Any], object]:
        play = self.playground
        return lambda place: self._try(lambda: play.drag_sphere(k, tuple(map(float, place))))

    def _pin_dragger(self, point: tuple[int, int]) -> Callable[[Any], object]:
        play = self.playground
        return lambda place: self._try(lambda: play.drag_pin(point, tuple(map(float, place))))

    # The controls.

    def _build_controls(self, viser: Any) -> None:
        gui, play = self.server.gui, self.playground
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        self._status = gui.add_markdown("")
        self._pause = gui.add_checkbox("pause", False, hint="stop and go on")
        self._pause.on_update(lambda _: setattr(play, "paused", bool(self._pause.value)))
        gui.add_button("one step", hint="pause, and take one time step").on_click(lambda _: self._one_step())
        gui.add_button("reset", hint="the scene as it was given, at t = 0").on_click(lambda _: self._reset())
        self._record = gui.add_checkbox("record", False, hint="keep each picture's state, for viewer.recorded()")
        self._record.on_update(lambda _: play.record(bool(self._record.value)))
        self._controls: list[tuple[Any, Callable[[], Any]]] = []
        with gui.add_folder("time and gravity"):
            self._build_time(gui)
        with gui.add_folder("cloth"):
            self._build_cloth(gui)
        if play.scene.spheres:
            with gui.add_folder("spheres" if len(play.scene.spheres) > 1 else "sphere"):
                self._build_spheres(gui)
        with gui.add_folder("curves"):
            self._plots = [
                gui.add_uplot(
                    (np.zeros(2), np.zeros(2)),
                    (viser.uplot.Series(label="t [s]"), viser.uplot.Series(label=label, stroke=color, width=2)),
                    scales={"x": viser.uplot.Scale(time=False)},
                    title=label,
                    aspect=2.2,
                )
                for label, color in (("total energy [J]", "#0072B2"), ("penetration [mm]", "#D55E00"))
            ]

    def _build_time(self, gui: Any) -> None:
        play = self.playground
        micro = 1e6 * play.dt
        longest = max(2e6 * play.limit if math.isfinite(play.limit) else 2e3, 2 * micro)
        step = 10.0 ** math.floor(math.log10(min(1.0, micro)))
        self._control(
            gui.add_slider("time step [us]", step, round(longest, 1), step, round(micro, 6)),
            lambda value: play.change(dt=1e-6 * value),
            lambda: 1e6 * play.dt,
        )
        down = -play.scene.gravity[1]
        self._control(
            gui.add_slider("gravity [m/s2]", -max(20.0, abs(down)), max(20.0, abs(down)), 0.1, down),
            lambda value: play.change(gravity=value),
            lambda: -play.scene.gravity[1],
        )

    def _build_cloth(self, gui: Any) -> None:
        play = self.playground

        def control(family: str, stiffness: float) -> None:
            most = 4 * stiffness or 1000.0
            self._control(
                gui.add_slider(f"{family} [N/m]", 0.0, most, most / 400, stiffness),
                lambda value: play.change(stiffness={family: value}),
                lambda: play.scene.cloth.family_stiffness[family],
            )

        for family, stiffness in play.scene.cloth.family_stiffness.items():
            control(family, stiffness)
        most = 4 * self._damping() or 100.0
        unit = "N s/m" if play.scene.cloth.damping_model == "spring" else "N s/m a point"
        self._control(
            gui.add_slider(f"damping [{unit}]", 0.0, most, most / 400, self._damping()),
            lambda value: play.change(damping=value),
            self._damping,
        )

    def _damping(self) -> float:
        cloth = self.playground.scene.cloth
        if cloth.damping_model == "point":
            return float(cloth.point_damping)
        return max(map(float, cloth.family_damping.values()), default=0.0)

    def _build_spheres(self, gui: Any) -> None:
        play = self.playground

        def first() -> Any:
            return play.scene.spheres[0]

        offsets = ["none", "edge", "face"]
        if first().offset not in offsets:
            offsets.append(f"{first().offset:g} m")

        def offset_of(text: str) -> str | float:
            return text if text in ("none", "edge", "face") else float(text.removesuffix(" m"))

        def text_of(offset: str | float) -> str:
            return offset if isinstance(offset, str) else f"{offset:g} m"

        self._control(
            gui.add_dropdown("response", ("reflect", "ray", "continuous"), initial_value=first().response),
            lambda value: play.change(response=value),
            lambda: first().response,
        )
        self._control(
            gui.add_dropdown("offset", offsets, initial_value=text_of(first().offset)),
            lambda value: play.change(offset=offset_of(value)),
            lambda: text_of(first().offset),
        )

        def control(name: str, least: float, most: float, unit: str = "") -> None:
            self._control(
                gui.add_slider(f"{name}{unit}", least, most, most / 200, getattr(first(), name)),
                lambda value: play.change(**{name: value}),
                lambda: getattr(first(), name),
            )

        radius = first().radius
        control("restitution", 0.0, 1.0)
        control("friction", 0.0, max(1.0, 2 * first().friction))
        control("radius", radius / 10, 2 * radius, " [m]")

    def _control(self, handle: Any, change: Callable[[Any], None], read: Callable[[], Any]) -> None:
        """A control that changes the playground, and goes back where that is refused."""
        self._controls.append((handle, read))

        def updated(event: Any) -> None:
            if event.client is not None and not self._try(lambda: change(handle.value)):
                handle.value = read()

        handle.on_update(updated)

    def _try(self, action: Callable[[], None]) -> bool:
        """Whether the action was taken; what refused it is shown."""
        try:
            action()
        except (ValueError, TypeError) as error:
            for client in self.server.get_clients().values():
                client.add_notification("Not possible", str(error), auto_close_seconds=8.0)
            return False
        return True

    def _one_step(self) -> None:
        self._pause.value = self.playground.paused = True
        self.playground.tick(0.0, single=True)

    def _reset(self) -> None:
        self.playground.reset()
        self._samples.clear()
        self._settled = False

    # The loop.

    def _loop(self) -> None:
        last = perf_counter()
        shown = sampled = -math.inf
        while not self._over.is_set():
            now = perf_counter()
            try:
                self.playground.tick(now - last, SHARE / FPS)
                self._draw()
                if now - sampled >= 1 / CURVE_RATE:
                    sampled = now
                    self._sample()
                if now - shown >= 0.2:
                    shown = now
                    self._show_status()
            except Exception as error:  # a reader of the page has to see why it stands still
                self.playground.problem = f"STOPPED by an error: {type(error).__name__}: {error}"
                self._show_status()
            last = now
            self._over.wait(max(0.0, 1 / FPS - (perf_counter() - now)))

    def _draw(self) -> None:
        play = self.playground
        with play.lock:
            x, centers = play.positions().astype(np.float32), play.centers()
            radii = [sphere.radius for sphere in play.scene.spheres]
            state = (play.time, radii, frozenset(self._dragging))
        self._show_settings()
        if state == self._drawn or not np.isfinite(x).all():
            return
        self._drawn = state
        with self.server.atomic():
            for mesh in self._cloth:
                mesh.vertices = x.reshape(-1, 3)
            for ball, gizmo, center, radius in zip(self._balls, self._gizmos, centers, radii):
                ball.position, ball.scale = tuple(center), radius
                if gizmo.name not in self._dragging:
                    gizmo.position = tuple(center)
            for dot, gizmo, point in zip(self._dots, self._pin_gizmos, self._pins):
                dot.position = tuple(x[point])
                if gizmo.name not in self._dragging:
                    gizmo.position = tuple(x[point])

    def _show_settings(self) -> None:
        """After a reset: the controls as the playground is."""
        play = self.playground
        if not self._settled:
            self._settled = True
            self._pause.value, self._record.value = play.paused, play.recording
            for handle, read in self._controls:
                handle.value = read()

    def _sample(self) -> None:
        play = self.playground
        if play.problem or (self._samples and self._samples[-1][0] == play.time):
            return
        total, depth = play.measures()
        self._samples.append((play.time, total, 1e3 * depth))
        if len(self._samples) > 1:
            t, energy, deepest = np.array(self._samples).T
            self._plots[0].data = (t, energy)
            self._plots[1].data = (t, deepest)

    def _show_status(self) -> None:
        play = self.playground
        with play.lock:
            plan = play.scene.explain(integrator=play.options["integrator"])
            lines = [
                f"**t = {play.time:.3f} s**" + (", paused" if play.paused else ""),
                f"real time x {play.factor:.2f}" if math.isfinite(play.factor) else "real time x -",
                f"stable step {1e6 * play.limit:.4g} us: {plan['limited_by']}",
            ]
            if play.frames:
                lines.append(f"{len(play.frames)} frames recorded")
            if play.problem:
                lines.insert(0, f"**{play.problem}**")
        text = "\n\n".join(lines)
        if self._status.content != text:
            self._status.content = text

    def recorded(self) -> Run:
        """What was recorded, as a `Run` whose spheres travel as they were dragged."""
        return self.playground.recorded()

    def stop(self) -> None:
        """End stepping and serving."""
        if self._over.is_set():
            return
        self._over.set()
        self._thread.join()
        self.server.stop()
        atexit.unregister(self.stop)

    def __repr__(self) -> str:
        return f"<Viewer at {self.url}>"


def _up(faces: Any, scene: Scene) -> Any:
    """The triangles with normals that point up on the flat sheet."""
    a, b, c = scene.cloth.rest_positions.reshape(-1, 3)[faces[0]] if len(faces) else np.eye(3)
    return faces if np.cross(b - a, c - a)[1] >= 0 else faces[:, [0, 2, 1]]


def view(
    scene: Scene,
    block: bool = True,
    *,
    dt: float | None = None,
    integrator: str = "rk4",
    precision: str = "double",
    host: str = "127.0.0.1",
    port: int = 8080,
) -> Viewer | None:
    """Open the live viewer; see `clothsim.view`."""
    block = check.boolean("block", block)
    port = check.integer("port", port, minimum=1, maximum=65535)
    if not isinstance(host, str):
        raise TypeError(f"host must be a name or address, got {host!r} ({type(host).__name__})")
    needed("viser", "the live viewer", "view")
    viewer = Viewer(Playground(scene, dt, integrator, precision), host, port)
    if not block:
        return viewer
    print(f"Live at {viewer.url} - Ctrl-C ends it")
    try:
        while True:
            viewer._over.wait(3600.0)
    except KeyboardInterrupt:
        viewer.stop()
    return None
