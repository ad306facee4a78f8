"""Stepping a scene: `step`, `acceleration` and `Stepper`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _validate as check
from ._keywords import suggesting, suggests
from ._state import FloatArray, State, out_array, out_arrays, state_arrays
from .scene import Scene


@suggests
def step(
    scene: Scene | Sequence[Scene],
    x: npt.ArrayLike,
    v: npt.ArrayLike,
    dt: float,
    steps: int = 1,
    t: float = 0.0,
    integrator: str = "rk4",
    precision: str = "double",
    threads: int | None = None,
    out: tuple[FloatArray, FloatArray] | None = None,
    *,
    kernel: str = "auto",
    strict: bool = False,
    backend: str = "cpu",
) -> tuple[FloatArray, FloatArray]:
    """Advance positions and velocities by `steps` time steps of `dt`.

    Each step is one of the integrator's (default: classic Runge-Kutta of order 4 on (x, v)
    together), followed by one collision pass per sphere. Pinned points do not move; velocities given for them are taken as 0.

    Parameters
    ----------
    scene : Scene or sequence of Scene
        A sequence of B scenes of one shape goes with a batch of B states.
    x, v : array_like
        Positions [m] and velocities [m/s], shape (rows, columns, 3) or (B, rows, columns, 3).
        float32 and float64 are taken as they are, C-contiguous ones without a copy; other real
        dtypes as float64. Never modified.
    dt : float
        Time step [s], > 0.
    steps : int, default 1
        Number of steps, >= 0.
    t : float, default 0.0
        Time of the state given [s]; spheres move by it.
    integrator : str, default "rk4"
        Time integration method, a name of `integrators`. Adaptive ones run at `dt` like the rest.
    precision : {"double", "single"}, default "double"
        Arithmetic. "single" computes in float32 and keeps what rounding takes from x and v in a
        second float32 each (compensated summation), without which small steps stall.
    threads : int, optional
        Threads used, 1 to 256. Default: by size, and by what steps are seen to cost: one thread
        wherever that is faster. The result has the same bits for any number.
    out : (numpy.ndarray, numpy.ndarray), optional
        Arrays of the result's shape and dtype to write to; may be `x` and `v` themselves.
    kernel : {"auto", "gather", "edge"}, default "auto"
        "gather" is the compute shader's: one lane a mass point that gathers its neighbours.
        "edge" takes each spring once and is faster. "auto" is "edge", or "gather" if `strict`.
    strict : bool, default False
        True: exact roots and divisions and nothing fused, so that every instruction set gives the
        same bits, at 2.7 times the time of the kernel "edge", which has no such class.
    backend : {"cpu", "gpu"}, default "cpu"
        "gpu" steps on the graphics adapter (docs/gpu.md), in the kernel "gather"; `strict` then
        keeps products apart from sums, so that an adapter that rounds correctly gives the bits of
        the core's strict class. Takes no `threads`.

    Returns
    -------
    x, v : numpy.ndarray
        The new state, of the shape and dtype of the input (float64 if either is). float64 holds
        the whole compensated state of "single"; float32 drops the compensation at each call (a
        `Stepper` keeps it).

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above; nothing has changed then.
    UnstableError
        If the state stops being finite or runs away; nothing is written to `out` then.

    Warns
    -----
    StabilityWarning
        If `dt` is above `max_stable_dt`, the step that is guaranteed to be stable.
    KeyboardInterrupt
        On Ctrl-C, between two steps.
    ImportError, MemoryError, clothsim.gpu.AdapterLostError, RuntimeError
        With the backend "gpu" only: without wgpu; if the adapter's memory does not suffice; if it
        stops answering; if there is none.

    Examples
    --------
    One oscillation of a spring (`clothsim.scenes.oscillator`) ends where it began:

    >>> import math
    >>> import clothsim as cs
    >>> scene = cs.scenes.oscillator(stiffness=100.0, mass=1.0, amplitude=0.1)
    >>> period = 2 * math.pi / 10
    >>> x, v = cs.step(scene, scene.initial_position, scene.initial_velocity, period / 1000, 1000)
    >>> float(abs(x - scene.initial_position).max()) < 1e-10
    True
    """
    state = State(
        scene, x, v, t=t, integrator=integrator, precision=precision, threads=threads,
        kernel=kernel, strict=strict, backend=backend,
    )
    like = np.empty(state.shape, state.dtype)
    results = out_arrays(out, like)
    state.warn_of_order()
    state.advance(steps, dt)
    state.store(*results)
    return results


@suggests
def acceleration(
    scene: Scene | Sequence[Scene],
    x: npt.ArrayLike,
    v: npt.ArrayLike,
    t: float = 0.0,
    precision: str = "double",
    out: FloatArray | None = None,
    *,
    threads: int | None = None,
    kernel: str = "auto",
    strict: bool = False,
) -> npt.NDArray[np.float64]:
    """Acceleration of every mass point: springs, damping and gravity. Spheres exert no force.

    Parameters
    ----------
    scene, x, v, t, precision, threads, kernel, strict
        As for `step`.
    out : numpy.ndarray, optional
        float64 array of the shape of `x` to write to.

    Returns
    -------
    numpy.ndarray
        Accelerations [m/s^2], float64, of the shape of `x`; 0 for pinned points.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.

    Examples
    --------
    >>> import clothsim as cs
    >>> scene = cs.scenes.oscillator(stiffness=100.0, mass=2.0, amplitude=0.1)
    >>> a = cs.acceleration(scene, scene.initial_position, scene.initial_velocity)
    >>> round(float(a[0, 1, 0]), 12)
    -5.0
    """
    state = State(
        scene, x, v, t=t, integrator="rk4", precision=precision, threads=threads, kernel=kernel,
        strict=strict,
    )
    like = np.empty(state.shape)
    if out is None:
        out = like
    else:
        out_array("out", out, like)
    state.core.accelerations(out, state.threads)
    return out


@dataclass(frozen=True)
class Snapshot:
    """A `Stepper` at one moment, to be continued bit for bit with `Stepper.restore`.

    It pickles, and holds the scene, the options, the clock and the whole state of the core,
    compensation included.
    """

    arguments: dict[str, Any]
    shape: tuple[int, ...]
    dtype: str
    core: tuple[Any, ...]


@suggesting
class Stepper:
    """A scene whose state stays in the core between calls.

    Parameters
    ----------
    scene : Scene or sequence of Scene
        A sequence of B scenes of one shape is a batch of B states.
    x, v : array_like, optional
        Initial positions [m] and velocities [m/s], shape (rows, columns, 3) or
        (B, rows, columns, 3). Default: the scene's own.
    t : float, default 0.0
        Time of that state [s].
    integrator, precision, threads, kernel, strict, backend
        As for `step`. With the backend "gpu" the state stays on the adapter.
    track_contact_energy : bool, default False
        True counts the energy that the collision passes add (`contact_energy`). The passes are
        then done by one thread. Not with the backend "gpu".

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.

    Examples
    --------
    >>> import clothsim as cs
    >>> stepper = cs.Stepper(cs.scenes.paper_static())
    >>> stepper.advance(1000, 5e-6)
    >>> round(stepper.time, 12)
    0.005
    >>> stepper.positions.shape
    (32, 32, 3)
    """

    _announces = True  # gives warnings of the order and of long runs

    def __init__(
        self,
        scene: Scene | Sequence[Scene],
        x: npt.ArrayLike | None = None,
        v: npt.ArrayLike | None = None,
        *,
        t: float = 0.0,
        integrator: str = "rk4",
        precision: str = "double",
        threads: int | None = None,
        kernel: str = "auto",
        strict: bool = False,
        backend: str = "cpu",
        track_contact_energy: bool = False,
    ) -> None:
        self._options: dict[str, Any] = {
            "integrator": integrator, "precision": precision, "threads": threads,
            "kernel": kernel, "strict": strict, "backend": backend,
        }
        self._scene = scene
        self._track = check.boolean("track_contact_energy", track_contact_energy)
        self._state = State(scene, x, v, t=t, **self._options)
        if self._announces:
            self._state.warn_of_order()
        else:
            self._state.announced = True
        self._state.core.set_track_contact_energy(self._track)

    def advance(self, steps: int, dt: float) -> None:
        """Advance by `steps` time steps of `dt`.

        Parameters
        ----------
        steps : int
            Number of steps, >= 0.
        dt : float
            Time step [s], > 0.

        Raises
        ------
        ValueError, TypeError
            If an argument is not as above.
        UnstableError
            If the state stops being finite; if, until a sphere responds, nine tenths of the kinetic
            and elastic energy come out of nothing; or, with a time step above `max_stable_dt`, if
            a point crosses the whole sheet within a step. It is found within 128 steps, and the
            stepper then stands right before the step that went wrong: every member of a batch at
            that same step, with the bits it has when it runs alone. `freeze` lets the others go on.
        KeyboardInterrupt
            On Ctrl-C. The stepper then stands at a whole step; `time` tells which.
        RuntimeError
            If another thread is advancing this stepper.
        clothsim.gpu.AdapterLostError
            If the graphics adapter stops answering. The stepper then stands at the last state that
            was copied back, at most about a second of work ago.

        Warns
        -----
        StabilityWarning
            Once in the life of a stepper, if `dt` is above `max_stable_dt`; and once if more than
            half of the kinetic and elastic energy comes out of nothing (docs/stability.md).
        """
        self._state.advance(steps, dt)

    def freeze(self, member: int) -> None:
        """Take a member of the batch out of all further steps; it keeps the state it has.

        So a batch can go on without a member that became unstable: `UnstableError.member`.

        Parameters
        ----------
        member : int
            Index into the batch, >= 0.

        Raises
        ------
        ValueError, TypeError
            If there is no such member.

        Examples
        --------
        >>> import clothsim as cs
        >>> scenes = [cs.scenes.oscillator(stiffness=k) for k in (1.0, 1e6)]
        >>> stepper = cs.Stepper(scenes)
        >>> import warnings; warnings.simplefilter("ignore", cs.StabilityWarning)
        >>> try:
        ...     stepper.advance(1000, 0.01)
        ... except cs.UnstableError as error:
        ...     stepper.freeze(error.member)
        ...     stepper.advance(1001 - error.step, 0.01)
        >>> round(stepper.time, 12), stepper.frozen.tolist()
        (10.0, [False, True])
        """
        members = len(self._state.scenes)
        self._state.core.set_frozen(
            check.integer("member", member, minimum=0, maximum=members - 1), True
        )

    @property
    def frozen(self) -> npt.NDArray[np.bool_]:
        """Which members take no part in further steps, shape (B,); see `freeze`."""
        return np.array(self._state.core.frozen)

    def _arrays(self) -> tuple[FloatArray, FloatArray]:
        x, v = np.empty(self._state.shape, self._state.dtype), np.empty(self._state.shape, self._state.dtype)
        self._state.store(x, v)
        return x, v

    @property
    def positions(self) -> FloatArray:
        """Positions [m], a copy, of the shape and dtype that the state was given in."""
        x = np.empty(self._state.shape, self._state.dtype)
        self._state.store(x, None)
        return x

    @property
    def velocities(self) -> FloatArray:
        """Velocities [m/s], a copy, of the shape and dtype that the state was given in."""
        v = np.empty(self._state.shape, self._state.dtype)
        self._state.store(None, v)
        return v

    @property
    def time(self) -> float:
        """Time of the state [s]."""
        return float(self._state.core.time)

    @property
    def threads(self) -> int:
        """Threads used; 1 with the backend "gpu"."""
        return self._state.threads

    @property
    def kernel(self) -> str:
        """Kernel used, "gather" or "edge"."""
        return self._state.kernel

    @property
    def instruction_set(self) -> str:
        """Instruction set of the kernels used, or the graphics adapter."""
        return str(self._state.instruction_set)

    @property
    def backend(self) -> str:
        """Backend used, "cpu" or "gpu"."""
        return self._state.backend

    @property
    def contact_energy(self) -> float | npt.NDArray[np.float64]:
        """Energy that the collision passes have added so far [J]; per member for a batch.

        It is the sum of the changes of kinetic, elastic and gravity energy at every mass point
        that a response moved or turned; 0 for an elastic, frictionless contact in exact arithmetic
        at the exact moment of impact, so what it shows is made or lost by the method.

        Raises
        ------
        RuntimeError
            If the stepper was made without ``track_contact_energy=True``.
        """
        if not self._track:
            raise RuntimeError("contact_energy is counted by Stepper(..., track_contact_energy=True)")
        energy = self._state.core.contact_energy
        return np.array(energy) if self._state.batched else float(energy[0])

    def snapshot(self) -> Snapshot:
        """The whole state, to be continued bit for bit by `restore`.

        Returns
        -------
        Snapshot
        """
        arguments = {
            **self._options, "scene": self._scene, "track_contact_energy": self._track,
            "frozen": self.frozen.nonzero()[0].tolist(),
        }  # fmt: skip
        state = self._state
        return Snapshot(arguments, state.shape, state.dtype.str, state.core.snapshot())

    @classmethod
    def restore(cls, snapshot: Snapshot) -> Stepper:
        """A new stepper that stands where `snapshot` was taken and continues with the same bits.

        Parameters
        ----------
        snapshot : Snapshot
            From `snapshot`, in this process or unpickled in another.

        Returns
        -------
        Stepper

        Raises
        ------
        TypeError
            If `snapshot` is no Snapshot.

        Examples
        --------
        >>> import clothsim as cs
        >>> one = cs.Stepper(cs.scenes.paper_swing(), precision="single")
        >>> one.advance(10, 1e-4)
        >>> other = cs.Stepper.restore(one.snapshot())
        >>> one.advance(10, 1e-4); other.advance(10, 1e-4)
        >>> bool((one.positions == other.positions).all())
        True
        """
        if not isinstance(snapshot, Snapshot):
            raise TypeError(f"snapshot must be a Snapshot, got {type(snapshot).__name__}")
        origin, steps, dt, members = snapshot.core
        scene = snapshot.arguments["scene"]
        zeros = np.zeros(snapshot.shape, snapshot.dtype)
        kept = ("scene", "frozen")
        arguments = {name: value for name, value in snapshot.arguments.items() if name not in kept}
        stepper = cls(scene, zeros, zeros, **arguments)
        stepper._state.core.restore(origin, steps, dt, members)
        for member in snapshot.arguments["frozen"]:
            stepper.freeze(member)
        return stepper


class SilentStepper(Stepper):
    """A stepper of the package's own, whose caller announces long runs and lower orders itself."""

    _announces = False


