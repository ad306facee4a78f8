"""The trusted solution: two independent computations, and their difference as its error bound."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _core
from ..base import Floats, check, frozen
from ..base.build import available_threads
from ..base.clocks import Stopwatch
from ..engine.options import Options
from ..engine.stepper import Stepper
from ..methods.bound import stable_dt
from ..model.as_core import core_pins
from ..model.scene import Scene
from .in_double import solve_in_double

# Of the time in which the cloth's size is crossed: how far apart the looks are at most.
_MOST_BETWEEN = 1e-4  # s


def first_contact(scene: Scene, duration: float) -> tuple[float, int] | None:
    """Earliest time at which a mass point comes as close to a sphere as its contact radius [s], and the sphere's index.

    None without contact up to `duration`. The cloth moves freely, by RK4. Between two samples a point counts as near as its
    speed relative to the sphere allows. So no contact is missed, and a near miss within that distance counts as a contact.
    """
    if not scene.spheres:
        return None
    free = ~scene.cloth.pinned
    stepper = Stepper(scene.replace(spheres=()), threads=1)
    between = min(_MOST_BETWEEN, 0.5 * stable_dt(scene), duration)
    count = math.ceil(duration / between)
    dt = duration / count
    for n in range(count + 1):
        t = n * dt
        x, v = stepper.positions[free], stepper.velocities[free]
        for k, sphere in enumerate(scene.spheres):
            height = sphere.height(x, t)
            speed = np.linalg.norm(v - sphere.velocity_at(t), axis=-1)
            if (height < sphere.offset_length(scene.cloth) + speed * dt).any():
                return t, k
        if n < count:
            stepper.advance(1, dt)
    return None


# The extrapolation that is returned, and the looser one of other order that it is compared with.
# The tolerances are per step and of the cloth's extent; long double has 5e-20.
_TRUSTED: dict[str, Any] = {"columns": 8, "tolerance": 1e-15}
_CONTROL: dict[str, Any] = {"columns": 7, "tolerance": 1e-14}

METHODS = ("extrapolation (GBS), order 16, long double", "dop853, order 8, double")


@dataclass(frozen=True, eq=False, repr=False)
class Reference:
    """A trusted solution, the result of `reference`.

    Attributes
    ----------
    scene : Scene
    t : numpy.ndarray
        Times of the frames [s], shape (frames,); the first is 0, the last the duration.
    x, v : numpy.ndarray
        Positions [m] and velocities [m/s] of the extrapolation in long double, rounded to float64,
        shape (frames, rows, columns, 3), read-only.
    error_bound : dict
        "max" and "rms" [m], each of shape (frames,): distance of the mass points from the second
        method, plus half a unit in the last place. Most of it is rounding of double, amplified by
        the cloth.
    error_estimate : dict
        The likely error of `x`, with the same keys: the distance to a looser extrapolation of another order, in long
        double.
    report : dict
        "methods", "force_evaluations" (of each method) and "wall_time" [s] of the computation.

    Examples
    --------
    >>> import clothsim as cs
    >>> cs.reference(cs.scenes.oscillator(), 1.0).x.shape
    (2, 1, 2, 3)
    """

    scene: Scene
    t: Floats
    x: Floats
    v: Floats
    error_bound: dict[str, Floats]
    error_estimate: dict[str, Floats]
    report: dict[str, Any]

    def __repr__(self) -> str:
        rows, columns = self.scene.cloth.shape
        return (
            f"<Reference of {rows} x {columns} points: {len(self.t)} frames to {self.t[-1]:g} s, "
            f"error bound {float(np.max(self.error_bound['max'])):.1e} m>"
        )

    def error_of(self, x: npt.ArrayLike, frame: int = -1) -> dict[str, float]:
        """Distance of positions from this solution.

        Parameters
        ----------
        x : array_like
            Positions [m], shape (rows, columns, 3).
        frame : int, default -1
            Index of the frame to compare with.

        Returns
        -------
        dict
            "max" and "rms" [m] over the mass points of the distance to the reference; NaN if `x`
            is not finite.

        Raises
        ------
        ValueError
            For another shape.

        Examples
        --------
        >>> import clothsim as cs
        >>> solution = cs.reference(cs.scenes.oscillator(), 0.1)
        >>> solution.error_of(solution.x[-1])
        {'max': 0.0, 'rms': 0.0}
        """
        accepted = f"an array of shape {self.x.shape[1:]}"
        x = check.as_array("x", x, accepted)
        if x.shape != self.x.shape[1:]:
            raise ValueError(f"x must be {accepted}, got {x.shape}")
        x = x.astype(np.float64)
        count = len(self.t)
        frame = check.integer("frame", frame, minimum=-count, maximum=count - 1)
        largest, rms = _distances(x, self.x[frame])
        return {"max": float(largest), "rms": float(rms)}


def reference(scene: Scene, duration: float, every: float | None = None, *, threads: int | None = None) -> Reference:
    """A trusted solution of a scene without contact, with its own error bound.

    Two methods compute it, and their difference is the error bound. Gragg-Bulirsch-Stoer
    extrapolation of order 16 in long double is returned (Hairer, Norsett, Wanner, Solving Ordinary
    Differential Equations I, section II.9). It takes the rows of `Cloth.spring_table` and shares no
    code with the kernels. The Dormand-Prince method of order 8 in double uses the kernels. Its
    steps are halved until only rounding changes the result.

    The last 32 solutions are kept in memory.

    Parameters
    ----------
    scene : Scene
        Its spheres must stay out of the cloth's reach.
    duration : float
        Simulated time [s], > 0.
    every : float, optional
        Seconds between frames. Default: only the first and the last state.
    threads : int, optional
        Threads used, 1 to 256; the solution does not depend on it. Default: all available threads.

    Returns
    -------
    Reference

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above, or if a mass point comes within a sphere's contact radius
        before `duration`. A trajectory after contact is chaotic: perturbations grow a hundred
        thousand times within a sixth of a second. No arithmetic then determines where a point is.
        Compare outcomes there (`penetration`, `energy`, the centre of mass).
    ArithmeticError
        If the extrapolation cannot continue, because points coincide or the state grows beyond bounds.
    KeyboardInterrupt
        On Ctrl-C.

    Examples
    --------
    >>> import math
    >>> import clothsim as cs
    >>> scene = cs.scenes.oscillator(stiffness=100.0, mass=1.0, amplitude=0.1)
    >>> solution = cs.reference(scene, 2.0, every=1.0)
    >>> exact = 1.0 + 0.1 * math.cos(10.0 * 2.0)
    >>> abs(float(solution.x[-1, 0, 1, 0]) - exact) < 3e-16
    True
    >>> bool(solution.error_bound["max"][-1] < 1e-12)
    True
    """
    check.instance("scene", scene, Scene)
    duration = check.number("duration", duration, minimum=0, exclusive=True)
    if every is not None:
        every = check.number("every", every, minimum=0, exclusive=True)
        check.frame_count("every", every, duration / every)
    threads = Options(threads=threads).threads or available_threads()
    return _assemble(scene, _compute(scene, _times(duration, every), threads))


def _times(duration: float, every: float | None) -> tuple[float, ...]:
    """Times of the frames after 0: each multiple of `every` before the end, and the end."""
    count = 1 if every is None else math.ceil(duration / every - 1e-9)
    return *(k * (every or 0.0) for k in range(1, count)), duration


@lru_cache(maxsize=32)
def _compute(scene: Scene, times: tuple[float, ...], threads: int) -> dict[str, np.ndarray]:
    contact = first_contact(scene, times[-1])
    if contact is not None:
        t, k = contact
        raise ValueError(
            f"duration must end before the cloth meets a sphere: it comes within the contact "
            f"radius of spheres[{k}] at about {t:.4g} s, got {times[-1]:g} s. After contact "
            "trajectories are chaotic and there is no reference; compare outcomes (penetration, "
            "energy, centre of mass) instead"
        )
    scene = scene.replace(spheres=())
    with Stopwatch() as watch:
        # Steps end where pieces of the pins' motions end, so that both methods keep their orders.
        every_time = sorted({*times, *scene.stops(0.0, times[-1])})
        frames = np.searchsorted(every_time, times)
        x, v, evaluations = extrapolation(scene, every_time, **_TRUSTED, threads=threads)
        control, _, more = extrapolation(scene, every_time, **_CONTROL, threads=threads)
        double = solve_in_double(scene, every_time, threads)
        x, v, control = x[frames], v[frames], control[frames]
    initial = scene.initial_position, scene.initial_velocity
    # The solution is rounded to float64: half a unit in the last place, but for the state given.
    rounding = np.spacing(np.abs(x).max()) / 2 * (np.arange(len(times) + 1) > 0)
    arrays = {
        "t": np.array([0.0, *times]),
        "x": np.concatenate([initial[0][None], x]),
        "v": np.concatenate([initial[1][None], v]),
        "bound": _per_frame(x, double.x[frames]) + rounding,
        "estimate": _per_frame(x, control),
        "force_evaluations": np.array([evaluations + more, double.force_evaluations]),
        "wall_time": np.array(watch.seconds),
    }
    return {name: frozen(array) for name, array in arrays.items()}


def _assemble(scene: Scene, arrays: dict[str, np.ndarray]) -> Reference:
    frames = arrays["t"], arrays["x"], arrays["v"]
    bound, estimate = (dict(zip(("max", "rms"), arrays[name], strict=True)) for name in ("bound", "estimate"))
    report = {
        "methods": METHODS,
        "force_evaluations": dict(zip(METHODS, map(int, arrays["force_evaluations"]), strict=True)),
        "wall_time": float(arrays["wall_time"]),
    }
    return Reference(scene, *frames, bound, estimate, report)


def extrapolation(
    scene: Scene, times: list[float], *, columns: int, tolerance: float, threads: int
) -> tuple[Floats, Floats, int]:
    """States at `times` by extrapolation in long double, and the number of force evaluations."""
    cloth = scene.cloth
    table = cloth.spring_table()
    fields = ("i", "j", "rest_length", "stiffness", "damping")
    springs: dict[str, Any] = {name: np.ascontiguousarray(table[name]) for name in fields}
    result = _core.extrapolate(
        **springs,
        mass=np.ascontiguousarray(cloth.mass_per_point),
        pinned=np.ascontiguousarray(cloth.pinned),
        gravity=scene.gravity,
        drag=cloth.drag,
        force=np.zeros_like(cloth.rest_positions) if scene.force is None else scene.force,
        **core_pins(scene),
        x=np.ascontiguousarray(scene.initial_position),
        v=np.ascontiguousarray(scene.initial_velocity),
        times=times,
        columns=columns,
        tolerance=tolerance,
        threads=threads,
    )
    if not result["reached"]:
        raise ArithmeticError(
            f"no reference: the extrapolation came to t = {result['time']:g} s, where its step fell "
            "below 1e-9 of the duration; the forces are not smooth there (points that coincide?) "
            "or something grows beyond bounds"
        )
    shape = (len(times), *cloth.shape, 3)
    return result["x"].reshape(shape), result["v"].reshape(shape), result["force_evaluations"]


def _distances(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Largest and root mean square distance of the mass points, of one frame or of each."""
    distance = np.linalg.norm(a - b, axis=-1)
    return distance.max(axis=(-2, -1)), np.sqrt((distance**2).mean(axis=(-2, -1)))


def _per_frame(a: Floats, b: Floats) -> Floats:
    """(max, rms) of each frame, with that of the initial state, 0, first."""
    return np.array([np.concatenate([[0.0], one]) for one in _distances(a, b)])
