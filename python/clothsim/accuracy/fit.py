"""Parameters of a scene from a measured motion: `fit`.

The logarithms of positive parameters are fitted by SciPy's least squares. A start that is far off gives a motion that is
out of phase with the data, where least squares finds a wrong minimum. So the first times are fitted first, and then twice as
many, until all are. While few times are fitted, each parameter is held near its start by a weak prior.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base import Floats, check
from ..base.clocks import Stopwatch
from ..base.extras import needed
from ..base.table import aligned
from ..model.scene import Scene
from ..run.result import Run
from ..run.simulate import simulate
from .sensitivity import Clock, Parameter, changed, changes, checked_times, difference, parameters_of, positions_of
from .work_plot import draw_fit

_FEWEST = 4  # times of the first stage
_PRIOR = 3.0  # width of the prior, in logarithms or scales
_WIDEST = 1e3  # factor, or scales, that a parameter without bounds may move
_EDGE = 1e-3  # of logarithms or scales, from a bound
_STARTS = 8  # further starts where a minimum does not explain the data
_SINGULAR = 1e-5  # singular value over the largest, of columns of length 1: below, the data cannot tell parameters apart
_PART = 1e-2  # of a parameter in a direction that is not determined
_SIGMAS = 5.0  # from which on a chi-square, or a correlation of residuals, is no chance
_CORRELATED = 0.2  # of residuals at neighbouring times


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """Parameters that were fitted to a motion, the result of `fit`.

    Attributes
    ----------
    scene : Scene
        The scene at the minimum, with any value of a parameter that is not determined.
    values, errors : dict
        Parameters by name, and their standard deviations; NaN where the data does not determine them.
    covariance : numpy.ndarray
        Covariance of the values, in their order; NaN as above.
    residuals : numpy.ndarray
        Measured less fitted positions [m], of the shape of the data; NaN where nothing was measured.
    run : Run
        The run of `scene`, with frames at `times`.
    times, positions : numpy.ndarray
        The data [s, m].
    report : dict
        "reason": "", or why something is NaN; "reasons" by parameter; "sigma" [m], as given or estimated; "chi_square" per
        degree of freedom (NaN if sigma is estimated); "correlation" of residuals at neighbouring times; "condition" of
        the Jacobian with columns of length 1; "evaluations", "jacobians", "starts", "wall_time" [s].

    Examples
    --------
    >>> import clothsim as cs
    >>> truth = cs.scenes.oscillator(stiffness=90.0, damping=0.5)
    >>> run = cs.simulate(truth, 1.0, rtol=1e-9, times=[0.2, 0.4, 0.6, 0.8, 1.0])
    >>> found = cs.fit(cs.scenes.oscillator(damping=1.0), run.t, run.x, over=["stiffness", "damping"])
    >>> round(found.values["stiffness"], 3), round(found.values["damping"], 3)
    (90.0, 0.5)
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
        lines = [(n, f"{v:.6g}", f"+- {self.errors[n]:.2g}", reasons[n]) for n, v in self.values.items()]
        text = aligned(("parameter", "value", "one sigma", ""), lines, left=(0, 3))
        return text + f"\n{self.report['reason']}".rstrip()

    def plot(self, ax: Any = None) -> Any:
        """Draw data and fit, residuals, and correlations of the parameters.

        Parameters
        ----------
        ax : three axes of matplotlib, optional
            Default: those of a new figure.

        Returns
        -------
        numpy.ndarray of matplotlib.axes.Axes

        Examples
        --------
        >>> import clothsim as cs, matplotlib; matplotlib.use("Agg")
        >>> scene = cs.scenes.oscillator()
        >>> found = cs.fit(scene, [0.1, 0.2, 0.3], cs.simulate(scene, 0.3, times=[0.1, 0.2, 0.3]).x[1:], over=["stiffness"])
        >>> found.plot().shape
        (3,)
        """
        return draw_fit(self, ax)


