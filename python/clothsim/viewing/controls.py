"""The panel of the live viewer: sliders, buttons, curves and the text about the run."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from ..model.sphere import OFFSETS, RESPONSES
from .playground import Playground

CURVES = 200  # entries of a curve


class Controls:
    """Controls of a viser server that change a playground, and show it.

    Parameters
    ----------
    viser : module
    server : viser.ViserServer
    playground : Playground
    attempt : callable
        Calls its argument and returns whether that succeeded. A refusal is shown in the browser.
    release : callable
        Called at a reset: lets all handles follow the scene again.

    Attributes
    ----------
    inputs : list
        The handles whose values a browser may change.
    """

    def __init__(
        self,
        viser: Any,
        server: Any,
        playground: Playground,
        attempt: Callable[[Callable[[], None]], bool],
        release: Callable[[], None],
    ) -> None:
        self.playground, self._attempt, self._release = playground, attempt, release
        self.inputs: list[Any] = []
        self._samples: deque[tuple[float, float, float]] = deque(maxlen=CURVES)
        self._settled = False  # False: a reset has to be shown
        self.entries: list[tuple[Any, Callable[[], Any]]] = []
        gui, play = server.gui, playground
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        self._status = gui.add_markdown("")
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

    def _build_buttons(self, gui: Any) -> None:
        play = self.playground
        self._pause = gui.add_checkbox("pause", False, hint="stop and go on")
        self._pause.on_update(lambda _: setattr(play, "paused", bool(self._pause.value)))
        step = gui.add_button("one step", hint="pause, and take one time step")
        step.on_click(lambda _: self._one_step())
        reset = gui.add_button("reset", hint="the scene as it was given, at t = 0")
        reset.on_click(lambda _: self._reset())
        self._record = gui.add_checkbox("record", False, hint="keep each picture's state, for viewer.recorded()")
        self._record.on_update(lambda _: play.record(bool(self._record.value)))
        self.inputs += [self._pause, step, reset, self._record]

    def _build_time(self, gui: Any) -> None:
        play = self.playground
        micro = 1e6 * play.dt
        longest = max(2e6 * play.limit if math.isfinite(play.limit) else 2e3, 2 * micro)
        step = 10.0 ** math.floor(math.log10(min(1.0, micro)))
        self._entry(
            gui.add_slider("time step [us]", step, round(longest, 1), step, round(micro, 6)),
            lambda value: play.change(dt=1e-6 * value),
            lambda: 1e6 * play.dt,
        )
        down = -play.scene.gravity[1]
        most = max(20.0, abs(down))
        self._entry(
            gui.add_slider("gravity [m/s2]", -most, most, 0.1, down),
            lambda value: play.change(gravity=value),
            lambda: -play.scene.gravity[1],
        )

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
        most = 4 * self._damping() or 100.0
        self._entry(
            gui.add_slider("damping [N s/m]", 0.0, most, most / 400, self._damping()),
            lambda value: play.change(damping=value),
            self._damping,
        )
        most = 4 * self._drag() or 1.0
        self._entry(
            gui.add_slider("drag [N s/m a point]", 0.0, most, most / 400, self._drag()),
            lambda value: play.change(drag=value),
            self._drag,
        )

    def _damping(self) -> float:
        return max(map(float, self.playground.scene.cloth.family_damping.values()), default=0.0)

    def _drag(self) -> float:
        return self.playground.scene.cloth.drag

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

        self._entry(
            gui.add_dropdown("response", RESPONSES, initial_value=first().response),
            lambda value: play.change(response=value),
            lambda: first().response,
        )
        self._entry(
            gui.add_dropdown("offset", offsets, initial_value=text_of(first().offset)),
            lambda value: play.change(offset=offset_of(value)),
            lambda: text_of(first().offset),
        )

        def entry(name: str, least: float, most: float, unit: str = "") -> None:
            self._entry(
                gui.add_slider(f"{name}{unit}", least, most, most / 200, getattr(first(), name)),
                lambda value: play.change(**{name: value}),
                lambda: getattr(first(), name),
            )

        radius = first().radius
        entry("restitution", 0.0, 1.0)
        entry("friction", 0.0, max(1.0, 2 * first().friction))
        entry("radius", radius / 10, 2 * radius, " [m]")

    def _build_curves(self, viser: Any, gui: Any) -> None:
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

    def _entry(self, handle: Any, change: Callable[[Any], None], read: Callable[[], Any]) -> None:
        """A control that changes the playground, and returns to its old value if the change is refused."""
        self.entries.append((handle, read))
        self.inputs.append(handle)

        def updated(event: Any) -> None:
            if event.client is not None and not self._attempt(lambda: change(handle.value)):
                handle.value = read()

        handle.on_update(updated)

    def _one_step(self) -> None:
        self._pause.value = self.playground.paused = True
        self.playground.tick(0.0, single=True)

    def _reset(self) -> None:
        self.playground.reset()
        self._release()
        self._samples.clear()
        self._settled = False

    def settle(self) -> None:
        """Set the controls to the values of the playground, after a reset."""
        play = self.playground
        if not self._settled:
            self._settled = True
            self._pause.value, self._record.value = play.paused, play.recording
            for handle, read in self.entries:
                handle.value = read()

    def sample(self) -> None:
        """Add the present state to the curves."""
        play = self.playground
        if play.problem or (self._samples and self._samples[-1][0] == play.time):
            return
        total, depth = play.measures()
        self._samples.append((play.time, total, 1e3 * depth))
        if len(self._samples) > 1:
            t, energy, deepest = np.array(self._samples).T
            self._plots[0].data = (t, energy)
            self._plots[1].data = (t, deepest)

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
            if play.frames:
                lines.append(f"{len(play.frames)} frames recorded")
            if play.problem:
                lines.insert(0, f"**{play.problem}**")
        text = "\n\n".join(lines)
        if self._status.content != text:
            self._status.content = text
