"""The largest stable time step: guaranteed for a scene, or of the forces linearised at a state."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base import check
from ..engine.arrays import state_array, state_arrays
from ..methods.bound import stable_dt
from ..methods.data import integrator_name
from ..model.scene import Scene
from ..typing import Integrator
from .spectrum import stable_dt_at


def max_stable_dt(
    scene: Scene, integrator: Integrator = "rk4", x: npt.ArrayLike | None = None, v: npt.ArrayLike | None = None
) -> float:
    """The largest stable time step: guaranteed for all states except extreme states, or at a given state.

    A mode of the cloth has a frequency omega and a damping rate delta: x'' = -omega^2 x - delta x'.
    A mode does not grow if the integrator's amplification matrix of (omega dt, delta dt) has no eigenvalue above 1 in
    size. RK4 allows omega dt <= 2.8284 without damping, 2.6155 for any damping, and delta dt <= 2.7853 without a
    spring.

    Without a state, omega^2 <= lambda and a largest delta bound all modes (docs/stability.md). A
    uniform grid has lambda = kappa K / m, with kappa = 8 for structural springs, 12 with shear, and
    16.33 with bend. Kappa is the maximum of the grid's Fourier symbol. The symbol also bounds families of different
    stiffness. The symbol of the damping bounds delta. With mass per point, and in narrow cloths, lambda is at most the
    maximum over the points i of sum_j K_ij (1/m_i + 1/m_j). A pinned point has 1/m = 0. The step is stable for every
    pair up to these bounds.

    The guarantee holds where no spring is shorter than half its rest length. With spring damping, c w/l must also be at
    most K, where w is the relative speed of a spring's ends and l its length. In other states a mode may be faster than
    lambda allows, and a run at this step may be unstable. Compressed springs buckle at any step, because their modes
    grow in the exact solution too.

    With a state, the step is computed from the forces linearised at that state. For Runge-Kutta methods, the modes of
    the equation determine it. For splittings, such as "velocity_verlet", the eigenvalues of the step
    matrix determine it, because the step mixes modes where stiffness and damping do not commute. Both are found by
    projection on a space that grows until the limit no longer changes. The value is 3 % below that limit. A moving
    cloth has other modes: in the paper's swing the limit falls to 11 % below its value at rest.

    Parameters
    ----------
    scene : Scene
    integrator : str, default "rk4"
        A name of `integrators`.
    x : array_like, optional
        Positions [m], shape (rows, columns, 3).
    v : array_like, optional
        With `x`: velocities [m/s], same shape. Default: at rest.

    Returns
    -------
    float
        Time step [s]; infinite where nothing limits it, 0 where every time step amplifies some motion, as
        "explicit_euler" does with motion that nothing damps.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above. Also if a spring of the state is shorter than 1e-12 of its rest length, but not
        of length 0. The message names the spring's ends.

    Examples
    --------
    >>> import clothsim as cs
    >>> scene = cs.scenes.paper_swing(bend=True)
    >>> f"{cs.max_stable_dt(scene):.3e}"
    '8.526e-04'
    >>> f"{cs.max_stable_dt(scene, x=scene.initial_position):.2e}"
    '1.73e-03'
    """
    integrator = integrator_name(integrator)
    if x is None:
        if v is not None:
            raise ValueError("v must be None without x, got velocities alone")
        return stable_dt(check.instance("scene", scene, Scene), integrator)
    x = state_array("x", x, [check.instance("scene", scene, Scene)], False)
    x, v = state_arrays(x, np.zeros(x.shape) if v is None else v, [scene], False)
    if x.ndim != 3:
        raise ValueError(f"x must be one state of shape {(*scene.cloth.shape, 3)}, got {x.shape}")
    return stable_dt_at(integrator, scene, x.astype(np.float64), v.astype(np.float64))
