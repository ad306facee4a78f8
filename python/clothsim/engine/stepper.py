"""A scene whose state stays in the core between calls."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import NoReturn

import numpy as np
import numpy.typing as npt

from ..base import check, make_read_only
from ..base.text import format_count
from ..model.scene import Scene, cloth_text, spheres_text
from ..typing import Backend, Force, Integrator, Kernel, Precision
from .force import force_of_each_scene
from .options import Options
from .snapshot import Snapshot, make_snapshot
from .state import FloatArray, State, check_driven_pins, check_sphere_targets, list_scenes


class Stepper:
    """A scene whose state stays in the core between calls.

    Parameters
    ----------
    scene : Scene or sequence of Scene
        A sequence of B scenes of one shape is a batch of B states.
    x, v : array_like, optional
        Initial positions [m] and velocities [m/s], shape (rows, columns, 3) or
        (B, rows, columns, 3). Default: the scene's own.
    t : float, optional
        Time of that state [s]. Required where a sphere moves and `x` is given. Default: 0, the time
        of the scene's own state.
    integrator, precision, threads, kernel, backend, force
        As for `step`. With the backend "gpu" the state stays on the adapter.

    Attributes
    ----------
    x, v : numpy.ndarray
        Positions [m] and velocities [m/s], read-only copies, of the shape and dtype that the state
        was given in; also `positions` and `velocities`.
    t : float
        Time of the state [s]; also `time`.

    Notes
    -----
    One thread at a time may use a stepper: others get a RuntimeError.

    Examples
    --------
    >>> stepper = cs.Stepper(cs.scenes.paper_static())
    >>> stepper.advance(1000, 5e-6)
    >>> round(stepper.t, 12), stepper.x.shape
    (0.005, (32, 32, 3))
    """

    # Slots refuse a new attribute, such as `dt`, which would change nothing.
    __slots__ = ("_options", "_state")

    @check.check_names
    def __init__(
        self,
        scene: Scene | Sequence[Scene],
        x: npt.ArrayLike | None = None,
        v: npt.ArrayLike | None = None,
        *,
        t: float | None = None,
        integrator: Integrator = "rk4",
        precision: Precision = "double",
        threads: int | None = None,
        kernel: Kernel = "auto",
        backend: Backend = "cpu",
        force: Force | list[Force] | None = None,
    ) -> None:
        self._options = Options(integrator, precision, threads, kernel, backend)
        self._state = State.from_arguments(scene, x, v, t, self._options, force)
        self._state.scene_of_caller = scene
        self._state.warn_of_order()

    @check.check_names
    def advance(
        self,
        steps: int,
        dt: float,
        centers: Mapping[int, Sequence[float] | npt.NDArray[np.float64]] | None = None,
    ) -> None:
        """Advance by `steps` time steps of `dt`.

        Parameters
        ----------
        steps : int
            Number of steps, >= 0.
        dt : float
            Time step [s], > 0. `steps` comes before `dt` here, but after it in `step`.
        centers : mapping of int to 3 floats, optional
            Spheres moved by hand, by their indices. In this call each moves straight from its place
            to this centre [m], at constant speed. Contacts have its velocity. After the call it
            rests there, its own motion has ended, and `scene` has its new centre.

        Raises
        ------
        UnstableError
            If the state stops being finite; if it has gained more than nine tenths of its kinetic
            and elastic energy (docs/stability.md); or, with a step above `max_stable_dt`, if a
            point crosses the whole sheet within a step.
        ContactError
            If a mass point goes through a layer. After either error all members have the state
            before that step, with the bits that they have when run alone. After `freeze` of the
            failed member, the others can continue.
        KeyboardInterrupt
            On Ctrl-C. The stepper is then at the end of a step, at the time `time`.

        Warns
        -----
        StabilityWarning
            Once if `dt` is above `max_stable_dt`, and once if the state has gained more than half
            of its kinetic and elastic energy.
        ContactWarning
            As `step`, each once.

        Examples
        --------
        >>> stepper = cs.Stepper(cs.scenes.paper_swing())
        >>> stepper.advance(100, 1e-4)
        """
        if centers is None:
            self._state.advance(steps, dt)
            return
        steps = check.integer("steps", steps, minimum=1)
        self._state.advance_spheres(steps, dt, check_sphere_targets(centers, self._state.scenes))

    def freeze(self, member: int) -> None:
        """Exclude a member of the batch from all further steps; it keeps its present state.

        A batch can thus continue without the unstable member that `UnstableError.member` names.

        Parameters
        ----------
        member : int
            Index into the batch, >= 0.

        Examples
        --------
        >>> stepper = cs.Stepper([cs.scenes.oscillator(stiffness=k) for k in (1.0, 1e6)])
        >>> stepper.freeze(1)
        >>> stepper.frozen.tolist()
        [False, True]
        """
        members = len(self._state.scenes)
        self._state.core.set_frozen(
            check.integer("member", member, minimum=0, maximum=members - 1), True
        )

    @check.check_names
    def set_state(
        self, x: npt.ArrayLike | None = None, v: npt.ArrayLike | None = None, t: float | None = None
    ) -> None:
        """Replace the positions, the velocities or the time.

        A pin cannot be moved here. `Cloth` takes a motion for it: ``pins={(0, 0): cs.Linear((1, 0,
        0))}``.

        Parameters
        ----------
        x, v : array_like, optional
            Positions [m] and velocities [m/s], of the shape of `positions`, with the places and
            velocities that the pins have. Default: the present positions and velocities, with all
            their digits.
        t : float, optional
            Time of the state [s]. Default: the present time.

        Examples
        --------
        >>> stepper = cs.Stepper(cs.scenes.paper_swing())
        >>> stepper.set_state(v=0 * stepper.v)
        """
        self._state.replace_state(x, v, t)

    def set_scene(self, scene: Scene | Sequence[Scene]) -> None:
        """Replace the scene, and keep the state.

        Positions, velocities (with the compensation of "single"), clock and frozen members stay.
        Newly pinned points stop where they are. Points that are no longer pinned start from rest.
        The new scene's initial state is ignored.

        Parameters
        ----------
        scene : Scene or sequence of Scene
            A scene of the present shape. For a batch, a sequence of as many scenes as members.

        Examples
        --------
        >>> scene = cs.scenes.paper_swing()
        >>> stepper = cs.Stepper(scene)
        >>> stepper.set_scene(scene.replace(cloth=scene.cloth.replace(stiffness=20_000.0)))
        """
        old = self._state
        scenes = list_scenes(scene)
        shape = old.scenes[0].cloth.shape
        members = None if isinstance(self.scene, Scene) else len(old.scenes)
        if members != (None if isinstance(scene, Scene) else len(scenes)):
            requirement = "a Scene" if members is None else f"a sequence of {members} scenes"
            raise ValueError(
                f"scene must be {requirement}, as the stepper was made of, "
                f"got {check.value_text(scene)}"
            )
        if scenes[0].cloth.shape != shape:
            raise ValueError(
                f"scene must have a cloth of shape {shape}, got {scenes[0].cloth.shape}"
            )
        check_driven_pins(
            scenes * (len(old.scenes) // len(scenes)), self.positions, self.time, old.core.frozen
        )
        old.set_scene(scene)
        self._state.warn_of_order()

    def set_force(self, force: npt.ArrayLike) -> None:
        """Set the constant force on each mass point from now on.

        The state and the threads stay. `scene` then has the new force. A force that depends on
        time or state is the argument `force` of a stepper.

        Parameters
        ----------
        force : array_like
            Force on each mass point [N], of the shape of `positions`, or (rows, columns, 3) for all
            members of a batch.

        Examples
        --------
        >>> stepper = cs.Stepper(cs.scenes.paper_swing())
        >>> stepper.set_force(0 * stepper.x + (0, 2, 0))
        """
        state = self._state
        shape_of_member = state.shape[-3:]
        if state.batched and np.ndim(force) == 3:
            force = np.broadcast_to(check.array("force", force, shape_of_member), state.shape)
        state.set_force(check.array("force", force, state.shape))

    def snapshot(self) -> Snapshot:
        """Return the whole state, which `restore` continues bit for bit; see `Snapshot`.

        Examples
        --------
        >>> cs.Stepper(cs.scenes.paper_swing()).snapshot()
        <Snapshot of 32 x 32 mass points at t = 0 s (rk4, double)>
        """
        return make_snapshot(self._state, self.scene, self._options)

    def __reduce_ex__(self, protocol: object) -> NoReturn:
        raise TypeError(
            "a Stepper cannot be pickled or copied, as its state lies in the core: pickle "
            "stepper.snapshot() and call Stepper.restore"
        )

    @classmethod
    def restore(cls, snapshot: Snapshot, force: Force | list[Force] | None = None) -> Stepper:
        """Make a stepper with the state and time of `snapshot`; it continues with the same bits.

        Parameters
        ----------
        snapshot : Snapshot
            From `snapshot`, in this process or unpickled in another.
        force : callable, optional
            That of the stepper, which no snapshot keeps: needed where it had one.

        Examples
        --------
        >>> one = cs.Stepper(cs.scenes.paper_swing(), precision="single")
        >>> other = cs.Stepper.restore(one.snapshot())
        """
        if not isinstance(snapshot, Snapshot):
            hint = (
                "; Snapshot.load reads it from a file"
                if isinstance(snapshot, (str, os.PathLike))
                else ""
            )
            raise TypeError(f"snapshot must be a Snapshot, got {check.value_text(snapshot)}{hint}")
        scene = snapshot.scene
        stepper = cls.__new__(cls)
        stepper._options = snapshot.options
        shape = snapshot.shape
        scenes = list_scenes(scene)
        if isinstance(scene, Scene) and len(shape) == 4:
            scenes = scenes * shape[0]
        forces = force_of_each_scene(force, scenes, not isinstance(scene, Scene))
        if snapshot.forced and not forces:
            raise ValueError(
                "force must be given: the stepper had one, and no snapshot keeps functions"
            )
        state = State(
            scenes, len(shape) == 4, shape, snapshot.dtype, snapshot.time, stepper._options, forces
        )
        state.core.restore(snapshot.core)
        state.scene_of_caller = scene
        stepper._state = state
        state.warn_of_order()
        return stepper

    @property
    def frozen(self) -> npt.NDArray[np.bool_]:
        """True for members that take no further steps, shape (B,); see `freeze`."""
        return np.array(self._state.core.frozen)

    @property
    def x(self) -> FloatArray:
        """Positions [m], a read-only copy; `set_state` changes them."""
        x = np.empty(self._state.shape, self._state.dtype)
        self._state.core.store(x, None)
        return make_read_only(x)

    @property
    def v(self) -> FloatArray:
        """Velocities [m/s], a read-only copy."""
        v = np.empty(self._state.shape, self._state.dtype)
        self._state.core.store(None, v)
        return make_read_only(v)

    @property
    def t(self) -> float:
        """Time of the state [s]."""
        return float(self._state.core.time)

    positions, velocities, time = x, v, t

    @property
    def scene(self) -> Scene | Sequence[Scene]:
        """The scene, or the scenes of a batch."""
        return self._state.scene_of_caller

    @property
    def impulses(self) -> npt.NDArray[np.float64]:
        """Impulse on each sphere since the stepper was made [N s], shape (spheres, 3).

        It is the momentum that responses of the sphere took from the cloth, summed over the steps.
        Moves of points without velocity, as those of "ray", give none. Pinned points take no
        momentum.

        A batch has one row per member, shape (B, spheres, 3), NaN where a member has fewer spheres.
        `set_state` and `set_scene` keep the sums, and so do snapshots. With the backend "gpu" all
        are NaN.

        Examples
        --------
        A cloth without gravity gives its momentum to the sphere that it falls on:

        >>> cloth = cs.Cloth(mass=2.0, stiffness=100.0, damping=0.1, pins=())
        >>> scene = cs.Scene(cloth, cs.Sphere((0.5, -0.3, 0.5), 0.25), gravity=(0, 0, 0))
        >>> stepper = cs.Stepper(scene, v=scene.initial_velocity + (0, -1, 0))
        >>> stepper.advance(200, 1e-3)
        >>> gained = 2.0 * (stepper.v.mean(axis=(0, 1)) + (0, 1, 0))
        >>> bool(abs(stepper.impulses[0] + gained).max() < 1e-12)
        True
        """
        members = [np.reshape(watched["impulse"], (-1, 3)) for watched in self._state.core.watched]
        if not self._state.batched:
            return members[0]
        impulses = np.full((len(members), max(map(len, members)), 3), np.nan)
        for row, member in zip(impulses, members):
            row[: len(member)] = member
        return impulses

    def __repr__(self) -> str:
        state = self._state
        scene = state.scenes[0]
        cloths = f"{cloth_text(scene)}, {spheres_text(scene)}"
        if state.batched:
            cloths = f"a batch of {state.shape[0]}, each {cloth_text(scene)}"
        computation = (
            f"{state.integrator} in {self._options.precision}, kernel {state.kernel}, "
            f"{format_count(state.threads, 'thread')}, {state.instruction_set}"
        )
        return f"<Stepper of {cloths}; t = {self.time:.6g} s; {computation}>"
