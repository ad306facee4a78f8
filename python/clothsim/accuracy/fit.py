"""Parameters of a scene from a measured motion, with their errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base import Floats, check
from ..base.progress import ProgressBar
from ..base.services import find_service
from ..base.text import align_table
from ..model.scene import Scene
from ..run.reasons import Reason
from ..run.result import Run
from ..run.simulate import simulate
from ..typing import Force
from .fit_search import FitProblem, SearchOutcome
from .parameters import parameters_of
from .residuals import (
    covariance_of_correlated_residuals,
    is_significant_correlation,
    judge_determination,
    one_sigma_of_student,
    reason_of_small_chi_square,
    rival_minima,
)
from .sensitivity import check_times, compute_known_derivatives

_COARSE = 0.3  # largest error of simulated positions over sigma


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """The parameters that were fitted to a motion, as `fit` returns them.

    Attributes
    ----------
    scene : Scene
        The scene at the minimum; a parameter that is not determined has an arbitrary value.
    values, errors : dict
        Parameters by name, and their standard deviations; NaN where the data does not determine
        them.
    covariance : numpy.ndarray
        Covariance of the values, in their order; NaN as above.
    residuals : numpy.ndarray
        Measured less fitted positions [m], of the shape of the data; NaN where nothing was
        measured.
    run : Run
        The run of `scene`, with frames at `times`.
    times, positions : numpy.ndarray
        The data [s, m].
    report : dict
        "reason": "", or why something is NaN; "reasons" by parameter; "sigma" [m], as given or
        estimated; "chi_square" per degree of freedom (NaN if sigma is estimated); "correlation" of
        residuals at neighbouring times; "condition" of the Jacobian with columns of length 1;
        "evaluations", "jacobians", "starts", "wall_time" [s].
    """

    scene: Scene
    values: dict[str, float]
    errors: dict[str, float]
    covariance: Floats
    residuals: Floats
    run: Run
    times: Floats
    positions: Floats
    report: dict[str, Any]

    def __repr__(self) -> str:
        reasons = self.report["reasons"]
        rows = [
            (name, f"{value:.6g}", f"+- {self.errors[name]:.2g}", reasons[name])
            for name, value in self.values.items()
        ]
        text = align_table([("parameter", "value", "one sigma", ""), *rows], left=(0, 3))
        return text + f"\n{self.report['reason']}".rstrip()

    def plot(self, ax: Any = None) -> Any:
        """Draw data and fit, residuals, values with errors, and correlations, and return the axes.

        Points that are far from each other stand for the motion. Correlations are drawn of two or
        more parameters that have an error.

        Parameters
        ----------
        ax : sequence of matplotlib.axes.Axes, optional
            Four axes, or three where no correlations are drawn. Default: those of a new figure.

        Examples
        --------
        >>> motion = cs.simulate(cs.scenes.oscillator(), 0.2, rtol=1e-6, fps=50)
        >>> guess = cs.scenes.oscillator(stiffness=90.0)
        >>> len(cs.fit(guess, motion.t, motion.x, over=["stiffness"]).plot())
        3
        """
        return find_service("draw_fit")(self, ax)


@check.check_names
def fit(
    scene: Scene,
    times: npt.ArrayLike,
    positions: npt.ArrayLike,
    over: Sequence[str] | Mapping[str, tuple[float, float]],
    points: Sequence[tuple[int, int]] | None = None,
    sigma: float | None = None,
    rtol: float = 1e-6,
    *,
    force: Force | None = None,
    progress: bool = False,
) -> Fit:
    """Fit parameters of a scene to a measured motion, with the error of every number.

    The parameters p minimise the sum of ((measured - x(p)) / sigma)**2 over all measured numbers.
    Their covariance is that of the linearised problem, the inverse of J^T J with J = dx/dp / sigma.
    Several starts are compared, among them the aliases of an oscillation.

    Parameters
    ----------
    scene : Scene
        Initial state of the motion, and starting values of the parameters, which may be off by a
        factor of ten.
    times : array_like
        Times of the measurement [s], increasing, >= 0; the scene's initial state is at time 0.
    positions : array_like
        Measured positions [m], shape (times, rows, columns, 3), or (times, points, 3) with
        `points`; NaN, or masked, where nothing was measured. Pinned points do not count, unless the
        place of a pin is fitted.
    over : sequence of str, or mapping of str to (least, most)
        Names as in `sensitivity`; a mapping gives bounds too.
    points : sequence of (row, column), optional
        The measured points. Default: all.
    sigma : float, optional
        Standard deviation of each measured number [m], > 0. Default: estimated from the residuals
        of the best of several starts. Give it if you know it: it tells whether a minimum explains
        the data.
    rtol : float, default 1e-6
        Error of the simulated positions over the size of the cloth, well below `sigma`.
    force : callable, optional
        As for `simulate`.
    progress : bool, default False
        True shows a progress bar: the simulated time up to which each start is fitted.

    Returns
    -------
    Fit
        It prints as a table, and its method `plot` draws it. A parameter that the data does not
        determine is NaN, with a reason, also where another value fits as well. After a response of
        "ray" or "reflect" all are NaN. Errors are NaN if the residuals are not noise: then the
        model does not describe the measured motion. Correlated residuals widen errors where `sigma`
        is given; without it errors are those of Student's t.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above, or positions are in another unit than metres.

    Examples
    --------
    >>> import numpy as np
    >>> times = np.linspace(0.05, 0.5, 10)
    >>> scene = cs.scenes.hanging(shape=(4, 4))
    >>> tracked = cs.simulate(scene, 0.5, rtol=1e-8, times=times).x[1:, -1:, -1]
    >>> noise = np.random.default_rng(0).normal(0, 1e-4, tracked.shape)
    >>> guess = cs.scenes.hanging(shape=(4, 4), stiffness=300.0)
    >>> result = cs.fit(guess, times, tracked + noise, ["stiffness"], points=[(-1, -1)])
    >>> abs(result.values["stiffness"] - 1000) < 3 * result.errors["stiffness"]
    True
    """
    check.instance("scene", scene, Scene)
    names = [parameter.name for parameter in parameters_of(scene, over, "over")]
    times = check_times(times)
    numbers, place = _check_measured_positions(scene, times, positions, points)
    if sigma is not None:
        sigma = check.number("sigma", sigma, minimum=1e-100)
    rtol = check.number("rtol", rtol, minimum=0, exclusive=True)
    data = np.full((len(times), *scene.cloth.shape, 3), np.nan)
    data[:, place[0], place[1]] = numbers
    mask = np.isfinite(data)
    if not any(name.startswith("pin") for name in names):
        mask &= ~scene.cloth.pinned[:, :, None]
    count = int(mask.sum())
    if count <= len(names):
        raise ValueError(
            "positions must have more numbers at free points than over has names, "
            f"{len(names)}, got {count}"
        )
    problem = FitProblem(scene, over, times, data, mask, sigma, rtol, force)
    if sigma is not None and problem.least > _COARSE * sigma:
        raise ValueError(
            f"rtol must be at most {_COARSE * sigma / max(scene.cloth.size):.2g} with sigma = "
            f"{sigma:g} m, so that simulated positions err by less than that, got {rtol:g}"
        )
    # The times count once for the first start, and once for the derivatives and the run at the end.
    with ProgressBar.for_simulated_time(progress, 2 * float(times[-1]), "fit") as bar:
        problem.check_unit_of_length()
        begin = perf_counter()
        outcome = problem.search_minima(bar)
        best = outcome.best_minimum
        scene = problem.scene_at(best.x)
        parameters = parameters_of(scene, names, "over")
        slopes = compute_known_derivatives(scene, parameters, problem.make_schedule(scene, times))
        run = simulate(scene, float(times[-1]), rtol=rtol, times=times, force=force)
        wall_time = perf_counter() - begin
        bar.advance(times[-1])
    jacobian = (
        problem.jacobian_columns(slopes.change, parameters, best.x) / outcome.quality["sigma"]
    )
    covariance, condition, reasons = judge_determination(
        jacobian, slopes.reasons, best.x, problem.bounds
    )
    correlation = outcome.quality["correlation"]
    if sigma is None:
        covariance *= one_sigma_of_student(count - len(names)) ** 2
    elif is_significant_correlation(correlation, mask):
        covariance = covariance_of_correlated_residuals(covariance, jacobian, mask, correlation)
    scale = 2 * (problem.unit / outcome.quality["sigma"]) ** 2
    for k, other in rival_minima(best, outcome.minima, scale, covariance).items():
        value = problem.parameter_values(best.x)[k]
        rival = Reason.RIVAL.format(other=problem.parameter_values(other)[k], value=value)
        reasons[k] = reasons[k] or rival
    rates = problem.derivatives_of_values(best.x)
    values = np.where(
        [bool(reason) for reason in reasons], np.nan, problem.parameter_values(best.x)
    )
    covariance = covariance * np.outer(rates, rates) + 0 * np.add.outer(values, values)
    text, has_no_errors = _reason_and_reach_of_nan(problem, outcome, reasons, slopes.reasons)
    if has_no_errors:
        covariance = np.full_like(covariance, np.nan)
    report = {
        "reason": text,
        "reasons": dict(zip(names, reasons)),
        **outcome.quality,
        "condition": condition,
        "evaluations": problem.evaluations,
        "jacobians": problem.jacobians,
        "starts": len(outcome.minima),
        "wall_time": wall_time,
    }
    fitted = run.x[np.searchsorted(run.t, times)][:, place[0], place[1]]
    return Fit(
        scene=scene,
        values=dict(zip(names, values.tolist())),
        errors=dict(zip(names, np.sqrt(np.diag(covariance)).tolist())),
        covariance=covariance,
        residuals=numbers - fitted,
        run=run,
        times=times,
        positions=numbers,
        report=report,
    )


def _reason_and_reach_of_nan(
    problem: FitProblem, outcome: SearchOutcome, reasons: Sequence[str], ends: Sequence[str]
) -> tuple[str, bool]:
    """Return why something is NaN, or "", and whether that takes the meaning from all errors.

    `reasons` are those of the parameters, `ends` why derivatives are not known at the last times.
    """
    if any(ends):
        return Reason.EARLIER.format(derivatives=next(filter(None, ends))), False
    if outcome.shift:
        return Reason.LATE.format(late=-outcome.shift), True
    parts = []
    for reason in dict.fromkeys(filter(None, reasons)):
        pairs = zip(problem.names, reasons)
        names = [name for name, reason_of_name in pairs if reason_of_name == reason]
        parts.append(f"{', '.join(names)}: {reason}")
    misfit = outcome.misfit
    if not misfit and problem.sigma is not None:
        free = int(problem.mask.sum()) - len(problem.names)
        misfit = reason_of_small_chi_square(outcome.quality, free, problem.mask)
    if misfit:
        parts.append(misfit)
    return "; ".join(parts), bool(misfit)


def _check_measured_positions(
    scene: Scene, times: Floats, values: Any, points: Any
) -> tuple[Floats, Any]:
    """Return measured positions, and the rows and columns of their points."""
    sides = scene.cloth.shape
    place = np.indices(sides)
    if points is not None:
        pairs = []
        for k, pair in enumerate(check.list_of_items("points", points, None, "(row, column)", 1)):
            argument = f"points[{k}]"
            indices = check.list_of_items(argument, pair, 2, "integers (row, column)")
            pairs.append(
                [
                    check.integer(argument, index, minimum=-side, maximum=side - 1) % side
                    for index, side in zip(indices, sides)
                ]
            )
        place = np.array(pairs).T
        if len(np.unique(place, axis=1).T) < len(pairs):
            raise ValueError(f"points must name each point once, got {list(points)}")
    shape = (len(times), *place[0].shape, 3)
    requirement = f"an array of shape {shape} of numbers, NaN where nothing was measured"
    if isinstance(values, np.ma.MaskedArray) and values.dtype.kind in "iuf":
        values = np.where(np.ma.getmaskarray(values), np.nan, values.data)
    array = check.as_array("positions", values, requirement)
    if array.shape != shape:
        raise ValueError(f"positions must be {requirement}, got shape {array.shape}")
    array = array.astype(np.float64)
    check.check_all("positions", array, ~np.isinf(array), requirement)
    return array, place
