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
from ..base.record import EqualByValue
from ..base.table import aligned
from ..model.scene import Scene
from ..run.result import Run
from ..run.simulate import simulate
from .sensitivity import Changes, Clock, Parameter, changed, changes, checked_times, difference, parameters_of, positions_of
from .work_plot import draw_fit

_FEWEST = 4  # times of the first stage
_PRIOR = 3.0  # width of the prior, in logarithms or scales
_WIDEST = 1e3  # factor, or scales, that a parameter without bounds may move
_STARTS = 8  # further starts where a minimum does not explain the data
_SINGULAR = 1e-5  # singular value over the largest, of columns of length 1: below, the data cannot tell parameters apart
_PART = 1e-2  # of a parameter in a direction that is not determined
_SIGMAS = 5.0  # from which on a chi-square, or a correlation of residuals, is no chance
_CORRELATED = 0.2  # of residuals at neighbouring times


@dataclass(frozen=True, eq=False, repr=False)
class Fit(EqualByValue):
    """Parameters that were fitted to a motion, the result of `fit`.

    Attributes
    ----------
    values, errors : dict
        Parameters by name and their standard deviations; NaN where the data does not determine them, with a reason in
        ``report["reasons"]``.
    covariance : numpy.ndarray
        Covariance of the values, in their order; NaN as above.
    residuals : numpy.ndarray
        Measured less fitted positions [m], of the shape of the data; NaN where nothing was measured.
    scene : Scene
        The scene at the minimum. Parameters that are not determined have a value there that fits as well as others do.
    run : Run
        Its run, with frames at the times of the data.
    report : dict
        "reason": "", or why errors have no meaning; "reasons" by parameter; "sigma" [m], as given or estimated;
        "chi_square" per degree of freedom (NaN if sigma is estimated); "correlation" of residuals at neighbouring times;
        "condition" of the Jacobian with columns of length 1; "evaluations", "jacobians", "starts", "wall_time" [s].

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
    positions: Floats  # as measured
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

        Raises
        ------
        ImportError
            Without matplotlib, naming the extra that brings it.

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
        self.start, self.scales, self.least = np.array([(one.value, one.scale, one.least) for one in parameters]).T
        self.logarithmic = (self.least == 0) & (self.start > 0)
        self.size = max(scene.cloth.size)
        self.evaluations = self.jacobians = 0

    def values(self, u: Floats) -> Floats:
        values: Floats = np.where(self.logarithmic, self.start * np.exp(u * self.logarithmic), self.start + u * self.scales)
        return values

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
            edge = 1e-6 * (bounds[1] - bounds[0])
            start = np.clip(u, bounds[0] + edge, bounds[1] - edge)
            found = least_squares(
                residuals, start, jacobian, bounds, max_nfev=20 if held else 60, args=(u, clock, held, count), **digits
            )
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
        sigma = check.number("sigma", sigma, minimum=0, exclusive=True)
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
            u, starts = random.uniform(-math.log(10), math.log(10), len(names)), starts + 1
        scene, parameters = problem.at(best.x)
        clock = Clock(scene, times)
        clock.refine(scene, rtol)
        derivatives = changes(scene, parameters, clock)
        run = simulate(scene, float(times[-1]), rtol=rtol, times=times)
    jacobian = problem.columns(derivatives.change, parameters, best.x) / noise
    covariance, condition, reasons = _determined(jacobian, derivatives, best.x, bounds, names)
    slopes = problem.slopes(best.x)
    values = np.where([bool(reason) for reason in reasons], np.nan, problem.values(best.x))
    covariance = covariance * np.outer(slopes, slopes) + 0 * np.add.outer(values, values)
    told = [
        f"{', '.join(n for n, r in zip(names, reasons) if r == one)}: {one}" for one in dict.fromkeys(filter(None, reasons))
    ]
    if any(derivatives.reasons):
        told = [f"{next(filter(None, derivatives.reasons))}: give only the times before"]
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


def _checked_data(scene: Scene, times: Floats, values: Any, points: Any) -> tuple[Floats, tuple[Any, Any]]:
    """Measured positions, and the rows and columns of their points."""
    rows, columns = scene.cloth.shape
    if points is None:
        place = tuple(np.indices((rows, columns)))
    else:
        check.size("points", points, "a sequence of (row, column)")
        pairs = [check.items(f"points[{k}]", pair, 2, "integers (row, column)") for k, pair in enumerate(points)]
        for k, pair in enumerate(pairs):
            for n, m in zip(pair, (rows, columns)):
                check.integer(f"points[{k}]", n, minimum=-m, maximum=m - 1)
        place = tuple(np.array(pairs, dtype=int).reshape(-1, 2).T % [[rows], [columns]])
        if len({*zip(*place)}) < len(pairs):
            raise ValueError(f"points must name each point once, got {list(points)}")
    shape = (len(times), *place[0].shape, 3)
    accepted = f"an array of shape {shape} of numbers, NaN where nothing was measured"
    given = check.as_array("positions", values, accepted)
    if given.dtype.kind not in "iuf":
        raise TypeError(f"positions must be {accepted}, got {check.shown(given)}")
    if given.shape != shape:
        raise ValueError(f"positions must be {accepted}, got shape {given.shape}")
    given = given.astype(np.float64)
    check.check_all("positions", given, ~np.isinf(given), accepted)
    return given, (place[0], place[1])


def _bounds(over: Any, problem: _Problem) -> tuple[Floats, Floats]:
    """Bounds of the coordinates."""
    high = np.where(problem.logarithmic, math.log(_WIDEST), _WIDEST)
    low = np.where((problem.least == 0) & ~problem.logarithmic, 0.0, -high)  # a positive parameter that starts at 0
    for k, (name, value, least) in enumerate(zip(problem.names, problem.start, problem.least)):
        if isinstance(over, Mapping):
            argument = f"over[{name!r}]"
            given = [check.number(argument, n) for n in check.items(argument, over[name], 2, "numbers (least, most)")]
            if not (least <= given[0] <= value <= given[1] and given[0] < given[1]):
                no_less = " and least >= 0" if least == 0 else ""
                raise ValueError(
                    f"{argument} must be (least, most) around the scene's {value:g}{no_less}, got {tuple(given)}"
                )
            ends = np.log(np.maximum(given, 1e-300) / value) if problem.logarithmic[k] else np.array(given) - value
            low[k], high[k] = ends if problem.logarithmic[k] else ends / problem.scales[k]
    return low, high


def _judged(problem: _Problem, found: Any, sigma: float | None, least: float) -> tuple[float, float, float, str]:
    """Chi-square per degree of freedom, correlation of neighbouring residuals, sigma, and why residuals are no noise."""
    count = int(problem.measured.sum())
    free = count - len(problem.names)
    whole = np.full(problem.measured.shape, np.nan)
    whole[problem.measured] = found.fun[:count]
    pairs = whole[1:] * whole[:-1]
    number = max(int(np.isfinite(pairs).sum()), 1)
    correlation = float(np.nansum(pairs) / number / max(np.nanmean(whole**2), 1e-300))
    if sigma is not None:
        chi = 2 * float(found.cost) / free
        bad = chi > 1 + _SIGMAS * math.sqrt(2 / free)
        return chi, correlation, sigma, f"chi-square is {chi:.3g} per degree of freedom" if bad else ""
    noise = found.unit * math.sqrt(2 * float(found.cost) / free)
    bad = noise > 10 * least and correlation > max(_CORRELATED, _SIGMAS / math.sqrt(number))
    reason = f"residuals at neighbouring times have a correlation of {correlation:.2f}" if bad else ""
    return math.nan, correlation, max(noise, least), reason


def _determined(
    jacobian: Floats, found: Changes, u: Floats, bounds: tuple[Floats, Floats], names: list[str]
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
    reasons = []
    for k in range(len(u)):
        error = math.sqrt(covariance[k, k])
        if found.reasons[k]:
            reasons.append(found.reasons[k])
        elif not used[k]:
            reasons.append("has no effect on what was measured")
        elif vague[k]:
            reasons.append(f"only combinations are determined: the condition of the scaled Jacobian is {condition:.1e}")
        elif min(u[k] - bounds[0][k], bounds[1][k] - u[k]) <= 1e-4 * (bounds[1][k] - bounds[0][k]):
            reasons.append("ends at its bound")
        elif error > 1:
            reasons.append(f"its error would be {error:.1g} times its value or scale")
        else:
            reasons.append("")
    return covariance, condition, reasons
