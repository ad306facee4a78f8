"""Measures of a state: energy, penetration depth, and the stable time step of a scene."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from . import _core
from . import _validate as check
from ._state import max_stable_dt_of, state_arrays
from .plan import INTEGRATORS, core_cloth
from .scene import Scene
from .sphere import Sphere

Value = float | npt.NDArray[np.float64]


def _one_scene(scene: Scene) -> Scene:
    if not isinstance(scene, Scene):
        raise TypeError(f"scene must be a Scene, got {scene!r} ({type(scene).__name__})")
    return scene


def energy(scene: Scene, x: npt.ArrayLike, v: npt.ArrayLike) -> dict[str, Value]:
    """Kinetic, elastic and gravity energy, and their total.

    ::

        kinetic = sum m v^2 / 2,   elastic = sum K (l - L)^2 / 2,   gravity = - sum m g . x

    Parameters
    ----------
    scene : Scene
        Gives masses, springs and gravity.
    x, v : array_like
        Positions [m] and velocities [m/s], shape (rows, columns, 3) or (B, rows, columns, 3).

    Returns
    -------
    dict
        "kinetic", "elastic", "gravity" and "total" [J], floats, or arrays of shape (B,) for a
        batch. Gravity energy is 0 at the origin.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.

    Examples
    --------
    >>> import clothsim as cs
    >>> scene = cs.scenes.oscillator(stiffness=100.0, amplitude=0.1)
    >>> round(cs.energy(scene, scene.initial_position, scene.initial_velocity)["total"], 12)
    0.5
    """
    x, v = state_arrays(x, v, [_one_scene(scene)], False)
    x, v = x.astype(np.float64), v.astype(np.float64)
    cloth = core_cloth(scene)
    batch = (x, v) if x.ndim == 4 else (x[None], v[None])
    parts = np.array([_core.energy(cloth, scene.gravity, *one) for one in zip(*batch)])
    values = dict(zip(("kinetic", "elastic", "gravity"), parts.T))
    values["total"] = parts.sum(axis=1)
    return values if x.ndim == 4 else {name: float(value[0]) for name, value in values.items()}


def penetration(x: npt.ArrayLike, sphere: Sphere, t: float = 0.0) -> dict[str, Value]:
    """How deep the cloth is inside a sphere: its deepest mass point and its deepest triangle.

    The depth is that below the sphere's true radius, without the offset. A triangle's depth is
    exact: that of its point closest to the centre. The triangles are those of `triangles`.

    Parameters
    ----------
    x : array_like
        Positions [m], shape (rows, columns, 3) or (B, rows, columns, 3).
    sphere : Sphere
        The sphere, at its place at time `t`.
    t : float, default 0.0
        Time [s].

    Returns
    -------
    dict
        "points" and "triangles": depths [m], >= 0, floats, or arrays of shape (B,) for a batch.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.

    Examples
    --------
    The corners of a level square just touch a sphere; its middle dips in:

    >>> import clothsim as cs
    >>> sphere = cs.Sphere(center=(0.5, -1.0, 0.5), radius=1.5 ** 0.5)
    >>> depth = cs.penetration(cs.Cloth(shape=(2, 2)).rest_positions, sphere)
    >>> depth["points"], round(depth["triangles"], 6)
    (0.0, 0.224745)
    """
    if not isinstance(sphere, Sphere):
        raise TypeError(f"sphere must be a Sphere, got {sphere!r} ({type(sphere).__name__})")
    x = np.asarray(x)
    accepted = "an array of shape (rows, columns, 3) or (B, rows, columns, 3) of finite numbers"
    if x.dtype.kind not in "iuf":
        raise TypeError(f"x must be {accepted}, got dtype {x.dtype}")
    if x.ndim not in (3, 4) or x.shape[-1] != 3 or 0 in x.shape:
        raise ValueError(f"x must be {accepted}, got shape {x.shape}")
    x = np.ascontiguousarray(x, dtype=np.float64)
    check.check_all("x", x, np.isfinite(x), accepted)
    rows, columns = x.shape[-3:-1]
    center = sphere.center_at(check.number("t", t))
    depths = np.array(
        [_core.penetration(rows, columns, one, center, sphere.radius) for one in x.reshape(-1, rows, columns, 3)]
    )
    values = dict(zip(("points", "triangles"), depths.T))
    return values if x.ndim == 4 else {name: float(value[0]) for name, value in values.items()}


def max_stable_dt(scene: Scene, integrator: str = "rk4") -> float:
    """A time step that is stable for this scene in any state: a guarantee, not an estimate.

    With lambda and delta bounds on the eigenvalues of the stiffness and of the damping per unit
    mass, RK4 needs dt < min(2.6155 / sqrt(lambda), 2.785 / delta), 2.828 in place of 2.6155 where
    nothing is damped. On a uniform grid lambda = kappa K / m with kappa = 8 for structural
    springs, 12 with shear, 16.33 with bend; different stiffnesses are bounded in the same way (the
    maximum of the grid's Fourier symbol). With mass per point the lightest point counts.

    Parameters
    ----------
    scene : Scene
    integrator : {"rk4"}, default "rk4"

    Returns
    -------
    float
        Time step [s]; infinite for a scene without springs and damping.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.

    Examples
    --------
    >>> import clothsim as cs
    >>> f"{cs.max_stable_dt(cs.scenes.paper_swing(bend=True)):.3e}"
    '8.526e-04'
    """
    check.choice("integrator", integrator, INTEGRATORS)
    return max_stable_dt_of(_one_scene(scene), integrator)
