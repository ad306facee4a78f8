"""A scene that is stepped in real time while it is changed: the live viewer without its browser.

`Playground.tick` is called about 30 times a second with the wall time that has passed. It advances the stepper by an
equal simulated time, or by less if the machine is too slow. A dragged sphere travels to its new place in pieces, each on
a straight line at constant speed (`Stepper.advance` with centers). A contact therefore includes the velocity of the
drag. A dragged pin travels there too, in short pieces.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from threading import RLock
from time import perf_counter
from typing import Any, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from ..base import check
from ..base.clocks import seconds_per_step
from ..engine.stepper import Stepper
from ..errors import ContactError, UnstableError
from ..measure.measures import energy, penetration
from ..methods.bound import usable_dt
from ..model.as_core import core_cloth
from ..model.motion import Keyframes
from ..model.ready import PAPER_DT
from ..model.scene import Scene
from ..run.result import Run
from ..stability.limit import max_stable_dt
from ..typing import Report

STEPPING = 0.6  # part of the wall time that stepping may take for a time step to count as affordable
DRAG_SPEED = 10.0  # m/s; a sphere or pin follows the mouse no faster, else a jerk tears the cloth apart
PIN_TIME = 1e-3  # s; a dragged pin is moved once in this time
LONGEST = 0.1  # s; wall time that a tick makes up for at most, so that a pause is not followed by a rush
MOST_STEPS = 10**9  # of a tick; no machine takes as many, and a tiny time step asks for more than an integer holds
RECORDED = 500_000_000  # bytes of a recording; it stops there

Floats = npt.NDArray[np.float64]


class _Frame(NamedTuple):
    """A recorded state."""

    t: float  # [s]
    x: Floats
    v: Floats
    centers: Floats
    steps: int  # since the last reset


class Playground:
    """A stepper that follows the clock.

    Parameters
    ----------
    scene : Scene
    dt : float, optional
        Time step [s]. Default: the paper's 5 us, or the smallest of 1, 2, 5, 10, ... us with which
        the machine keeps up. It is at most half of the guaranteed stable step.
    integrator, precision
        As for `Stepper`.
    """

    def __init__(self, scene: Scene, dt: float | None = None, integrator: str = "rk4", precision: str = "double") -> None:
        if not isinstance(scene, Scene):
            raise TypeError(f"scene must be a Scene, got {check.shown(scene)}")
        self.lock = RLock()
        self.start = scene
        self.options: dict[str, Any] = {"integrator": integrator, "precision": precision}
        self.limit = max_stable_dt(scene, integrator)
        self.stepper = Stepper(scene, **self.options)
        self.cost = self._measured_cost()
        self.dt = self._affordable_dt() if dt is None else check.number("dt", dt, minimum=0, exclusive=True)
        self.start_dt = self.dt
        self.reset()

    def reset(self) -> None:
        """The scene as it was given, in its initial state, at t = 0."""
        with self.lock:
            self.scene, self.dt = self.start, self.start_dt
            self.limit = max_stable_dt(self.scene, self.options["integrator"])
            self.stepper = Stepper(self.scene, **self.options)
            self.paused = False
            self.problem = ""
            self.factor = math.nan
            self._sphere_targets: dict[int, Floats] = {}
            self._pin_targets: dict[tuple[int, int], Floats] = {}
            self._owed = 0.0
            self._steps = 0
            self.frames: list[_Frame] = []
            self.recording = False

    def _measured_cost(self) -> float:
        """Wall time of a step [s]: the least of a few short windows on a separate stepper."""
        stepper = Stepper(self.start, **self.options)
        return seconds_per_step(lambda steps: stepper.advance(steps, 1e-9), 2e-3, 8, 1000) or 1.0

    def _affordable_dt(self) -> float:
        ceiling = 0.5 * usable_dt(core_cloth(self.start), self.options["integrator"])
        steps = [PAPER_DT] + [k * 10.0**n for n in range(-5, 0) for k in (1, 2, 5)]
        for dt in steps:
            if dt > ceiling:
                break
            if self.cost <= STEPPING * dt:
                return dt
        return min(ceiling, steps[-1])

    # Readings of the state.

    def positions(self) -> Floats:
        """A copy of the positions now [m], shape (rows, columns, 3)."""
        with self.lock:
            return np.array(self.stepper.positions, np.float64)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        with self.lock:
            return float(self.stepper.time)

    def centers(self) -> Floats:
        """Present centres of the spheres [m], shape (spheres, 3)."""
        with self.lock:
            return np.reshape([s.center_at(self.stepper.time) for s in self.scene.spheres], (-1, 3))

    def measures(self) -> tuple[float, float]:
        """Total energy [J] and the deepest triangle below the true radius of a sphere [m]."""
        with self.lock:
            x, t = self.stepper.positions, self.stepper.time
            total = energy(self.scene, x, self.stepper.velocities)["total"]
            depths = [penetration(x, sphere, t)["triangles"] for sphere in self.scene.spheres]
            return float(total), float(max(depths, default=0.0))

    # Changes by controls.

    def change(
        self,
        *,
        stiffness: Mapping[str, float] | None = None,
        damping: float | None = None,
        drag: float | None = None,
        gravity: float | None = None,
        dt: float | None = None,
        **sphere: Any,
    ) -> None:
        """Change the scene and keep its state.

        `stiffness` maps families to N/m, `damping` sets every family, `drag` every point, and `gravity` points down
        [m/s^2]. Other names are fields of all spheres. A refused value raises its ValueError or TypeError, and nothing
        has changed then.
        """
        with self.lock:
            scene = self.scene
            cloth: dict[str, Any] = {}
            if stiffness is not None:
                cloth["stiffness"] = {**scene.cloth.family_stiffness, **stiffness}
            if damping is not None:
                cloth["damping"] = damping
            if drag is not None:
                cloth["drag"] = drag
            if cloth:
                scene = scene.replace(cloth=scene.cloth.replace(**cloth))
            if gravity is not None:
                gravity = check.number("gravity", gravity)
                scene = scene.replace(gravity=(scene.gravity[0], -gravity, scene.gravity[2]))
            if sphere:
                scene = scene.replace(spheres=[one.replace(**sphere) for one in scene.spheres])
            if dt is not None:
                dt = check.number("dt", dt, minimum=0, exclusive=True)
            if scene is not self.scene:
                limit = max_stable_dt(scene, self.options["integrator"])
                self.stepper.set_scene(scene)
                self.scene, self.limit = scene, limit
            if dt is not None:
                self.dt = dt

    def drag_sphere(self, index: int, center: Any) -> None:
        """Let a sphere travel to `center` [m]; its own motion ends."""
        index = check.integer("index", index, minimum=0, maximum=len(self.scene.spheres) - 1)
        center = np.array(check.vector("center", center))
        with self.lock:
            self._sphere_targets[index] = center

    def drag_pin(self, point: tuple[int, int], position: Any) -> None:
        """Let a pinned mass point travel to `position` [m]."""
        row, column = point
        if not self.scene.cloth.pinned[row, column]:
            raise ValueError(f"point must be pinned, got {point!r}")
        position = np.array(check.vector("position", position))
        with self.lock:
            self._pin_targets[row, column] = position

    # Time that passes.

    def tick(self, wall: float, budget: float = math.inf, *, single: bool = False) -> int:
        """Advance by `wall` seconds, but compute for at most `budget` [s]. Return the number of steps.

        `single` takes one time step, also during a pause.
        """
        with self.lock:
            if self.problem or (self.paused and not single):
                return 0
            self._owed = min(self._owed + wall, max(LONGEST, self.dt))
            steps = 1 if single else int(min(self._owed / self.dt, MOST_STEPS))
            if not steps:
                return 0
            done = self._advance(steps, budget)
            self._owed = 0.0 if done < steps or single else self._owed - done * self.dt
            if wall > 0 and not single:
                factor = done * self.dt / wall
                # A running mean over half a second.
                part = min(1.0, wall / 0.5)
                self.factor = factor if math.isnan(self.factor) else self.factor + part * (factor - self.factor)
            if self.recording and done:
                self._record()
            return done

    def _advance(self, steps: int, budget: float) -> int:
        """Take steps in pieces of about 5 ms of wall time, or of `PIN_TIME` while a pin is dragged."""
        begun, done = perf_counter(), 0
        while done < steps and (done == 0 or perf_counter() - begun < budget):
            piece = max(1, int(0.005 / self.cost))
            if self._pin_targets:
                piece = min(piece, max(1, round(PIN_TIME / self.dt)))
            piece = min(piece, steps - done)
            self._move_pins(piece * self.dt)
            before = perf_counter()
            try:
                self._silence()
                self.stepper.advance(piece, self.dt, centers=self._next_centers(piece * self.dt))
            except UnstableError as error:
                self.problem = (
                    f"UNSTABLE at point {error.point}, t = {self.time:.4g} s: the time step of "
                    f"{1e6 * self.dt:.4g} us is too long, {1e6 * self.limit:.4g} us are guaranteed. "
                    "Reset, then take a shorter one."
                )
                return done
            except ContactError as error:
                self.problem = f"STOPPED at t = {self.time:.4g} s: {error}"
                return done
            finally:
                self.scene = cast("Scene", self.stepper.scene)  # with the spheres where they are
            self.cost = 0.8 * self.cost + 0.2 * (perf_counter() - before) / piece
            done += piece
            self._steps += piece
        return done

    def _silence(self) -> None:
        """Let the stepper give no warnings: the page shows the limit, and filters of warnings are for one thread alone."""
        state = self.stepper._state
        state.announced = True
        state.judge.warned_of_dt = state.judge.warned_of_growth = state.judge.warned_of_pins = True

    def _next_centers(self, span: float) -> dict[int, Floats] | None:
        """Where dragged spheres travel within `span` seconds, for `Stepper.advance`."""
        centers = {}
        for k, target in list(self._sphere_targets.items()):
            centers[k] = _towards(self.scene.spheres[k].center_at(self.stepper.time), target, DRAG_SPEED * span)
            if (centers[k] == target).all():
                del self._sphere_targets[k]
        return centers or None

    def _move_pins(self, span: float) -> None:
        if not self._pin_targets:
            return
        x = self.stepper.positions.copy()
        for point, target in list(self._pin_targets.items()):
            x[point] = _towards(x[point], target, DRAG_SPEED * span)
            if (x[point] == target).all():
                del self._pin_targets[point]
        self.stepper._state.replace_state(x, pins_stay=False)

    # Recordings.

    def record(self, on: bool) -> None:
        """Begin or end a recording."""
        with self.lock:
            self.recording = check.boolean("on", on)
            if on:
                self.frames = []
                self._record()

    def _record(self) -> None:
        x, v = self.positions(), np.array(self.stepper.velocities, np.float64)
        self.frames.append(_Frame(self.time, x, v, self.centers(), self._steps))
        if len(self.frames) * 2 * x.nbytes > RECORDED:
            self.recording = False

    def recorded(self) -> Run:
        """The recording as a `Run`: the present cloth, and spheres along their recorded paths.

        Raises
        ------
        ValueError
            If fewer than two frames were recorded.
        """
        with self.lock:
            if len(self.frames) < 2:
                raise ValueError(f"a run needs 2 recorded frames, got {len(self.frames)}")
            t, x, v, centers = (np.array(part) for part in list(zip(*self.frames))[:4])
            spheres = [
                sphere.replace(center=tuple(centers[0, k]), motion=Keyframes(t, centers[:, k]))
                for k, sphere in enumerate(self.scene.spheres)
            ]
            scene = self.scene.replace(spheres=spheres)
            return Run(scene, t, x, v, self._report(scene, t, x, v))

    def _report(self, scene: Scene, t: Floats, x: Floats, v: Floats) -> Report:
        """Report of a recording: measures of its frames, and how it was stepped."""
        depths: dict[str, Any] = {"points": 0.0, "triangles": 0.0, "reason": ""}
        for sphere in scene.spheres:
            for name, depth in penetration(x, sphere, t).items():
                depths[name] = max(depths[name], float(np.max(depth)))
        ends = {moment: energy(scene, x[k], v[k]) for moment, k in (("start", 0), ("end", -1))}
        gained = {"gained": math.nan, "reason": "the scene was changed while it was recorded"}
        report = {
            **self.options,
            "steps": self.frames[-1].steps - self.frames[0].steps,
            "dt": self.dt,
            "stopped": "",
            "energy": {**ends, **gained},
            "penetration": depths,
            "recorded": True,
        }
        return cast(Report, report)


def _towards(here: Floats, target: Floats, distance: float) -> Floats:
    """The point at most `distance` from `here` on the way to `target`."""
    way = target - here
    length = float(np.linalg.norm(way))
    return target.copy() if length <= distance else here + way * (distance / length)
