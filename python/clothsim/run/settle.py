"""The rest state of a scene, by dynamic relaxation.

Dynamic relaxation follows a damped motion to its end, because only the end counts. Drag takes the
place of the scene's damping. It damps the slowest motion that is left critically, with c = 2 omega
m. Rayleigh's quotient of the last change of the cloth gives the frequency omega. This is the
adaptive viscous damping of Underwood (1983), "Dynamic relaxation". Spheres respond in each step, so
that contact and friction belong to the rest state.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any, overload

import numpy as np

from ..base import Floats, check
from ..base.progress import ProgressBar
from ..engine.force import ForceAtTime, check_force, force_of_each_scene
from ..engine.judge import TIME_STEP
from ..engine.options import Options
from ..engine.state import State, list_scenes
from ..engine.stepping import acceleration
from ..errors import ContactError, UnstableError
from ..methods.bound import stable_dt, stable_dt_in_layer
from ..model.scene import Scene
from ..typing import Force
from .reasons import Reason
from .report import make_report
from .result import Run
from .simulate import raise_interrupted
from .trajectory import Continuation, Trajectory

# This method takes the longest step for one force evaluation.
_INTEGRATOR = "semi_implicit_euler"

# The time step is this part of the guaranteed one. Half needs twice the steps; above 1 nothing is
# guaranteed.
_STEP = 0.9
# Springs are damped by this part of sqrt(stiffness * mass), for the fastest modes. With half of it
# high modes ring on the curtain of seven pins; twice as much shortens the guaranteed step by a
# fifth.
_SPRING_DAMPING = 0.2
# The frequency is estimated after so many steps. Half or twice changes the number of steps by less
# than a third on `benchmarks/settle.py`.
_STEPS_OF_ESTIMATE = 100
# These bound omega over sqrt(gravity / size). Ten times the lower bound doubles the steps of
# a soft curtain near a saddle. The upper bound tames estimates from a wild start; half or twice
# changes little.
_SLOWEST = 0.02
_FASTEST = 5.0
# The residual is measured after so many estimates, and takes a step of a new stepper.
_ESTIMATES_OF_RESIDUAL = 3
# That step is this part of a step of the relaxation: so short that a point stays in contact.
_PROBE = 1e-2
# A scene is said not to rest if the residual does not halve in so many evaluations.
_PATIENCE = 100_000
_TRAVEL = 20.0  # distance that the centre of the cloth may travel, over its size


@overload
def settle(
    scene: Scene,
    tolerance: float = 1e-6,
    *,
    t: float = 0.0,
    max_evaluations: int = 400_000,
    threads: int | None = None,
    progress: bool = False,
    force: Force | list[Force] | None = None,
) -> Run: ...
@overload
def settle(scene: Sequence[Scene], *arguments: Any, **options: Any) -> list[Run]: ...
@check.check_names
def settle(
    scene: Scene | Sequence[Scene],
    tolerance: float = 1e-6,
    *,
    t: float = 0.0,
    max_evaluations: int = 400_000,
    threads: int | None = None,
    progress: bool = False,
    force: Force | list[Force] | None = None,
) -> Run | list[Run]:
    """Find the rest state of a scene, from its initial state, with contact and friction.

    Dynamic relaxation finds a state in which every force is balanced. The initial velocities are
    ignored. Where friction holds the cloth, many rest states exist, and the path from the initial
    state decides which is found.

    Parameters
    ----------
    scene : Scene or sequence of Scene
        Scenes of one shape give a list of runs. Spheres and driven pins are held at their places at
        the time `t`. Spheres with the responses of the paper get a layer, as with response
        "penalty", because a cloth that bounces does not rest. The friction of a layer is 0 at rest:
        a free sheet on a ball, or one that it alone holds, has no rest.
    tolerance : float, default 1e-6
        Largest unbalanced force of a mass point after contact forces, over the largest weight of a
        mass point. Without gravity, over the largest given force. At least 1e-12.
    t : float, default 0.0
        Time of the scene [s].
    max_evaluations : int, default 400,000
        Most force evaluations, >= 1.
    threads : int, optional
        As for `step`.
    progress : bool, default False
        True shows a progress bar of force evaluations.
    force : callable, optional
        As for `simulate`, at the time `t`; so are gusts of a wind.

    Returns
    -------
    Run, or list of Run
        Two frames: the start and the rest state. ``run.t`` is the time of the relaxation, which has
        no physical meaning. ``run.report["residual"]`` is the largest unbalanced force over the
        largest weight. ``run.report["reason"]`` is "" or says why the scene does not rest. The last
        frame is then the best state found.

    Raises
    ------
    RunInterrupted
        On Ctrl-C; its `run` ends with the best state found.

    Examples
    --------
    >>> cloth = cs.Cloth((12, 12), mass=0.3, stiffness=100.0, damping=0.05)
    >>> run = cs.settle(cs.Scene(cloth))
    >>> run.report["residual"] < 1e-6, run.report["reason"]
    (True, '')
    >>> lowest = run.x[-1, ..., 1].min()  # the sag [m]
    """
    if not isinstance(scene, Scene):
        scenes = list_scenes(scene)
        forces = force_of_each_scene(force, scenes, True) or [None] * len(scenes)
        return [
            settle(
                member,
                tolerance,
                t=t,
                max_evaluations=max_evaluations,
                threads=threads,
                progress=progress,
                force=force_of_member,
            )
            for member, force_of_member in zip(scenes, forces, strict=True)
        ]
    tolerance = check.number("tolerance", tolerance, minimum=1e-12)
    t = check.number("t", t)
    most = check.integer("max_evaluations", max_evaluations, minimum=1)
    force = check_force(force)
    force_at_t = None if force is None else ForceAtTime(force, t)
    options = Options(_INTEGRATOR, threads=threads)
    relaxation = _Relaxation(scene_at_rest(scene, t), tolerance, most, t, options, force_at_t)
    with ProgressBar(check.boolean("progress", progress), total=most) as bar:
        try:
            reason = relaxation.relax(bar.bar)
        except KeyboardInterrupt:
            raise_interrupted(lambda: relaxation.make_run("interrupted"))
    return relaxation.make_run(reason)


def scene_at_rest(scene: Scene, t: float) -> Scene:
    """Return the scene with all that moves stopped at its place at a time [s]."""
    wind = scene.wind
    if wind and wind.motion:
        velocity = np.array(wind.velocity) + wind.motion.velocity_at(t)
        wind = wind.replace(velocity=velocity, motion=None)
    spheres = [sphere._copy_at_rest(sphere.center_at(t)) for sphere in scene.spheres]
    scene_at_t = scene.replace(spheres=spheres, wind=wind)
    if not scene.cloth.driven:
        return scene_at_t
    x = scene.initial_position.copy()
    for pins in scene.driven_pins:
        x[pins.rows, pins.columns] = pins.places_at(t)
    return scene_at_t.replace(cloth=scene.cloth.replace(pins=scene.cloth.pinned), position=x)


class _Relaxation:
    """The relaxation of a scene in which nothing moves, by `most` force evaluations at most."""

    def __init__(
        self,
        scene: Scene,
        tolerance: float,
        most: int,
        t: float,
        options: Options,
        force: ForceAtTime | None,
    ) -> None:
        self.scene = scene
        self._tolerance = tolerance
        self._most = most
        self._t = t
        self._options = options
        self._force = force
        # The friction of a layer is 0 at rest, and would only slow the way there.
        layers = [sphere._copy_with_layer(friction=0.0) for sphere in scene.spheres]
        self._plain = scene.replace(spheres=layers)
        self._mass = scene.cloth.mass_per_point[..., None]
        self._free = ~scene.cloth.pinned
        self._scale = self._force_scale()
        self._slow = math.sqrt(self._scale / float(self._mass.max()) / max(scene.cloth.size))
        self._start = scene.initial_position
        damped_scene = self._scene_with_drag(self._slow)
        limits = [stable_dt(damped_scene, _INTEGRATOR)]
        for k, layer in enumerate(layers):
            depth = layer.layer(damped_scene.cloth)["thickness"] / 2
            limits.append(stable_dt_in_layer(damped_scene, _INTEGRATOR, k, depth))
        stable = _STEP * min(limits)
        self._dt = stable if math.isfinite(stable) else 0.1 / self._slow
        self._state = self._make_state(damped_scene, self._start)
        self._steps = 0
        self._seconds = 0.0
        self._best = self._start
        self._best_steps = 0  # steps until the best state
        self._residual = self._measure_residual(self._start)  # residual of the best state
        self._mark = math.inf  # residual that has to be halved
        self._steps_at_mark = 0

    def _force_scale(self) -> float:
        scene = self._plain
        weight = float(self._mass.max() * np.linalg.norm(scene.gravity))
        force = 0.0 if scene.force is None else float(np.linalg.norm(scene.force, axis=-1).max())
        springs = max(scene.cloth.family_stiffness.values(), default=0.0) * min(scene.cloth.spacing)
        return weight or force or springs or 1.0

    def _scene_with_drag(self, omega: float) -> Scene:
        """Return the scene that relaxes.

        Drag damps motion of the frequency `omega` [1/s], and spring damping the fastest modes.
        """
        cloth = self._plain.cloth
        mean = float(self._mass.mean())
        damping = {
            f: _SPRING_DAMPING * math.sqrt(k * mean) for f, k in cloth.family_stiffness.items()
        }
        return self._plain.replace(cloth=cloth.replace(damping=damping, drag=2 * omega * mean))

    def _make_state(self, scene: Scene, x: Floats) -> State:
        options = Options(integrator=_INTEGRATOR, threads=self._options.threads)
        v = np.zeros_like(x)
        return State.from_arguments(scene, x, v, 0.0, options, self._force, quiet=TIME_STEP)

    def _measure_residual(self, x: Floats) -> float:
        """Measure the largest unbalanced force, over the scale of forces.

        It is the momentum after the responses of a short step from rest, over the step.
        """
        probe = self._make_state(self._plain, x)
        dt = _PROBE * self._dt
        try:
            probe.advance(1, dt)
        except (UnstableError, ContactError):
            return math.inf  # The next step of the relaxation says why.
        _, v = probe.positions_and_velocities()
        force = self._mass * v / dt
        return float(np.linalg.norm(force, axis=-1)[self._free].max(initial=0.0)) / self._scale

    def relax(self, bar: Any) -> str:
        """Relax the cloth, and return "" at rest, else why it does not rest."""
        begin = time.perf_counter()
        try:
            return self._relax_in_steps(bar)
        except (UnstableError, ContactError) as error:
            return str(error)
        finally:
            self._seconds = time.perf_counter() - begin

    def _relax_in_steps(self, bar: Any) -> str:
        last_state: tuple[Floats, Floats] | None = None
        estimates = 0
        while self._residual > self._tolerance:
            if self._steps >= self._most:
                return Reason.MOST_EVALUATIONS.format(most=self._most)
            if self._steps - self._steps_at_mark > _PATIENCE:
                return Reason.NOT_HALVED.format(steps=_PATIENCE)
            count = min(_STEPS_OF_ESTIMATE, self._most - self._steps)
            self._state.advance(count, self._dt)
            self._steps += count
            estimates += 1
            if bar is not None:
                bar.update(count)
            x, _ = self._state.positions_and_velocities()
            if self._has_left_its_place(x):
                return Reason.MOVES_AWAY
            state = x, acceleration(self._plain, x, np.zeros_like(x), force=self._force)
            if last_state is not None:
                self._adapt_drag(last_state, state)
            last_state = state
            if estimates % _ESTIMATES_OF_RESIDUAL == 0 or self._steps >= self._most:
                self._keep_best_state(x, self._measure_residual(x))
        return ""

    def _keep_best_state(self, x: Floats, residual: float) -> None:
        """Keep the state if it is the best so far."""
        if residual < self._residual:
            self._best = x
            self._best_steps = self._steps
            self._residual = residual
        if residual < self._mark / 2:
            self._mark = residual
            self._steps_at_mark = self._steps

    def _adapt_drag(self, first: tuple[Floats, Floats], second: tuple[Floats, Floats]) -> None:
        """Damp motion between two states critically, by the frequency of Rayleigh's quotient.

        A state is given by its positions and accelerations.
        """
        change, response = ((b - a)[self._free] for a, b in zip(first, second))
        square = float((change**2).sum())
        if square == 0.0:
            return
        # Negative curvature leads away from a saddle of the energy: drag would only slow the way
        # down.
        omega = math.sqrt(max(0.0, -float((change * response).sum()) / square))
        rate = min(max(omega, _SLOWEST * self._slow), _FASTEST * self._slow)
        self._state.set_scene(self._scene_with_drag(rate))

    def _has_left_its_place(self, x: Floats) -> bool:
        """Tell whether a cloth without pins has left its place."""
        if not self._free.all():
            return False
        centre = self._start.mean(axis=(0, 1))
        farthest = max(
            (float(np.linalg.norm(s.center - centre)) for s in self.scene.spheres), default=0.0
        )
        return bool(
            np.linalg.norm(x.mean(axis=(0, 1)) - centre)
            > _TRAVEL * max(self.scene.cloth.size) + farthest
        )

    def make_run(self, reason: str) -> Run:
        """Return a run that ends with the best state."""
        x = np.array([self._start, self._best])
        v = np.zeros_like(x)
        t = [self._t, self._t + max(self._best_steps, 1) * self._dt]
        rest = self._plain.replace(position=self._best, velocity=None)
        state = State.from_scenes([rest], False, self._t, self._options)
        state.core.set_watch(1, 0.0)
        state.core.sample()
        run = Trajectory(
            scene=self.scene,
            options=self._options,
            t=t,
            x=x,
            v=v,
            steps=self._steps,
            rejected=0,
            evaluations=self._steps,
            wall_time=self._seconds,
            step=self._dt,
            watched=state.core.watched[0],
            state=state,
            saved=None,
            continuation=Continuation(self._t),
        )
        values = make_report(run, reason_unknown=Reason.AT_REST)
        values["residual"] = self._residual if math.isfinite(self._residual) else math.nan
        values["reason"] = reason
        values["impulse"] = [[math.nan] * 3 for _ in self.scene.spheres]
        values["obstacle_work"] = [math.nan] * len(self.scene.spheres)
        values["force_work"] = math.nan
        values["wind_work"] = math.nan
        values["impulse_reason"] = Reason.RELAXED
        return Run(scene=self.scene, t=np.array(t), x=x, v=v, report=values)