@suggests
def reference_step(
    scene: Scene,
    x: npt.ArrayLike,
    v: npt.ArrayLike,
    dt: float,
    steps: int = 1,
    t: float = 0.0,
    *,
    as_printed: bool = False,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """What `step` does, by the scalar oracle: spring by spring, in double, not optimised.

    The code (cpp/reference) is written to be read beside the paper; the kernels are tested
    against it.

    Parameters
    ----------
    scene : Scene
        One scene.
    x, v : array_like
        Positions [m] and velocities [m/s], shape (rows, columns, 3).
    dt, steps, t
        As for `step`.
    as_printed : bool, default False
        True: eq 2-6 of Kim et al. as printed, with the time step in the slopes and in the sum.
        That form is not consistent: its error does not go to 0 with the time step.

    Returns
    -------
    x, v : numpy.ndarray
        The new state, float64. May be non-finite: nothing is checked here.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.

    Examples
    --------
    >>> import clothsim as cs
    >>> scene = cs.scenes.paper_static()
    >>> state = scene.initial_position, scene.initial_velocity
    >>> x, v = cs.step(scene, *state, 1e-4, steps=10)
    >>> reference = cs.reference_step(scene, *state, 1e-4, steps=10)
    >>> float(abs(x - reference[0]).max()) < 1e-14
    True
    """
    from . import _core
    from .plan import core_plan

    if not isinstance(scene, Scene):
        raise TypeError(f"scene must be a Scene, got {type(scene).__name__}")
    x, v = state_arrays(x, v, [scene], False)
    if x.ndim != 3:
        raise ValueError(f"x must be one state of shape {(*scene.cloth.shape, 3)}, got {x.shape}")
    as_printed = check.boolean("as_printed", as_printed)
    advance = _core.reference_step_as_printed if as_printed else _core.reference_step
    return advance(
        core_plan(scene),
        x.astype(np.float64),
        v.astype(np.float64),
        check.number("dt", dt, minimum=0, exclusive=True),
        check.integer("steps", steps, minimum=0, maximum=check.INT64_MAX),
        check.number("t", t),
    )
