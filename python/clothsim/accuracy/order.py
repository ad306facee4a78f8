"""Errors of a method over its time steps, and the order that they show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base import Floats, check
from ..base.services import find_service
from ..base.text import align_table
from ..errors import UnstableError
from ..methods.integrators import check_integrator_name
from ..model.scene import Scene
from ..run.simulate import simulate
from ..typing import Force, Integrator, Kernel, Precision
from .solution import Reference, checked_or_new_reference

_FLOOR_PART = 0.1  # largest part of an error that is fitted, which rounding and reference may make
_LARGEST_PART = 0.1  # largest error that is fitted, over how far the cloth has moved
_LEAST_SLOPE = 0.5  # slope between two steps below which rounding makes smaller steps useless


@dataclass(frozen=True, eq=False, repr=False)
class Convergence:
    """The errors of a method over time steps, as `convergence` returns them.

    Attributes
    ----------
    integrator, precision : str
    dt : numpy.ndarray
        Time steps as taken [s], decreasing, shape (steps,).
    steps : numpy.ndarray
        Number of steps of each run, shape (steps,).
    rms, max : numpy.ndarray
        Distances of the mass points from the reference at the end [m], shape (steps,); infinite
        where the run was unstable.
    order : float
        Slope of log rms over log dt, a least-squares fit of the steps in `fitted`. NaN if `fitted`
        has fewer than two steps.
    fitted : numpy.ndarray
        True where the method causes the error, shape (steps,). The error is then at least ten times
        the `floor`, and below a tenth of the rms distance that the cloth has moved.
    floor : numpy.ndarray
        Smallest error that the comparison can show [m], shape (steps,), the largest of three: the
        reference's error estimate; the least error from where smaller steps no longer help (slope <
        1/2); and eps/2 times the cloth's size, in double times the root of the number of steps. In
        double the rounding of the positions adds up like a random walk; "single" compensates it.
    reference : Reference
    """

    integrator: str
    precision: Precision
    dt: Floats
    steps: npt.NDArray[np.int64]
    rms: Floats
    max: Floats
    order: float
    fitted: npt.NDArray[np.bool_]
    floor: Floats
    reference: Reference

    def plot(self, ax: Any = None) -> Any:
        """Draw errors, order and floor, and return the axes.

        Errors that are not fitted are hollow, and unstable runs are crosses.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Default: those of a new figure.

        Examples
        --------
        >>> cs.convergence(cs.scenes.oscillator(), 0.1, [0.01, 0.005]).plot().get_xlabel()
        'time step dt [s]'
        """
        return find_service("draw_convergence")(self, ax)

    def __str__(self) -> str:
        title = f"order {self.order:.2f} (* fitted)"
        if math.isnan(self.order):
            title = (
                "no order: fewer than two errors are well above the floor, "
                f"{self.floor.min():.1e} m"
            )
        orders = ["", *(f"{order:.2f}" for order in _observed_orders(self.dt, self.rms))]
        rows = [
            (f"{dt:.4g}", f"{rms:.2e}", f"{largest:.2e}", order, "*" * bool(fit))
            for dt, rms, largest, order, fit in zip(
                self.dt, self.rms, self.max, orders, self.fitted, strict=True
            )
        ]
        table = align_table([("dt [s]", "rms [m]", "max [m]", "order", ""), *rows], left=())
        return f"{self.integrator}, {self.precision}: {title}\n{table}"

    __repr__ = __str__


@check.check_names
def convergence(
    scene: Scene,
    duration: float,
    dts: Sequence[float],
    integrator: Integrator = "rk4",
    precision: Precision = "double",
    *,
    reference: Reference | None = None,
    threads: int | None = None,
    kernel: Kernel = "auto",
    force: Force | None = None,
) -> Convergence:
    """Measure errors against the trusted solution, and the order that they show.

    A method of order p errs by about C dt**p where the step is neither so long that further terms
    count nor so short that rounding does. The slope of log error over log dt between these is p.

    Parameters
    ----------
    scene, duration
        As for `reference`.
    dts : sequence of float
        Time steps [s], > 0, at least one. Each step is shortened until it divides the duration, so
        that all steps of a run are equal.
    integrator : str, default "rk4"
        A name of `clothsim.integrators`; an adaptive one runs at the fixed steps given.
    precision : {"double", "single"}, default "double"
    reference : Reference, optional
        Solution to measure by; its last frame is at `duration`. Default: `reference(scene,
        duration, force=force)`.
    threads, kernel, force
        As for `simulate`.

    Returns
    -------
    Convergence
        It prints as a table, and its method `plot` draws it.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above, or as `reference` does.

    Examples
    --------
    >>> scene = cs.scenes.oscillator(damping=2.0)
    >>> errors = cs.convergence(scene, 0.5, [0.01, 0.005, 0.0025])
    >>> round(errors.order, 1), errors.steps.tolist()
    (4.0, [50, 100, 200])
    """
    check.instance("scene", scene, Scene)
    duration = check.number("duration", duration, minimum=0, exclusive=True)
    integrator = check_integrator_name(integrator, fixed=True)
    check.choice("precision", precision, ("double", "single"))
    steps = _check_step_counts(dts, duration)
    solution = checked_or_new_reference(scene, duration, reference, force)
    options: dict[str, Any] = {"precision": precision, "threads": threads, "kernel": kernel}
    dt = duration / steps
    errors = []
    for step in dt.tolist():
        try:
            run = simulate(scene, duration, step, integrator, force=force, **options)
            error = solution.error_of(run.x[-1])
            errors.append((error["rms"], error["max"]))
        except UnstableError:
            errors.append((math.inf, math.inf))
    rms, largest = np.array(errors).T
    floor = _error_floor(scene, precision, solution, steps, rms)
    way = solution.error_of(scene.initial_position)["rms"]
    fitted = (rms >= floor / _FLOOR_PART) & (rms <= _LARGEST_PART * way)
    order = math.nan
    if fitted.sum() > 1:
        order = float(np.polyfit(np.log(dt[fitted]), np.log(rms[fitted]), 1)[0])
    return Convergence(
        integrator=integrator,
        precision=precision,
        dt=dt,
        steps=steps,
        rms=rms,
        max=largest,
        order=order,
        fitted=fitted,
        floor=floor,
        reference=solution,
    )


def _check_step_counts(dts: Any, duration: float) -> npt.NDArray[np.int64]:
    """Return the numbers of equal steps of at most the lengths in `dts`, increasing."""
    values = check.list_of_items("dts", dts, None, "time steps > 0", 1)
    lengths = [
        check.number(f"dts[{k}]", dt, minimum=0, exclusive=True) for k, dt in enumerate(values)
    ]
    if not duration / min(lengths) <= check.INT64_MAX:
        raise ValueError(
            f"dts must be above duration / {check.INT64_MAX:.3g}, got {min(lengths):g}"
        )
    return np.array(sorted({max(1, math.ceil(duration / dt - 1e-9)) for dt in lengths}))


def _error_floor(
    scene: Scene,
    precision: Precision,
    solution: Reference,
    steps: npt.NDArray[np.int64],
    rms: Floats,
) -> Floats:
    """Return the smallest error that the comparison can show at each step; see `Convergence`."""
    flat = np.flatnonzero(_observed_orders(1 / steps, rms) < _LEAST_SLOPE)
    least = float(rms[flat[0] :].min()) if flat.size else 0.0
    digits: Floats = np.finfo(np.float64).eps / 2 * np.sqrt(steps)
    if precision == "single":
        digits = np.full(len(steps), float(np.finfo(np.float32).eps) / 2)
    reference = float(solution.error_estimate["rms"][-1])
    floor: Floats = np.maximum(max(reference, least), max(scene.cloth.size) * digits)
    return floor


def _observed_orders(dt: Floats, rms: Floats) -> Floats:
    """Return the order between each two steps."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.diff(np.log(rms)) / np.diff(np.log(dt))
