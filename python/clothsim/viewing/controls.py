"""The panel of the live viewer: sliders, buttons, curves and the text about the run."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from threading import Lock
from typing import Any

import numpy as np

from ..methods.integration import integrators
from ..model.scene_files import scene_bytes
from ..model.sphere import OFFSETS, RESPONSES
from .palette import NAMES, Scale
from .playground import FASTEST, SLOWEST, Playground
from .recorder import file_of
from .stage import Stage

CURVES = 200  # entries of a curve
PROBED = (("stretch", "[%]"), ("speed", "[m/s]"))
# viser lays a banner over the picture where the browser draws on the processor.
NO_BANNER = "<style>#webgl-software-rendering { display: none }</style>"


class Controls:
    """Controls of a viser server that change a playground, and show it.

    `attempt` calls its argument and returns whether that succeeded; a refusal is shown in the browser. `inputs` are the
    handles whose values a browser may change.
    """

    def __init__(
        self, viser: Any, server: Any, playground: Playground, stage: Stage, attempt: Callable[[Callable[[], None]], bool]
    ) -> None:
        self.playground, self.stage, self._attempt = playground, stage, attempt
        self.inputs: list[Any] = []
        self._samples: deque[tuple[float, ...]] = deque(maxlen=CURVES)
        self._probed: deque[tuple[float, ...]] = deque(maxlen=CURVES)
        self._point: tuple[int, int] | None = None  # of `_probed`
        self._saving = Lock()
        self.entries: list[tuple[Any, Callable[[], Any]]] = []
        self._shown: dict[str, Any] = {}  # label of an entry -> the value that the playground had when it was shown
        gui, play = server.gui, playground
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        gui.add_html(NO_BANNER)
        self._status = gui.add_markdown("")
        self._bar = gui.add_html("", visible=False)
        self._build_buttons(gui)
        with gui.add_folder("time and gravity"):
            self._build_time(gui)
        with gui.add_folder("cloth"):
            self._build_cloth(gui)
        if play.scene.spheres:
            with gui.add_folder("spheres" if len(play.scene.spheres) > 1 else "sphere"):
                self._build_spheres(gui)
        with gui.add_folder("curves"):
            self._build_curves(viser, gui)
        with gui.add_folder("save", expand_by_default=False):
            self._build_saves(gui)

    def _build_buttons(self, gui: Any) -> None:
        play = self.playground
        self._entry(
            gui.add_checkbox("pause", False, hint="stop and go on"),
            lambda value: setattr(play, "paused", value),
            lambda: play.paused,
        )
        step = gui.add_button("one step", hint="pause, and take one time step")
        step.on_click(lambda _: self._one_step())
        reset = gui.add_button("reset", hint="the scene as it was given, at t = 0")
        reset.on_click(lambda _: self._reset())
        self.inputs += [step, reset]
        self._entry(
            gui.add_checkbox("record", False, hint="keep each picture's state, to save it below"),
            play.record,
            lambda: play.recorder.on,
        )
        self._entry(
            gui.add_dropdown("color", NAMES, initial_value="faces", hint="stretch, speed or depth in a sphere"),
            self.stage.paint,
            lambda: self.stage.color,
        )

    def _build_saves(self, gui: Any) -> None:
        """Buttons that send a file to the browser which asks for it; no file is written beside the scene."""
        play = self.playground

        def button(label: str, name: str, content: Callable[[], bytes]) -> None:
            def save(event: Any) -> None:
                if event.client is None or not self._saving.acquire(blocking=False):
                    return  # a file is made already

                def send() -> None:
                    event.client.send_file_download(name, content(), save_immediately=True)

                try:
                    self._attempt(send)
                finally:
                    self._saving.release()

            handle = gui.add_button(label)
            handle.on_click(save)
            self.inputs.append(handle)

        button("scene, as it is now", "scene.toml", lambda: scene_bytes(play.present()))
        button("recording as a page", "recording.html", lambda: file_of(play.recorded(), "html"))
        button("recording as a file of clothsim", "recording.npz", lambda: file_of(play.recorded(), "npz"))

    def _build_time(self, gui: Any) -> None:
        play = self.playground
        micro = 1e6 * play.dt
        longest = max(2e6 * play.limit if math.isfinite(play.limit) else 2e3, 2 * micro)
        step = 10.0 ** math.floor(math.log10(min(1.0, micro)))
        slow = gui.add_slider("real time x", SLOWEST, FASTEST, 0.01, 1.0, hint="below 1: slow motion")
        self._setting(slow, "speed", lambda: play.speed)
        hint = "a longer step where the scene falls behind"
        self._setting(gui.add_checkbox("step follows machine", play.follows, hint=hint), "follows", lambda: play.follows)
        self._entry(
            gui.add_slider("time step [us]", step, round(longest, 1), step, round(micro, 6)),
            lambda value: play.change(dt=1e-6 * value),
            lambda: 1e6 * play.dt,
        )
        methods = gui.add_dropdown("integrator", tuple(integrators()), initial_value=play.options["integrator"])
        self._setting(methods, "integrator", lambda: play.options["integrator"])
        down = -play.scene.gravity[1]
        most = max(20.0, abs(down))
        gravity = gui.add_slider("gravity [m/s2]", -most, most, 0.1, down)
        self._setting(gravity, "gravity", lambda: -play.scene.gravity[1])

    def _build_cloth(self, gui: Any) -> None:
        play = self.playground

        def entry(family: str, stiffness: float) -> None:
            most = 4 * stiffness or 1000.0
            self._entry(
                gui.add_slider(f"{family} [N/m]", 0.0, most, most / 400, stiffness),
                lambda value: play.change(stiffness={family: value}),
                lambda: play.scene.cloth.family_stiffness[family],
            )

        for family, stiffness in play.scene.cloth.family_stiffness.items():
            entry(family, stiffness)

        def damping() -> float:
            return max(map(float, play.scene.cloth.family_damping.values()), default=0.0)

        most = 4 * damping() or 100.0
        self._setting(gui.add_slider("damping [N s/m]", 0.0, most, most / 400, damping()), "damping", damping)
        drag = play.scene.cloth.drag
        most = 4 * drag or 1.0
        slider = gui.add_slider("drag [N s/m a point]", 0.0, most, most / 400, drag)
        self._setting(slider, "drag", lambda: play.scene.cloth.drag)

    def _build_spheres(self, gui: Any) -> None:
        play = self.playground

        def first() -> Any:
            return play.scene.spheres[0]

        offsets: list[str] = list(OFFSETS)
        if first().offset not in offsets:
            offsets.append(f"{first().offset:g} m")

        def offset_of(text: str) -> str | float:
            return text if text in OFFSETS else float(text.removesuffix(" m"))

        def text_of(offset: str | float) -> str:
            return offset if isinstance(offset, str) else f"{offset:g} m"

        responses = gui.add_dropdown("response", RESPONSES, initial_value=first().response)
        self._setting(responses, "response", lambda: first().response)
        self._entry(
            gui.add_dropdown("offset", offsets, initial_value=text_of(first().offset)),
            lambda value: play.change(offset=offset_of(value)),
            lambda: text_of(first().offset),
        )

        def entry(name: str, least: float, most: float, unit: str = "") -> None:
            slider = gui.add_slider(f"{name}{unit}", least, most, most / 200, getattr(first(), name))
            self._setting(slider, name, lambda: getattr(first(), name))

        radius = first().radius
        entry("restitution", 0.0, 1.0)
        entry("friction", 0.0, max(1.0, 2 * first().friction))
        entry("radius", radius / 10, 2 * radius, " [m]")

    def _build_curves(self, viser: Any, gui: Any) -> None:
        def plot(label: str, color: str, visible: bool) -> Any:
            return gui.add_uplot(
                (np.zeros(2), np.zeros(2)),
                (viser.uplot.Series(label="t [s]"), viser.uplot.Series(label=label, stroke=color, width=2)),
                scales={"x": viser.uplot.Scale(time=False)},
                title=label,
                aspect=2.2,
                visible=visible,
            )

        self._plots = [plot("total energy [J]", "#0072B2", True), plot("penetration [mm]", "#D55E00", True)]
        self._probe = gui.add_markdown("Click a mass point of the cloth to see its values.")
        self._probe_plots = [plot(f"{name} of the point {unit}", "#000000", False) for name, unit in PROBED]

    def _setting(self, handle: Any, name: str, read: Callable[[], Any]) -> None:
        """A control of one argument of `Playground.change`."""
        self._entry(handle, lambda value: self.playground.change(**{name: value}), read)

    def _entry(self, handle: Any, change: Callable[[Any], None], read: Callable[[], Any]) -> None:
        """A control that changes the playground, and returns to its old value if the change is refused."""
        self.entries.append((handle, read))
        self.inputs.append(handle)

        def updated(event: Any) -> None:
            if event.client is not None and not self._attempt(lambda: change(handle.value)):
                handle.value = read()

        handle.on_update(updated)

    def _one_step(self) -> None:
        self.playground.paused = True
        self.playground.tick(0.0, single=True)

    def _reset(self) -> None:
        self.playground.reset()
        self.stage.release()
        self.stage.paint("faces")
        self.stage.picked = None
        self._samples.clear()

    def settle(self) -> None:
        """Set the controls whose values the playground has changed. Others may hold a value that is on its way here."""
        for handle, read in self.entries:
            value = read()
            if self._shown.get(handle.label) != value:
                self._shown[handle.label] = handle.value = value

    def sample(self) -> None:
        """Add the present state to the curves."""
        play = self.playground
        if play.problem or (self._samples and self._samples[-1][0] == play.time):
            return
        total, depth = play.measures()
        self._samples.append((play.time, total, 1e3 * depth))
        _draw(self._plots, self._samples)
        point = self.stage.picked
        if point != self._point:
            self._point = point
            self._probed.clear()
            for plot in self._probe_plots:
                plot.visible = point is not None
            self._probe.content = "Click a mass point of the cloth to see its values."
        if point is not None:
            stretch, speed = play.at(point)
            self._probed.append((play.time, 100 * stretch, speed))
            self._probe.content = (
                f"**row {point[0]}, column {point[1]}**: stretch {100 * stretch:.3g} %, speed {speed:.3g} m/s"
            )
            _draw(self._probe_plots, self._probed)

    def show_status(self) -> None:
        """Show time, speed, stable step and problems."""
        play = self.playground
        with play.lock:
            plan = play.scene.explain(integrator=play.options["integrator"])
            lines = [
                f"**t = {play.time:.3f} s**" + (", paused" if play.paused else ""),
                f"real time x {play.factor:.2f}" if math.isfinite(play.factor) else "real time x -",
                f"stable step {1e6 * play.limit:.4g} us: {plan['limited_by']}",
            ]
            if play.dt > play.limit:
                lines.insert(2, f"**time step {1e6 * play.dt:.4g} us is above the stable step: the state may grow**")
            if play.recorder.frames:
                lines.append(f"{len(play.recorder.frames)} frames recorded")
            if play.problem:
                lines.insert(0, f"**{play.problem}**")
        text = "\n\n".join(lines)
        if self._status.content != text:
            self._status.content = text
        bar = _bar(self.stage.scale) if self.stage.scale else ""
        if self._bar.content != bar:
            self._bar.content, self._bar.visible = bar, bool(bar)


def _draw(plots: list[Any], samples: deque[tuple[float, ...]]) -> None:
    if len(samples) > 1:
        t, *curves = np.array(samples).T
        for plot, curve in zip(plots, curves):
            plot.data = (t, curve)


def _bar(scale: Scale) -> str:
    """The colour bar between its ends."""
    low, high = (f"{scale.factor * end:.3g} {scale.unit}" for end in (scale.low, scale.high))
    stops = ", ".join(f"#{stop}" for stop in scale.stops)
    return (
        f'<div role="img" aria-label="{scale.title} from {low} to {high}" style="display:flex;gap:.5em;'
        'box-sizing:border-box;max-width:100%;padding:.2em 1.2em .2em .6em;font-size:.9em">'
        f'{scale.title} {low}<span style="flex:1;background:linear-gradient(to right, {stops})"></span>'
        f"{'&gt; ' if scale.open_end else ''}{high}</div>"
    )
