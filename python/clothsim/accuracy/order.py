"""Errors against the trusted solution over a list of time steps, and the order they show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..base import Floats, check
from ..base.extras import needed
from ..base.table import aligned
from ..errors import UnstableError
from ..methods.data import integrator_name
from ..model.scene import Scene
from ..run.simulate import simulate
from ..typing import Integrator, Precision
from .methods import extent
from .solution import Reference, reference
from .work_plot import draw_convergence

if TYPE_CHECKING:
    import xarray


# An error is fitted where rounding and the reference make less than this part of it.
_FLOOR_PART = 0.1

# ... and where it is below this part of how far the cloth has moved.
_ASYMPTOTIC = 0.1

# Where the slope between two steps falls below this, smaller steps no longer help: rounding.
_STALLED = 0.5


@dataclass(frozen=True, eq=False, repr=False)
class Convergence:
    """Errors of a method over time steps, the result of `convergence`.

    Attributes
    ----------
    integrator, precision : str
    dt : numpy.ndarray
        Time steps as taken [s], decreasing, shape (steps,).
    steps, force_evaluations : numpy.ndarray
        Numbers of steps and of force evaluations of each run, shape (steps,).
    rms, max : numpy.ndarray
        Distances of the mass points from the reference at the end [m], shape (steps,); infinite
        where the run was unstable.
    order : float
        Slope of log rms over log dt, a least-squares fit of the steps in `fitted`. NaN if `fitted` has fewer than two
        steps.
    fitted : numpy.ndarray
        True where the method causes the error, shape (steps,). The error is then at least ten times the `floor`, and
        below a tenth of the rms distance that the cloth has moved.
    floor : numpy.ndarray
        Smallest error that the comparison can show [m], shape (steps,). Smaller differences are rounding or the error
        of the reference. The floor is the largest of three figures. The first is the rms of the reference's error
        estimate. The second is the least error from where smaller steps no longer help (slope < 1/2). The third is
        eps/2 times the cloth's size, in double times the root of the number of steps. In double the rounding of the
        positions adds up like a random walk; "single" compensates it.
    reference : Reference

    Examples
    --------
    >>> import clothsim as cs
    >>> found = cs.convergence(cs.scenes.oscillator(), 1.0, dts=[2e-3, 1e-3])
    >>> found.local_orders.round(1)
    array([4.])
    """

    integrator: str
    precision: Precision
    dt: Floats
    steps: npt.NDArray[np.int64]
    force_evaluations: npt.NDArray[np.int64]
    rms: Floats
    max: Floats
    order: float
    fitted: npt.NDArray[np.bool_]
    floor: Floats
    reference: Reference

    @property
    def local_orders(self) -> Floats:
        """Slope between each step and the next smaller one, shape (steps - 1,)."""
        return _slopes(self.dt, self.rms)

    def plot(self, ax: Any = None) -> Any:
        """Draw errors over time steps, with the fitted order and the floor of the comparison.

        Hollow circles are not fitted; crosses at the top are unstable steps.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Default: the axes of a new figure of pyplot.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        ImportError
            Without matplotlib (extra "plot").

        Examples
        --------
        >>> import clothsim as cs
        >>> from matplotlib.figure import Figure
        >>> found = cs.convergence(cs.scenes.oscillator(), 1.0, dts=[2e-3, 1e-3])
        >>> found.plot(Figure().subplots()).get_xlabel()
        'time step dt [s]'
        """
        return draw_convergence(self, ax)

    def to_xarray(self) -> xarray.Dataset:
        """The arrays as an `xarray.Dataset` with the dimension "dt"; method, precision, order and duration are attributes.

        Raises
        ------
        ImportError
            Without xarray, naming the extra that brings it.

        Examples
        --------
        >>> import clothsim as cs
        >>> found = cs.convergence(cs.scenes.oscillator(), 1.0, dts=[2e-3, 1e-3])
        >>> list(found.to_xarray().data_vars)
        ['rms', 'max', 'floor', 'fitted', 'steps', 'force_evaluations']
        """
        units = {"rms": "m", "max": "m", "floor": "m", "fitted": "", "steps": "1", "force_evaluations": "1"}
        about = {name: getattr(self, name) for name in ("integrator", "precision", "order")}
        dataset: xarray.Dataset = needed("xarray", "to_xarray").Dataset(
            {name: ("dt", getattr(self, name), {"units": unit}) for name, unit in units.items()},
            {"dt": ("dt", self.dt, {"units": "s"})},
            {**about, "duration": float(self.reference.t[-1])},
        )
        return dataset

    def __str__(self) -> str:
        fitted = f"order {self.order:.2f} (* fitted)"
        if math.isnan(self.order):
            fitted = f"no order: fewer than two errors are well above the floor, {self.floor.min():.1e} m"
        orders = ["", *(f"{order:.2f}" for order in self.local_orders)]
        rows = [
            (f"{dt:.4g}", f"{rms:.2e}", f"{largest:.2e}", order, "*" * bool(fit))
            for dt, rms, largest, order, fit in zip(self.dt, self.rms, self.max, orders, self.fitted, strict=True)
        ]
        table = aligned(("dt [s]", "rms [m]", "max [m]", "order", ""), rows, left=())
        return f"{self.integrator}, {self.precision}: {fitted}\n{table}"

    __repr__ = __str__


def convergence(
    scene: Scene,
    duration: float,
    dts: Sequence[float],
    integrator: Integrator = "rk4",
    precision: Precision = "double",
    *,
    reference: Reference | None = None,
    **options: Any,
) -> Convergence:
    """Errors against the trusted solution, and the order that they show.

    Parameters
    ----------
    scene : Scene
        Without contact up to `duration`.
    duration : float
        Simulated time [s], > 0.
    dts : sequence of float
        Time steps [s], > 0, at least one. Each step is shortened until it divides the duration, so that all steps of a
        run are equal.
    integrator : str, default "rk4"
        A name of `clothsim.integrators`; an adaptive one runs at the fixed steps given.
    precision : {"double", "single"}, default "double"
    reference : Reference, optional
        Solution to measure by; its last frame is at `duration`. Default: `reference(scene,
        duration)`.
    **options
        Further arguments of `simulate`: threads, kernel.

    Returns
    -------
    Convergence
        It prints as a table.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.

    Examples
    --------
    >>> import clothsim as cs
    >>> scene = cs.scenes.oscillator(damping=2.0)
    >>> found = cs.convergence(scene, 0.5, [0.01, 0.005, 0.0025])
    >>> round(found.order, 1), found.steps.tolist()
    (4.0, [50, 100, 200])
    """
    check.instance("scene", scene, Scene)
    duration = check.number("duration", duration, minimum=0, exclusive=True)
    integrator = integrator_name(integrator)
    check.choice("precision", precision, ("double", "single"))
    listed = check.items("dts", dts, None, "time steps > 0", 1)
    steps = sorted({_steps(duration, f"dts[{k}]", dt) for k, dt in enumerate(listed)})
    solution = solution_for(scene, duration, reference)
    errors, evaluations = [], []
    for n in steps:
        error, count = _error_at(scene, solution, duration / n, integrator=integrator, precision=precision, **options)
        errors.append(error)
        evaluations.append(count)
    counts = np.array(steps)
    dt = duration / counts
    rms, largest = (np.array([error[name] for error in errors]) for name in ("rms", "max"))
    moved = solution.error_of(scene.initial_position)["rms"]
    floor = _floor(dt, rms, float(solution.error_estimate["rms"][-1]))
    floors = np.maximum(floor, _rounding(precision, extent(scene), counts))
    fitted = (rms >= floors / _FLOOR_PART) & (rms <= _ASYMPTOTIC * moved)
    order = math.nan
    if fitted.sum() > 1:
        order = float(np.polyfit(np.log(dt[fitted]), np.log(rms[fitted]), 1)[0])
    spent = np.array(evaluations)
    return Convergence(integrator, precision, dt, counts, spent, rms, largest, order, fitted, floors, solution)


def _steps(duration: float, name: str, dt: Any) -> int:
    """The number of equal steps of at most `dt` in the duration."""
    dt = check.number(name, dt, minimum=0, exclusive=True)
    if not duration / dt <= check.INT64_MAX:
        raise ValueError(f"{name} must be above duration / {check.INT64_MAX:.3g}, got {dt:g}")
    return max(1, int(math.ceil(duration / dt - 1e-9)))


def solution_for(scene: Scene, duration: float, given: Reference | None) -> Reference:
    """The reference `given`, checked to fit the scene and duration; where it is None, a new reference."""
    if given is None:
        return reference(scene, duration)
    if not isinstance(given, Reference):
        raise TypeError(f"reference must be a Reference or None, got {type(given).__name__}")
    if given.scene != scene or given.t[-1] != duration:
        raise ValueError(
            f"reference must be one of this scene over {duration:g} s, got one of "
            f"{'this' if given.scene == scene else 'another'} scene over {given.t[-1]:g} s"
        )
    return given


def _error_at(scene: Scene, solution: Reference, dt: float, **options: Any) -> tuple[dict[str, float], int]:
    try:
        run = simulate(scene, float(solution.t[-1]), dt, **options)
    except UnstableError as error:
        return {"rms": math.inf, "max": math.inf}, error.step
    return solution.error_of(run.x[-1]), run.report["force_evaluations"]


def _floor(dt: Floats, rms: Floats, own: float) -> float:
    """The larger of two errors: the reference's own, and the least error once smaller steps no longer help."""
    stalled = np.flatnonzero(_slopes(dt, rms) < _STALLED)
    return max(own, float(rms[stalled[0] :].min())) if stalled.size else own


def _rounding(precision: str, size: float, steps: npt.NDArray[np.int64]) -> Floats:
    if precision == "single":
        return np.full(steps.shape, size * float(np.finfo(np.float32).eps) / 2)
    return size * np.sqrt(steps) * np.finfo(np.float64).eps / 2


def _slopes(dt: Floats, rms: Floats) -> Floats:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.diff(np.log(rms)) / np.diff(np.log(dt))
