"""clothsim's default call, and solvers of other packages on the same scene: numba, SciPy, diffrax.

- "simulate": clothsim's own `cs.simulate(scene, duration, rtol=...)`, as a user calls it.
- "rk4 (numba)": the kernel of `python benchmarks/bench.py`, written for LLVM's vectoriser.
- "DOP853 (SciPy)", "RK45 (SciPy)": `scipy.integrate.solve_ivp` over that kernel's forces.
- "Tsit5 (diffrax)", "Dopri8 (diffrax)": JAX on the processor, in double, compiled as a whole.

The others take uniform mass, spring damping and no spheres. Compilation ends before the clock
starts.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from typing import Any

import clothsim as cs
import numpy as np
from clothsim.accuracy import Method
from clothsim.typing import Precision
from common import Stopwatch
from timing import measure

from .numba_peer import NumbaPeer, NumbaSlopes, set_threads
from .numpy_peer import spring_ends, spring_kinds


def default_call(threads: int | None = None) -> Method:
    """Return the call that a user of clothsim writes first, with the estimate of its error."""

    def solve(scene: cs.Scene, duration: float, rtol: float) -> Any:
        with Stopwatch() as watch:
            run = cs.simulate(scene, duration, rtol=rtol, threads=threads)
        return run.x[-1], run.v[-1], run.report["force_evaluations"], watch.seconds

    return Method("simulate", solve, "rtol", "clothsim", "double", threads)


def numba_rk4(precision: Precision = "double", threads: int = 1) -> Method:
    """Return RK4 by the numba kernel."""

    def solve(scene: cs.Scene, duration: float, dt: float) -> Any:
        steps = max(1, int(np.ceil(duration / dt - 1e-9)))
        dtype = np.float64 if precision == "double" else np.float32
        state = scene.initial_position, scene.initial_velocity
        peer = NumbaPeer(scene, *state, duration / steps, dtype, threads)
        peer.prepare()
        peer.run(0)  # compiles
        with Stopwatch() as watch:
            peer.run(steps)
        return (
            *(a.astype(np.float64) for a in (peer.positions, peer.velocities)),
            4 * steps,
            watch.seconds,
        )

    return Method("rk4 (numba)", solve, "dt", "numba", precision, threads)


def scipy(method: str, threads: int = 1) -> Method:
    """Return a method of `solve_ivp` over the numba kernel's forces."""

    def solve(scene: cs.Scene, duration: float, rtol: float) -> Any:
        from scipy.integrate import solve_ivp

        set_threads(threads)
        slopes = NumbaSlopes(scene, threads)
        slopes(0.0, slopes.start)  # compiles
        options = {"rtol": rtol, "atol": rtol * max(scene.cloth.size), "t_eval": (duration,)}
        with Stopwatch() as watch:
            run = solve_ivp(slopes, (0.0, duration), slopes.start, method=method, **options)
        if not run.success:
            raise ArithmeticError(f"{method}: {run.message}")
        return *slopes.points(run.y[:, -1]), int(run.nfev), watch.seconds

    return Method(f"{method} (SciPy)", solve, "rtol", "SciPy", "double", threads)


def diffrax(solver: str, stages: int) -> Method:
    """Return a solver of diffrax with its PID controller's default (an I controller), in double."""

    def solve(scene: cs.Scene, duration: float, rtol: float) -> Any:
        import jax

        with jax.enable_x64(True):
            run, start = _diffrax_program(_Identity(scene), solver)
            arguments = start, duration, rtol, rtol * max(scene.cloth.size)
            jax.block_until_ready(run(*arguments))  # compiled at the first call
            with Stopwatch() as watch:
                end, steps = jax.block_until_ready(run(*arguments))
            return (
                *(np.moveaxis(np.asarray(a), 0, -1) for a in end),
                stages * int(steps),
                watch.seconds,
            )

    return Method(f"{solver} (diffrax)", solve, "rtol", "diffrax")


class _Identity:
    """A hashable handle of a scene, equal by identity."""

    def __init__(self, scene: cs.Scene) -> None:
        self.scene = scene

    def __hash__(self) -> int:
        return id(self.scene)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Identity) and other.scene is self.scene


@cache
def _diffrax_program(key: _Identity, solver: str) -> tuple[Callable[..., Any], Any]:
    """Return a compiled run of the scene, and its initial state, (3, rows, columns) each."""
    import diffrax
    import jax
    import jax.numpy as jnp

    scene = key.scene
    kinds = [(*spring_ends(r, c), k, rest, c_) for r, c, k, rest, c_ in spring_kinds(scene)]
    gravity = jnp.array(scene.gravity).reshape(3, 1, 1)
    inverse_mass = 1 / scene.cloth.mass_per_point[0, 0]
    free = jnp.array(~scene.cloth.pinned, dtype=float)

    def slope(t: Any, state: Any, _: Any) -> Any:
        x, v = state
        force = jnp.zeros_like(x)
        for near, far, stiffness, rest, damping in kinds:
            d, w = x[far] - x[near], v[far] - v[near]
            square = (d * d).sum(axis=0)
            rate = (w * d).sum(axis=0) / square
            scale = stiffness * (1 - rest / jnp.sqrt(square)) + damping * rate
            force = force.at[near].add(scale * d).at[far].add(-scale * d)
        return v, free * (force * inverse_mass + gravity)

    @jax.jit
    def run(state: Any, duration: float, rtol: float, atol: float) -> Any:
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(slope),
            getattr(diffrax, solver)(),
            0.0,
            duration,
            None,
            state,
            stepsize_controller=diffrax.PIDController(rtol=rtol, atol=atol),
            max_steps=10**6,
        )
        return tuple(a[-1] for a in solution.ys), solution.stats["num_steps"]

    start = tuple(
        jnp.array(np.moveaxis(a, -1, 0)) for a in (scene.initial_position, scene.initial_velocity)
    )
    return run, start


def installed_peers(scene: cs.Scene, threads: int | None = None) -> tuple[list[Method], list[str]]:
    """Return the peers that can be run here, and a reason for each that cannot.

    `threads` is the most of numba's kernels, by default one; the parallel kernel is used where it
    is measured faster.
    """
    missing = [
        f"{name} is not installed"
        for name in ("numba", "scipy", "diffrax")
        if find_spec(name) is None
    ]
    peers: list[Method] = []
    if find_spec("numba"):
        count = threads if threads and threads > 1 and parallel_pays(scene, threads) else 1
        peers += [numba_rk4(precision, count) for precision in ("double", "single")]
        if find_spec("scipy"):
            peers += [scipy(method, count) for method in ("DOP853", "RK45")]
    if find_spec("diffrax"):
        peers += [diffrax("Tsit5", 6), diffrax("Dopri8", 13)]
    return peers, missing


def parallel_pays(scene: cs.Scene, threads: int) -> bool:
    """Return whether numba's parallel kernel is now faster than its serial one."""
    state = scene.initial_position, scene.initial_velocity
    dt = 0.5 * cs.max_stable_dt(scene)
    works = [NumbaPeer(scene, *state, dt, np.float64, n) for n in (1, threads)]
    for work in works:
        work.run(1)  # compiles
    serial, parallel = measure(works, 5, 1e-3)
    return parallel.minimum < serial.minimum
