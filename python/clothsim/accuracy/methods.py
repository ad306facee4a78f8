"""Methods of work-precision: a method solves a scene at a given setting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from ..base import Floats, check
from ..engine.options import PRECISIONS
from ..methods.bound import stable_dt
from ..methods.data import integrator_name
from ..methods.integration import integrators
from ..model.scene import Scene
from ..run.error_control import size_of
from ..run.simulate import simulate
from ..typing import Precision

OWN = "clothsim"
COMPARED = ("semi_implicit_euler", "velocity_verlet", "rk4", "dopri5 adaptive", "dop853 adaptive")

# An explicit method's coarsest step is this part of the guaranteed stable one.
_SAFETY = 0.95
_HALVINGS = 7

RTOLS = tuple(10.0**-k for k in range(3, 14))
"""Default relative tolerances of adaptive methods, the coarsest first: 1e-3 to 1e-13."""


@dataclass(frozen=True)
class Outcome:
    """The end of a solution and its cost.

    Attributes
    ----------
    x, v : numpy.ndarray
        Positions [m] and velocities [m/s] at the end.
    force_evaluations : int
    seconds : float
        Wall time of the stepping alone: no setting up, no compiling.

    Examples
    --------
    >>> import clothsim as cs
    >>> from clothsim.accuracy import Outcome
    >>> run = cs.simulate(cs.scenes.oscillator(), 0.1, dt=1e-3)
    >>> Outcome(run.x[-1], run.v[-1], run.report["force_evaluations"], run.report["wall_time"]).force_evaluations
    400
    """

    x: Floats
    v: Floats
    force_evaluations: int
    seconds: float


class Method(Protocol):
    """A way to solve a scene: what `clothsim.work_precision` needs of a solver of your own.

    A class with these attributes and methods is enough; it need not inherit from `Method`.

    Attributes
    ----------
    name : str
    library : str
        Name of the package.
    precision : str
    threads : int or None
    control : {"dt", "rtol"}
        Kind of a setting: a time step [s], or a relative tolerance. `simulate` bounds the error at the end by the
        tolerance times the cloth's size. Other solvers mostly bound the error of each step.

    Examples
    --------
    Velocity Verlet over `clothsim.acceleration`, of order 2. The forces of the undamped spring depend on x alone.

    >>> import time
    >>> import clothsim as cs
    >>> from clothsim.accuracy import Outcome
    >>> class Verlet:
    ...     name, library, precision, threads, control = "verlet", "mine", "double", 1, "dt"
    ...
    ...     def settings(self, scene, duration):
    ...         return [duration / 100, duration / 200]
    ...
    ...     def solve(self, scene, duration, setting):
    ...         x, v = scene.initial_position, scene.initial_velocity
    ...         steps = round(duration / setting)
    ...         start = time.perf_counter()
    ...         a = cs.acceleration(scene, x, v)
    ...         for _ in range(steps):
    ...             v = v + setting / 2 * a
    ...             x = x + setting * v
    ...             a = cs.acceleration(scene, x, v)
    ...             v = v + setting / 2 * a
    ...         return Outcome(x, v, steps + 1, time.perf_counter() - start)
    >>> data = cs.work_precision(cs.scenes.oscillator(), 0.5, [Verlet()])
    >>> round(float(data.rms_error[0, 0] / data.rms_error[0, 1]), 1)
    4.0
    """

    @property
    def name(self) -> str: ...
    @property
    def library(self) -> str: ...
    @property
    def precision(self) -> Precision: ...
    @property
    def threads(self) -> int | None: ...
    @property
    def control(self) -> str: ...

    def settings(self, scene: Scene, duration: float) -> list[float]:
        """Settings to try by default, the coarsest first."""

    def solve(self, scene: Scene, duration: float, setting: float) -> Outcome:
        """The scene after `duration`."""


def extent(scene: Scene) -> float:
    """The longer side of the cloth [m]. A relative tolerance times this is an error in metres, in `simulate` too.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    float

    Examples
    --------
    >>> import clothsim as cs
    >>> from clothsim.accuracy import extent
    >>> extent(cs.Scene(cs.Cloth(size=(1.0, 1.5))))
    1.5
    """
    return size_of(scene)


def step_sizes(scene: Scene, duration: float, integrator: str = "rk4") -> list[float]:
    """Default time steps of a method with fixed steps [s], the coarsest first.

    The first is 0.95 of the guaranteed stable step, and at most a quarter of `duration`. For an implicit method it is 8
    times the stable step of RK4. For a method without a stable step it is that of RK4. Each of the six others is half
    the one before.

    Parameters
    ----------
    scene : Scene
    duration : float
        Simulated time [s].
    integrator : str, default "rk4"
        A name of `clothsim.integrators`.

    Returns
    -------
    list of float

    Examples
    --------
    >>> import clothsim as cs
    >>> from clothsim.accuracy import step_sizes
    >>> [f"{dt:.2g}" for dt in step_sizes(cs.scenes.paper_swing(), 0.5)]
    ['0.0011', '0.00055', '0.00028', '0.00014', '6.9e-05', '3.4e-05', '1.7e-05']
    """
    explicit = integrators()[integrator].explicit
    # A step that nothing limits: from well above what an explicit method could take.
    largest = (stable_dt(scene, integrator) if explicit else 0.0) or stable_dt(scene, "rk4")
    largest = min(_SAFETY * largest if explicit else 8 * largest, duration / 4)
    return [largest / 2**k for k in range(_HALVINGS)]


@dataclass(frozen=True)
class Own:
    """An integrator of this package."""

    integrator: str
    precision: Precision = "double"
    threads: int | None = None
    control: str = "dt"
    library: str = OWN

    @property
    def name(self) -> str:
        return self.integrator if self.control == "dt" else f"{self.integrator} adaptive"

    def settings(self, scene: Scene, duration: float) -> list[float]:
        if self.control == "rtol":
            return list(RTOLS)
        return step_sizes(scene, duration, self.integrator)

    def solve(self, scene: Scene, duration: float, setting: float) -> Outcome:
        by: dict[str, Any] = {self.control: setting}
        method: dict[str, Any] = {"integrator": self.integrator, "precision": self.precision, "threads": self.threads}
        run = simulate(scene, duration, **method, **by)
        report = run.report
        return Outcome(run.x[-1], run.v[-1], report["solution_evaluations"], report["wall_time"])


def chosen_methods(
    scene: Scene, methods: Sequence[str | Method] | None, precisions: Sequence[Precision], threads: int | None
) -> list[Method]:
    """The argument `methods` of `clothsim.work_precision`: integrators by name, then methods of others."""
    check.instance("scene", scene, Scene)
    precisions = check.items("precisions", precisions, None, "names", 1)
    given = [] if methods is None else check.items("methods", methods, None, "names or methods", 1)
    for k, one in enumerate(given):
        if not isinstance(one, str) and not hasattr(one, "control"):
            raise TypeError(f"methods[{k}] must be a name or a Method, got {check.shown(one)}")
    names = COMPARED if methods is None else [m for m in given if isinstance(m, str)]
    return [*own_methods(names, precisions, threads), *(m for m in given if not isinstance(m, str))]


def own_methods(
    names: Sequence[str] = COMPARED, precisions: Sequence[Precision] = ("double",), threads: int | None = None
) -> list[Own]:
    """The integrators of these names as methods.

    "NAME adaptive" is the variant that chooses its steps by a tolerance.
    """
    known = {name: (name, "dt") for name in integrators()}
    known |= {f"{n} adaptive": (n, "rtol") for n, one in integrators().items() if one.adaptive}
    for k, precision in enumerate(precisions):
        check.choice(f"precisions[{k}]", precision, PRECISIONS)
    chosen = [known[_known(name, known)] for name in names]
    return [Own(name, precision, threads, control) for name, control in chosen for precision in precisions]


def _known(name: str, known: Mapping[str, tuple[str, str]]) -> str:
    """The key of `known` for the name of an integrator, which may end in " adaptive"."""
    if isinstance(name, str) and name.endswith(" adaptive"):
        name = integrator_name(name.removesuffix(" adaptive"), argument="methods") + " adaptive"
        return check.choice("methods", name, known)
    return integrator_name(name, argument="methods")
