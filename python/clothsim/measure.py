"""Measures of a state: energy, penetration depth, and the stable time step of a scene."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from . import _core
from .base import check
from .engine.options import Options, cached_plan
from .engine.state import check_state_arrays, list_scenes
from .model.obstacle import Plane, Sphere
from .model.scene import Scene, core_sphere

Value = float | npt.NDArray[np.float64]


@check.check_names
def energy(
    scene: Scene | Sequence[Scene], x: npt.ArrayLike, v: npt.ArrayLike, t: float | None = None
) -> dict[str, Value]:
    """Return the energies of a state, and their total.

    ::

        kinetic = sum m v^2 / 2,   elastic = sum K (l - L)^2 / 2,   gravity = - sum m g . x,
        force = - sum F . x,   contact = sum k d^4 / (4 h^2)

    Parameters
    ----------
    scene : Scene or sequence of Scene
        Its masses, springs, gravity and force are used, and its obstacles of response "penalty",
        with d the depth of a free point in their layer. Of a sequence, each for its member of the
        batch.
    x, v : array_like
        Positions [m] and velocities [m/s], shape (rows, columns, 3) or (B, rows, columns, 3).
    t : float, optional
        Time of the state [s]. Required where an obstacle of response "penalty" moves.

    Returns
    -------
    dict
        "kinetic", "elastic", "gravity", "force", "contact" and "total" [J], floats, or arrays of
        shape (B,) for a batch. The energies of gravity and force are 0 at the origin.

    Examples
    --------
    >>> scene = cs.scenes.oscillator(stiffness=100.0, amplitude=0.1)
    >>> round(cs.energy(scene, scene.initial_position, scene.initial_velocity)["total"], 12)
    0.5
    """
    scenes = list_scenes(scene)
    x, v = check_state_arrays(x, v, scenes, not isinstance(scene, Scene))
    single = x.ndim == 3
    xs = x.astype(np.float64).reshape(-1, *x.shape[-3:])
    vs = v.astype(np.float64).reshape(-1, *v.shape[-3:])
    if len(scenes) == 1:
        scenes = scenes * len(xs)
    obstacles = [obstacle for member in scenes for obstacle in member.spheres]
    if t is None and any(o.response == "penalty" and o.motion is not None for o in obstacles):
        raise ValueError("t must be given, as an obstacle moves: give the time of x in seconds")
    time = 0.0 if t is None else check.number("t", t)
    plans = [cached_plan(member, Options()) for member in scenes]
    parts = np.array([_core.energy(plan, x, v, time) for plan, x, v in zip(plans, xs, vs)])
    values = dict(zip(("kinetic", "elastic", "gravity", "force", "contact"), parts.T))
    values["total"] = parts.sum(axis=1)
    return {name: float(value[0]) for name, value in values.items()} if single else values


@check.check_names
def penetration(
    x: npt.ArrayLike, sphere: Sphere | Plane, t: npt.ArrayLike | None = None
) -> dict[str, Value]:
    """Measure how deep the cloth is inside a sphere: its deepest mass point and deepest triangle.

    Depths count from the sphere's true radius, without the offset. The depth of a triangle is
    exact: it is the depth of the triangle's place nearest to the centre. The triangles are those of
    `triangles`. In a chain (one row or column) its links count.

    Parameters
    ----------
    x : array_like
        Positions [m], shape (rows, columns, 3) or (B, rows, columns, 3).
    sphere : Sphere or Plane
        At its place at time `t`.
    t : float or array_like, optional
        Time of `x` [s], or of each member of a batch, shape (B,): ``penetration(run.x, sphere,
        run.t)``. Required where the sphere moves; else it has no effect.

    Returns
    -------
    dict
        "points" and "triangles": depths [m], >= 0; floats, or arrays of shape (B,) for a batch.

    Examples
    --------
    >>> sphere = cs.Sphere(center=(0.5, -1.0, 0.5), radius=1.5 ** 0.5)
    >>> corners = cs.Cloth(shape=(2, 2)).rest_positions  # just touch
    >>> cs.penetration(corners, sphere)["points"]
    0.0
    """
    if not isinstance(sphere, (Sphere, Plane)):
        raise TypeError(f"sphere must be a Sphere or a Plane, got {check.value_text(sphere)}")
    accepted = "an array of shape (rows, columns, 3) or (B, rows, columns, 3) of finite numbers"
    x = check.as_array("x", x, accepted)
    if x.ndim not in (3, 4) or x.shape[-1] != 3 or 0 in x.shape:
        raise ValueError(f"x must be {accepted}, got shape {x.shape}")
    x = np.ascontiguousarray(x, dtype=np.float64)
    check.check_all("x", x, np.isfinite(x), accepted, points=True)
    rows, columns = x.shape[-3:-1]
    batch = x.reshape(-1, rows, columns, 3)
    times = np.broadcast_to(np.asarray(_check_times(t, sphere, x.shape[:-3]), float), len(batch))
    core = core_sphere(sphere)
    depths = np.array(
        [_core.penetration(rows, columns, state, core, time) for state, time in zip(batch, times)]
    )
    values = dict(zip(("points", "triangles"), depths.T))
    return values if x.ndim == 4 else {name: float(value[0]) for name, value in values.items()}


def _check_times(
    t: npt.ArrayLike | None, sphere: Sphere | Plane, batch: tuple[int, ...]
) -> npt.ArrayLike:
    """Check `t`: a time, or a time per member of a batch of this shape, () or (B,)."""
    if t is None:
        if sphere.motion is not None:
            raise ValueError(
                "t must be given, as the sphere moves: give the time of x in seconds, or one time "
                "per member of a batch, such as penetration(run.x, sphere, run.t)"
            )
        return 0.0
    if check.real_or_none(t) is not None:
        return check.number("t", t)
    return check.array("t", t, batch, "finite times, one per member of x, or one for all")


@check.check_names
def largest_stretch(scene: Scene, x: npt.ArrayLike) -> Value:
    """Measure the stretch of the most stretched spring, l / L - 1 with l its length and L its rest
    length.

    Parameters
    ----------
    scene : Scene
        Its springs and their rest lengths are used.
    x : array_like
        Positions [m], shape (rows, columns, 3) or (B, rows, columns, 3).

    Returns
    -------
    float or numpy.ndarray
        Negative where every spring is compressed, 0 for a scene without springs. Of shape (B,) for
        a batch.

    Examples
    --------
    >>> scene = cs.scenes.paper_swing()
    >>> round(cs.largest_stretch(scene, 1.1 * scene.initial_position), 12)
    0.1
    """
    cloth = check.instance("scene", scene, Scene).cloth.core
    x, _ = check_state_arrays(x, x, [scene], False)
    if not scene.cloth.spring_count():
        return np.zeros(len(x)) if x.ndim == 4 else 0.0
    batch = np.reshape(x.astype(np.float64), (-1, *x.shape[-3:]))
    values = np.array([_core.largest_stretch(cloth, state) for state in batch])
    return values if x.ndim == 4 else float(values[0])
