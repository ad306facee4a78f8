"""A scene that is stepped in real time while it is changed: the live viewer without its browser.

`Playground.tick` is called about 30 times a second with the wall time that has passed. It advances the stepper by that
time multiplied by the chosen speed, or by less if the machine is too slow. A time step that no user has chosen follows
the machine: it becomes longer where the scene falls behind, and shorter where time is left.

A dragged sphere travels to its new place in pieces, each on a straight line at constant speed (`Stepper.advance` with
centers). A contact therefore includes the velocity of the drag. A dragged pin travels there too, in short pieces.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from threading import RLock
from time import perf_counter
from typing import Any, cast

import numpy as np

from ..base import Floats, check
from ..base.clocks import seconds_per_step
from ..engine.stepper import SilentStepper, Stepper
from ..errors import ContactError, UnstableError
from ..measure.measures import energy, penetration
from ..methods.bound import usable_dt
from ..methods.integration import integrators
from ..model.as_core import core_cloth
from ..model.ready import PAPER_DT
from ..model.scene import Scene
from ..run.result import Run
from ..stability.limit import max_stable_dt
from .packing import point_stretch
from .recorder import Frame, Recorder

BUSY = 0.6  # part of the wall time that stepping may take for a time step to count as affordable
# A shorter time step is taken where it needs at most this part of the wall time. At BUSY the choice would swing.
IDLE = 0.3
KEPT = 0.95  # part of the chosen speed below which the scene falls behind. At 1, a single slow picture counts.
SETTLING = 1.0  # s of wall time between two choices of a time step; `factor` is a mean over half of it
LADDER = (PAPER_DT, *(k * 10.0**n for n in range(-5, 0) for k in (1, 2, 5)))  # s; time steps to choose from
SLOWEST, FASTEST = 0.01, 2.0  # simulated time a wall time
DRAG_SPEED = 10.0  # m/s; a sphere or pin follows the mouse no faster, else a jerk tears the cloth apart
PIN_TIME = 1e-3  # s; a dragged pin is moved once in this time
LONGEST = 0.1  # s; wall time that a tick makes up for at most, so that a pause is not followed by a rush
MOST_STEPS = 10**9  # of a tick; no machine takes as many, and a tiny time step asks for more than an integer holds


class Playground:
    """A stepper that follows the clock; the arguments are those of `clothsim.view`."""

    def __init__(self, scene: Scene, dt: float | None = None, integrator: str = "rk4", precision: str = "double") -> None:
        self.lock = RLock()
        self.start = self.scene = check.instance("scene", scene, Scene)
        self.options: dict[str, Any] = {"integrator": integrator, "precision": precision}
        self.limit = max_stable_dt(scene, integrator)
        self.stepper = Stepper(scene, **self.options)
        self.cost = self._measured_cost()
        self._start_options, self._start_follows = dict(self.options), dt is None
        self.speed = 1.0
        self.start_dt = self._affordable_dt(BUSY) if dt is None else check.number("dt", dt, minimum=0, exclusive=True)
        self.reset()

    def reset(self) -> None:
        """The scene as it was given, in its initial state, at t = 0."""
        with self.lock:
            self.scene, self.dt, self.follows = self.start, self.start_dt, self._start_follows
            self.options, self.speed = dict(self._start_options), 1.0
            self.limit = max_stable_dt(self.scene, self.options["integrator"])
            self.stepper = Stepper(self.scene, **self.options)
            self.paused = False
            self.problem = ""
            self.factor = math.nan
            self._sphere_targets: dict[int, Floats] = {}
            self._pin_targets: dict[tuple[int, int], Floats] = {}
            self._owed = self._unchanged = 0.0
            self._steps = 0
            self.recorder = Recorder()

    def _measured_cost(self) -> float:
        """Wall time of a step [s]: the least of a few short windows on a separate stepper."""
        stepper = Stepper(self.start, **self.options)
        return seconds_per_step(lambda steps: stepper.advance(steps, 1e-9), 2e-3, 8, 1000) or 1.0

    def _affordable_dt(self, part: float, least: float = 0.0) -> float:
        """The shortest time step of `LADDER` above `least` whose stepping takes at most `part` of the wall time."""
        ceiling = 0.5 * usable_dt(core_cloth(self.scene.cloth), self.options["integrator"])
        wanted = (dt for dt in LADDER if dt > least and self.cost * self.speed <= part * dt)
        return min(ceiling, next(wanted, LADDER[-1]))

    def _follow(self, wall: float) -> None:
        """Choose the time step anew from the measured speed and cost."""
        self._unchanged += wall
        if self._unchanged < SETTLING:
            return
        self._unchanged = 0.0
        if self.factor < KEPT * self.speed:
            self.dt = max(self.dt, self._affordable_dt(BUSY, least=self.dt))
        else:
            self.dt = min(self.dt, self._affordable_dt(IDLE))

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

    def present(self) -> Scene:
        """The scene with its present positions and velocities as its start."""
        with self.lock:
            return self.scene.replace(position=self.positions(), velocity=np.array(self.stepper.velocities, np.float64))

    def at(self, point: tuple[int, int]) -> tuple[float, float]:
        """Stretch of the most stretched spring at a mass point, and the speed of the point [m/s]."""
        with self.lock:
            stretch = point_stretch(self.scene, self.positions()[None]).reshape(self.scene.cloth.shape)
            return float(stretch[point]), float(np.linalg.norm(self.stepper.velocities[point]))

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
        follows: bool | None = None,
        integrator: str | None = None,
        speed: float | None = None,
        **sphere: Any,
    ) -> None:
        """Change the scene or how it is stepped, and keep its state.

        `stiffness` maps families to N/m, `damping` sets every family, `drag` every point, and `gravity` points down
        [m/s^2]. `follows` lets the time step follow the machine; a given `dt` ends that. `speed` is the simulated time
        in a wall time. Other names are fields of all spheres. A refused value raises its ValueError or TypeError, and
        nothing has changed then.
        """
        with self.lock:
            scene = self.scene
            whole = None if stiffness is None else {**scene.cloth.family_stiffness, **stiffness}
            given = {"stiffness": whole, "damping": damping, "drag": drag}
            if cloth := {name: value for name, value in given.items() if value is not None}:
                scene = scene.replace(cloth=scene.cloth.replace(**cloth))
            if gravity is not None:
                gravity = check.number("gravity", gravity)
                scene = scene.replace(gravity=(scene.gravity[0], -gravity, scene.gravity[2]))
            if sphere:
                scene = scene.replace(spheres=[one.replace(**sphere) for one in scene.spheres])
            follows = self.follows if follows is None else check.boolean("follows", follows)
            if dt is not None:
                dt, follows = check.number("dt", dt, minimum=0, exclusive=True), False
            speed = self.speed if speed is None else check.number("speed", speed, minimum=SLOWEST, maximum=FASTEST)
            options = self.options
            if integrator is not None:
                options = {**options, "integrator": check.choice("integrator", integrator, integrators())}
            ceiling = 0.5 * usable_dt(core_cloth(scene.cloth), options["integrator"]) if follows else math.inf
            limit = max_stable_dt(scene, options["integrator"])
            if options != self.options:
                state = self.stepper.positions, self.stepper.velocities
                self.stepper = SilentStepper(scene, *state, t=self.stepper.time, **options)
            elif scene is not self.scene:
                self.stepper.set_scene(scene)
            self.scene, self.limit, self.options, self.follows, self.speed = scene, limit, options, follows, speed
            self.dt = min(self.dt if dt is None else dt, ceiling)

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
        """Advance by what `wall` seconds ask for, but compute for at most `budget` [s]. Return the number of steps.

        `single` takes one time step, also during a pause.
        """
        with self.lock:
            if self.problem or (self.paused and not single):
                return 0
            self._owed = min(self._owed + wall * self.speed, max(LONGEST * self.speed, self.dt))
            steps = 1 if single else int(min(self._owed / self.dt, MOST_STEPS))
            done = self._advance(steps, budget) if steps else 0
            self._owed = 0.0 if done < steps or single else self._owed - done * self.dt
            if wall > 0 and not single:
                factor = done * self.dt / wall
                # A running mean over half a second.
                part = min(1.0, wall / 0.5)
                self.factor = factor if math.isnan(self.factor) else self.factor + part * (factor - self.factor)
                if self.follows:
                    self._follow(wall)
            if self.recorder.on and done:
                self.recorder.add(self._frame())
            return done

    def _advance(self, steps: int, budget: float) -> int:
        """Take steps in pieces of about 5 ms of wall time, or of `PIN_TIME` while a pin is dragged."""
        begun, done = perf_counter(), 0
        # No warnings of the stepper: the page shows the limit, and filters of warnings are for one thread alone.
        judge = self.stepper._state.judge
        self.stepper._state.announced = True
        judge.warned_of_dt = judge.warned_of_growth = judge.warned_of_pins = True
        while done < steps and (done == 0 or perf_counter() - begun < budget):
            piece = max(1, int(0.005 / self.cost))
            if self._pin_targets:
                piece = min(piece, max(1, round(PIN_TIME / self.dt)))
            piece = min(piece, steps - done)
            self._move_pins(piece * self.dt)
            before = perf_counter()
            try:
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
            self.recorder.on = check.boolean("on", on)
            if on:
                self.recorder.frames = [self._frame()]

    def _frame(self) -> Frame:
        v = np.array(self.stepper.velocities, np.float64)
        return Frame(self.time, self.positions(), v, self.centers(), self._steps)

    def recorded(self) -> Run:
        """The recording as a `Run`: the present cloth, and spheres along their recorded paths. It needs two frames."""
        with self.lock:
            return self.recorder.run(self.scene, {**self.options, "dt": self.dt})


def _towards(here: Floats, target: Floats, distance: float) -> Floats:
    """The point at most `distance` from `here` on the way to `target`."""
    way = target - here
    length = float(np.linalg.norm(way))
    return target.copy() if length <= distance else here + way * (distance / length)