class _Problem:
    """Residuals in sigmas, and their Jacobian, over coordinates that are 0 at the start: logarithms where they can be."""

    def __init__(self, scene: Scene, names: Sequence[str], times: Floats, data: Floats, measured: Any) -> None:
        self.scene, self.names, self.times = scene, names, times
        self.data, self.measured = data, measured  # (times, rows, columns, 3); whether a number counts
        parameters = parameters_of(scene, names, "over")
        self.start, self.scales, self.least, self.most = np.array([one[2:] for one in parameters]).T
        self.logarithmic = (self.least == 0) & (self.start > 0)
        self.size = max(scene.cloth.size)
        self.evaluations = self.jacobians = 0

    def values(self, u: Floats) -> Floats:
        values: Floats = np.where(self.logarithmic, self.start * np.exp(u * self.logarithmic), self.start + u * self.scales)
        return values

    def coordinates(self, values: Floats) -> Floats:
        with np.errstate(divide="ignore", invalid="ignore"):
            u: Floats = np.where(self.logarithmic, np.log(values / self.start), (values - self.start) / self.scales)
        return u

    def slopes(self, u: Floats) -> Floats:
        """Derivatives of the values by the coordinates."""
        slopes: Floats = np.where(self.logarithmic, self.values(u), self.scales)
        return slopes

    def at(self, u: Floats) -> tuple[Scene, list[Parameter]]:
        scene = changed(self.scene, parameters_of(self.scene, self.names, "over"), self.values(u))
        return scene, parameters_of(scene, self.names, "over")

    def columns(self, change: Floats, parameters: Sequence[Parameter], u: Floats) -> Floats:
        """Changes per scale of each parameter as columns of a Jacobian [m per coordinate]; 0 where a run failed."""
        slopes = self.slopes(u) / [one.scale for one in parameters]
        return np.nan_to_num(change[:, self.measured[: change.shape[1]]].T * slopes)

    def minimise(self, u: Floats, bounds: Any, sigma: float, rtol: float, least_squares: Any) -> Any:
        """The minimum over all times that is found from `u` by way of the first times."""
        total = len(self.times)
        counts = [-(-total // 2**k) for k in range(int(math.log2(total)), 0, -1)]
        for count in [*(n for n in counts if n >= _FEWEST), total]:
            clock, held = Clock(self.scene, self.times[:count]), (count < total) / _PRIOR
            clock.refine(self.at(u)[0], rtol)

            def residuals(v: Floats, middle: Floats, clock: Clock, held: float, n: int) -> Floats:
                self.evaluations += 1
                scene, _ = self.at(v)
                off = (positions_of([scene], clock, clock.counts(scene))[0][0] - self.data[:n])[self.measured[:n]]
                return np.append(np.nan_to_num(off, nan=self.size) / sigma, (v - middle) * held)

            def jacobian(v: Floats, middle: Floats, clock: Clock, held: float, n: int) -> Floats:
                self.jacobians += 1
                scene, parameters = self.at(v)
                found = self.columns(difference(scene, parameters, clock)[1], parameters, v)
                return np.append(found / sigma, np.eye(len(v)) * held, axis=0)

            digits = dict.fromkeys(("ftol", "xtol", "gtol"), 1e-4 if held else 1e-10)
            start, most = np.clip(u, bounds[0] + _EDGE / 2, bounds[1] - _EDGE / 2), 20 if held else 60
            found = least_squares(residuals, start, jacobian, bounds, args=(u, clock, held, count), max_nfev=most, **digits)
            u = found.x
        found.unit = sigma
        return found


def fit(
    scene: Scene,
    times: npt.ArrayLike,
    positions: npt.ArrayLike,
    over: Sequence[str] | Mapping[str, tuple[float, float]],
    points: Sequence[tuple[int, int]] | None = None,
    sigma: float | None = None,
    rtol: float = 1e-6,
) -> Fit:
    """Fit parameters of a scene to a measured motion, with the error of every number.

    Parameters
    ----------
    scene : Scene
        The motion begins in its initial state, and the fit in its parameters, which may be off by a factor of ten.
    times : array_like
        Times of the measurement [s], increasing, >= 0; the scene's state is that of time 0.
    positions : array_like
        Measured positions [m], shape (times, rows, columns, 3), or (times, points, 3) with `points`; NaN where nothing was
        measured. Pinned points do not count, unless the place of a pin is fitted.
    over : sequence of str, or mapping of str to (least, most)
        Names as in `sensitivity`; a mapping gives bounds too.
    points : sequence of (row, column), optional
        The measured points. Default: all.
    sigma : float, optional
        Standard deviation of each measured number [m], > 0. Default: estimated from the residuals.
    rtol : float, default 1e-6
        Error of the simulated positions over the size of the cloth.

    Returns
    -------
    Fit
        A parameter that the data does not determine is NaN, with a reason. All are after a contact. Where the residuals
        are no noise, which says that a cloth like this did not make the motion, errors are NaN.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above, or there are fewer numbers than parameters.
    ImportError
        Without SciPy, naming the extra that brings it.

    Examples
    --------
    >>> import clothsim as cs
    >>> import numpy as np
    >>> times = np.linspace(0.05, 0.5, 10)
    >>> tracked = cs.simulate(cs.scenes.hanging(shape=(4, 4)), 0.5, rtol=1e-8, times=times).x[1:, -1:, -1]
    >>> noise = np.random.default_rng(0).normal(0, 1e-4, tracked.shape)
    >>> guess = cs.scenes.hanging(shape=(4, 4), stiffness=300.0)
    >>> found = cs.fit(guess, times, tracked + noise, over=["stiffness"], points=[(-1, -1)])
    >>> abs(found.values["stiffness"] - 1000) < 3 * found.errors["stiffness"]
    True
    """
    least_squares = needed("scipy.optimize", "fit", "fit").least_squares
    check.instance("scene", scene, Scene)
    names = [one.name for one in parameters_of(scene, over, "over")]
    times = checked_times(times)
    given, place = _checked_data(scene, times, positions, points)
    if sigma is not None:
        sigma = check.number("sigma", sigma, minimum=1e-100)
    rtol = check.number("rtol", rtol, minimum=0, exclusive=True)
    data = np.full((len(times), *scene.cloth.shape, 3), np.nan)
    data[:, place[0], place[1]] = given
    measured = np.isfinite(data)
    if not any(name.startswith("pin") for name in names):
        measured &= ~scene.cloth.pinned[:, :, None]
    count = int(measured.sum())
    if count <= len(names):
        raise ValueError(f"positions must have more numbers at free points than over has names, {len(names)}, got {count}")
    problem = _Problem(scene, names, times, data, measured)
    bounds = _bounds(over, problem)
    least = rtol * problem.size  # of what residuals can show
    moved = float(np.sqrt(np.mean((data - scene.initial_position)[measured] ** 2)))
    random, u, starts, misfit = np.random.default_rng(0), np.zeros(len(names)), 0, "not tried"
    best: Any = None
    with Stopwatch() as watch:
        while misfit and starts <= _STARTS:
            found = problem.minimise(u, bounds, sigma or max(1e-3 * moved, least), rtol, least_squares)
            best = found if best is None or found.cost < best.cost else best
            chi, correlation, noise, misfit = _judged(problem, best, sigma, least)
            u, starts = random.uniform(-math.log(10), math.log(10), len(names)) * problem.logarithmic, starts + 1
        scene, parameters = problem.at(best.x)
        clock = Clock(scene, times)
        clock.refine(scene, rtol)
        _, change, _, _, ended = changes(scene, parameters, clock)
        run = simulate(scene, float(times[-1]), rtol=rtol, times=times)
    jacobian = problem.columns(change, parameters, best.x) / noise
    covariance, condition, reasons = _determined(jacobian, ended, best.x, bounds)
    slopes = problem.slopes(best.x)
    values = np.where([bool(reason) for reason in reasons], np.nan, problem.values(best.x))
    covariance = covariance * np.outer(slopes, slopes) + 0 * np.add.outer(values, values)
    groups = {one: [name for name, reason in zip(names, reasons) if reason == one] for one in reasons if one}
    told = [f"{', '.join(group)}: {one}" for one, group in groups.items()]
    if any(ended):
        told = [f"{next(filter(None, ended))}: give only the times before"]
    elif misfit:
        told.append(f"{misfit}: no such cloth moves like this, or the noise is not independent; errors have no meaning")
        covariance = np.full_like(covariance, np.nan)
    report = {
        "reason": "; ".join(told),
        "reasons": dict(zip(names, reasons)),
        "sigma": noise,
        "chi_square": chi,
        "correlation": correlation,
        "condition": condition,
        "evaluations": problem.evaluations,
        "jacobians": problem.jacobians,
        "starts": starts,
        "wall_time": watch.seconds,
    }
    residuals = given - run.x[np.searchsorted(run.t, times)][:, place[0], place[1]]
    errors = dict(zip(names, np.sqrt(np.diag(covariance)).tolist()))
    return Fit(scene, dict(zip(names, values.tolist())), errors, covariance, residuals, run, times, given, report)


def _checked_data(scene: Scene, times: Floats, values: Any, points: Any) -> tuple[Floats, Any]:
    """Measured positions, and the rows and columns of their points."""
    sides = scene.cloth.shape
    place: Any = np.indices(sides)
    if points is not None:
        points = check.items("points", points, None, "(row, column)", 1)
        pairs = [check.items(f"points[{k}]", pair, 2, "integers (row, column)") for k, pair in enumerate(points)]
        ends = [
            [check.integer(f"points[{k}]", i, minimum=-n, maximum=n - 1) % n for i, n in zip(pair, sides)]
            for k, pair in enumerate(pairs)
        ]
        place = np.array(ends, dtype=int).reshape(-1, 2).T
        if len(np.unique(place, axis=1).T) < len(pairs):
            raise ValueError(f"points must name each point once, got {list(points)}")
    shape = (len(times), *place[0].shape, 3)
    accepted = f"an array of shape {shape} of numbers, NaN where nothing was measured"
    given = check.as_array("positions", values, accepted)
    if given.shape != shape:
        raise ValueError(f"positions must be {accepted}, got shape {given.shape}")
    given = given.astype(np.float64)
    check.check_all("positions", given, ~np.isinf(given), accepted)
    return given, place


def _bounds(over: Any, problem: _Problem) -> tuple[Floats, Floats]:
    """Bounds of the coordinates."""
    ends = np.stack([problem.least, problem.most])
    for k, name in enumerate(problem.names if isinstance(over, Mapping) else ()):
        argument, value, (low, high) = f"over[{name!r}]", problem.start[k], ends[:, k]
        given = [check.number(argument, n) for n in check.items(argument, over[name], 2, "numbers (least, most)")]
        if not (low <= given[0] <= value <= given[1] <= high and given[0] < given[1]):
            raise ValueError(
                f"{argument} must be (least, most) from {low:g} to {high:g} around {value:g}, got {tuple(given)}"
            )
        ends[:, k] = given
    far = np.where(problem.logarithmic, math.log(_WIDEST), _WIDEST)
    low, high = np.clip(problem.coordinates(ends), -far, far)
    return low, high


def _judged(problem: _Problem, found: Any, sigma: float | None, least: float) -> tuple[float, float, float, str]:
    """Chi-square per degree of freedom, correlation of neighbouring residuals, sigma, and why residuals are no noise."""
    count = int(problem.measured.sum())
    free = count - len(problem.names)
    whole = np.full(problem.measured.shape, np.nan)
    whole[problem.measured] = found.fun[:count]
    pairs = whole[1:] * whole[:-1]
    number = int(np.isfinite(pairs).sum())
    correlation = float(np.nansum(pairs) / number / max(np.nanmean(whole**2), 1e-300)) if number else math.nan
    if sigma is not None:
        chi = 2 * float(found.cost) / free
        bad = chi > 1 + _SIGMAS * math.sqrt(2 / free)
        return chi, correlation, sigma, f"chi-square is {chi:.3g} per degree of freedom" if bad else ""
    noise = found.unit * math.sqrt(2 * float(found.cost) / free)
    bad = noise > 10 * least and correlation > max(_CORRELATED, _SIGMAS / math.sqrt(max(number, 1)))
    reason = f"residuals at neighbouring times have a correlation of {correlation:.2f}" if bad else ""
    return math.nan, correlation, max(noise, least), reason


def _determined(
    jacobian: Floats, ended: list[str], u: Floats, bounds: tuple[Floats, Floats]
) -> tuple[Floats, float, list[str]]:
    """Covariance of the coordinates, condition of the scaled Jacobian, and why a parameter is not determined."""
    lengths = np.linalg.norm(jacobian, axis=0)
    used = lengths > 0
    scaled = jacobian / np.where(used, lengths, 1.0)
    _, singular, right = np.linalg.svd(scaled, full_matrices=False)
    condition = float(singular[0] / singular[-1]) if singular[-1] > 0 else math.inf
    kept = singular > _SINGULAR * singular[0]
    inverse = right[kept].T / singular[kept] ** 2 @ right[kept] if kept.any() else np.zeros((len(u), len(u)))
    safe = np.where(used, lengths, np.inf)
    covariance = inverse / np.outer(safe, safe)
    lost = np.abs(right[~kept] / safe)
    vague = (lost > _PART * lost.max(axis=1, keepdims=True)).any(axis=0)
    near_bound = np.minimum(u - bounds[0], bounds[1] - u) <= _EDGE
    reasons = list(ended)
    for k, error in enumerate(np.sqrt(np.diag(covariance))):
        why = {
            "has no effect on what was measured": not used[k],
            f"only combinations are determined: the condition of the scaled Jacobian is {condition:.1e}": vague[k],
            "ends at its bound": near_bound[k],
            f"its error would be {error:.1g} times its value or scale": error > 1,
        }
        reasons[k] = reasons[k] or next((reason for reason, holds in why.items() if holds), "")
    return covariance, condition, reasons
