"""The search for the parameters that explain a measured motion best.

Least squares run over the logarithms of positive parameters. A start that is far off gives a motion
that is out of phase with the data, where least squares finds a wrong minimum. So the first times
are fitted first, and then twice as many, until all are. While few times are fitted, each parameter
stays near its start by a weak prior. A wrong minimum may look like the right one where no sigma
tells how well data can be explained, so several starts are compared; the aliases of an oscillation,
which fit as well as it does, are starts too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..base import Floats, check
from ..base.extras import import_from_extra
from ..base.progress import ProgressBar
from ..methods.bound import stable_dt
from ..model.scene import Scene
from ..run.simulate import simulate
from ..typing import Force
from .parameters import Parameter, parameters_of, scene_with_values
from .residuals import EDGE, LARGE, quality_and_misfit
from .sensitivity import Schedule, compute_derivatives
from .solution import METHOD

_LEAST_TIMES = 4  # number of times of the first stage
_PRIOR = 3.0  # width of the prior, in logarithms or scales
_WIDEST = 1e3  # factor, or scales, that a parameter without bounds may move
_STARTS = 8  # most further starts where a minimum does not explain the data
# There are so many further starts where no sigma tells whether a minimum explains the data. One
# start in eight ends in another minimum.
_STARTS_WITHOUT_SIGMA = 4
_REACH = math.log(10)  # largest change of a logarithm to a further start or an alias
_MOST_RUNS = 60  # most evaluations of the residuals of all times
_MOST_RUNS_OF_STAGE = 20  # most evaluations of the residuals of the first times
_UNIT = 1e-3  # unit of the residuals over the motion, rms, where sigma is not given
# The data is in another unit if these factors bring it ten times nearer to the motion in metres.
_UNITS = {"millimetres": 1000.0, "centimetres": 100.0, "inches": 39.37, "feet": 3.281}
_GAIN = 10.0
_MISFIT = 4.0  # least chi-square per number of the first times that asks for a shift of the times
_TIMES_OF_SHIFT = 8  # number of the times that tell a shift
_MOST_TURNS = 3  # most turns between two times of an alias
_LEAST_FRAMES = 64  # least number of frames of a spectrum
_MOST_FRAMES = 4096  # largest number of frames of a spectrum


class SearchOutcome(NamedTuple):
    """The result of a search."""

    minima: list[Any]  # result of scipy.optimize.least_squares for each start
    quality: dict[str, float]  # quality of the best
    misfit: str  # reason why its residuals are not noise, or ""
    shift: float = 0.0  # s, which the times need

    @property
    def best_minimum(self) -> Any:
        return min(self.minima, key=lambda minimum: minimum.cost)


class FitProblem:
    """Residuals and their Jacobian, as functions of coordinates that are 0 at the start.

    A coordinate is the logarithm of a positive parameter over its start, else its change over its
    scale.
    """

    def __init__(
        self,
        scene: Scene,
        over: Any,
        times: Floats,
        data: Floats,
        mask: Any,
        sigma: float | None,
        rtol: float,
        force: Force | None,
    ) -> None:
        self.least_squares = import_from_extra("scipy.optimize", "fit", "fit").least_squares
        self.scene = scene
        self.times = times
        self.data = data  # m, shape (times, rows, columns, 3)
        self.mask = mask  # the same shape; True where a number counts
        self.sigma = sigma
        self.rtol = rtol
        self.force = force
        self.parameters = parameters_of(scene, over, "over")
        self.names = [parameter.name for parameter in self.parameters]
        self.start = np.array([parameter.value for parameter in self.parameters])
        self.scales = np.array([parameter.scale for parameter in self.parameters])
        ends = np.array([(parameter.least, parameter.most) for parameter in self.parameters]).T
        self.logarithmic = (ends[0] == 0) & (self.start > 0)
        self.bounds = self._coordinate_bounds(over, ends)
        self.least = rtol * max(scene.cloth.size)  # m, the least residual that has a meaning
        self.way = float(np.sqrt(np.mean((data - scene.initial_position)[mask] ** 2)))  # m
        self.unit = sigma or max(_UNIT * self.way, self.least)  # m
        self.evaluations = 0
        self.jacobians = 0

    def parameter_values(self, u: Floats) -> Floats:
        """Return the parameters at the coordinates `u`."""
        values: Floats = np.where(
            self.logarithmic,
            self.start * np.exp(u * self.logarithmic),
            self.start + u * self.scales,
        )
        return values

    def derivatives_of_values(self, u: Floats) -> Floats:
        """Return derivatives of the values by the coordinates."""
        slopes: Floats = np.where(self.logarithmic, self.parameter_values(u), self.scales)
        return slopes

    def _coordinate_bounds(self, over: Any, ends: Floats) -> Floats:
        """Return the least and largest coordinates, shape (2, parameters)."""
        for k, name in enumerate(self.names if isinstance(over, Mapping) else ()):
            argument = f"over[{name!r}]"
            value = self.start[k]
            pair = check.list_of_items(argument, over[name], 2, "numbers (least, most)")
            least, most = (check.number(argument, number) for number in pair)
            if not (ends[0, k] <= least <= value <= most <= ends[1, k] and least < most):
                low, high = ends[:, k]
                requirement = f"(least, most) from {low:g} to {high:g} around {value:g}"
                raise ValueError(f"{argument} must be {requirement}, got {(least, most)}")
            ends[:, k] = least, most
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.where(
                self.logarithmic, np.log(ends / self.start), (ends - self.start) / self.scales
            )
        reach = np.where(self.logarithmic, math.log(_WIDEST), _WIDEST)
        return np.asarray(np.clip(u, -reach, reach))

    def scene_at(self, u: Floats) -> Scene:
        """Return the scene with the parameters at the coordinates `u`."""
        return scene_with_values(self.scene, self.parameters, self.parameter_values(u))

    def make_schedule(self, scene: Scene, times: Floats) -> Schedule:
        """Return the steps of all runs near the scene, up to the last of the times."""
        return Schedule(scene, times, self.rtol, self.force)

    def jacobian_columns(
        self, change: Floats, parameters: Sequence[Parameter], u: Floats
    ) -> Floats:
        """Return changes per scale of each parameter as columns of a Jacobian [m per coordinate].

        They are 0 where a run failed.
        """
        slopes = self.derivatives_of_values(u) / [parameter.scale for parameter in parameters]
        return np.nan_to_num(change[:, self.mask[: change.shape[1]]].T * slopes)

    def search_minima(self, bar: ProgressBar) -> SearchOutcome:
        """Return the minima of all starts, and the quality of the best.

        The bar counts the time up to which each start is fitted.
        """
        end = float(self.times[-1])
        random = np.random.default_rng(0)
        minima: list[Any] = []

        def judge_minima(shift: float = 0.0) -> SearchOutcome:
            best = min(minima, key=lambda minimum: minimum.cost)
            quality, misfit = quality_and_misfit(
                best, self.mask, len(self.names), self.sigma, self.unit, self.least, self.way
            )
            return SearchOutcome(minima, quality, misfit, shift)

        u = np.zeros(len(self.names))
        first_minimum = self._find_minimum(
            u, self.make_schedule(self.scene, self.times[:_LEAST_TIMES])
        )
        level = 1.0 if self.sigma else LARGE * self.way / self.unit
        if 2 * first_minimum.cost > _MISFIT * first_minimum.fun.size * level**2:
            shift = self._time_shift_in_seconds()
            if shift:
                schedule = self.make_schedule(self.scene_at(first_minimum.x), self.times)
                minima.append(self._find_minimum(first_minimum.x, schedule, most_runs=1))
                bar.advance(end)
                return judge_minima(shift)
        while True:
            minima.append(self._find_minimum_in_stages(u, bar))
            result = judge_minima()
            restarts = len(minima) - 1
            needs_more = self.sigma is None and restarts < _STARTS_WITHOUT_SIGMA
            if restarts >= _STARTS or not (result.misfit or needs_more):
                break
            u = random.uniform(-_REACH, _REACH, len(self.names)) * self.logarithmic
            bar.expect_more(end)
        if result.misfit:
            return result
        for place in self._coordinates_of_frequency_aliases(result.best_minimum.x):
            bar.expect_more(end)
            minima.append(
                self._find_minimum(place, self.make_schedule(self.scene_at(place), self.times))
            )
            bar.advance(end)
        return judge_minima()

    def _find_minimum_in_stages(self, u: Floats, bar: ProgressBar) -> Any:
        """Return the minimum over all times that is found from `u` by way of the first times."""
        total = len(self.times)
        counts = [-(-total // 2**k) for k in range(int(math.log2(total)), 0, -1)]
        last_time = 0.0
        for count in [*(n for n in counts if n >= _LEAST_TIMES), total]:
            minimum = self._find_minimum(
                u, self.make_schedule(self.scene_at(u), self.times[:count])
            )
            u = minimum.x
            bar.advance(self.times[count - 1] - last_time)
            last_time = self.times[count - 1]
        return minimum

    def _find_minimum(self, middle: Floats, schedule: Schedule, most_runs: int = _MOST_RUNS) -> Any:
        """Return the minimum over the times of `schedule`.

        It is near `middle` unless these are all times.
        """
        n = len(schedule.times)
        data = self.data[:n]
        mask = self.mask[:n]
        is_stage = n < len(self.times)
        prior = is_stage / _PRIOR

        def residuals(u: Floats) -> Floats:
            self.evaluations += 1
            scene = self.scene_at(u)
            errors = (schedule.compute_positions([scene], schedule.step_counts(scene)).x[0] - data)[
                mask
            ]
            errors = np.nan_to_num(errors, nan=schedule.size)
            return np.append(errors / self.unit, (u - middle) * prior)

        def jacobian(u: Floats) -> Floats:
            self.jacobians += 1
            scene = self.scene_at(u)
            parameters = parameters_of(scene, self.names, "over")
            change = compute_derivatives(scene, parameters, schedule).change
            columns = self.jacobian_columns(change, parameters, u)
            return np.append(columns / self.unit, np.eye(len(u)) * prior, axis=0)

        start = np.clip(middle, self.bounds[0] + EDGE / 2, self.bounds[1] - EDGE / 2)
        digits = dict.fromkeys(("ftol", "xtol", "gtol"), 1e-4 if is_stage else 1e-10)
        runs = min(most_runs, _MOST_RUNS_OF_STAGE) if is_stage else most_runs
        return self.least_squares(
            residuals, start, jacobian, (*self.bounds,), max_nfev=runs, **digits
        )

    def check_unit_of_length(self) -> None:
        """Refuse positions that are near the motion of the start in another unit alone."""
        distance = self._rms_distance_from_start(1.0)
        for unit, factor in _UNITS.items():
            if _GAIN * self._rms_distance_from_start(factor) < distance:
                raise ValueError(
                    f"positions must be in metres, got numbers that look like {unit}: "
                    f"divide them by {factor:g}"
                )

    def _rms_distance_from_start(self, factor: float) -> float:
        """Return the distance of the data over `factor` from the motion of the start [m], rms."""
        schedule = self.make_schedule(self.scene, self.times[:_LEAST_TIMES])
        x = schedule.compute_positions([self.scene], schedule.step_counts(self.scene)).x[0]
        n = len(schedule.times)
        return float(np.sqrt(np.nanmean((self.data[:n] / factor - x)[self.mask[:n]] ** 2)))

    def _time_shift_in_seconds(self) -> float:
        """Return what has to be added to the times [s] so that the first of them can be explained.

        It is 0 if a shift does not explain them ten times better.
        """
        shape = self.scene.cloth.shape
        size = max(self.scene.cloth.size)
        first_times = self.times[:_TIMES_OF_SHIFT]
        data = self.data[: len(first_times)]
        mask = self.mask[: len(first_times)]
        unit = float(np.diff(self.times, prepend=0.0).max())
        reach = _REACH * self.logarithmic + ~self.logarithmic

        def residuals(values: Floats, scale: float = 1.0) -> Floats:
            scene = self.scene_at(values[:-1])
            shift = scale * unit * float(values[-1])
            times = np.maximum(first_times + shift, 0.0)
            positive_times, places = np.unique(times[times > 0], return_inverse=True)
            x = np.broadcast_to(scene.initial_position, (len(first_times), *shape, 3)).copy()
            if positive_times.size:
                schedule = self.make_schedule(scene, positive_times)
                x[times > 0] = schedule.compute_positions([scene], schedule.step_counts(scene)).x[
                    0
                ][places]
            errors = np.nan_to_num((x - data)[mask], nan=size)
            return np.append(errors, 1e-3 * self.least * values)

        start = np.zeros(len(self.names) + 1)
        ends = np.append(reach, _TIMES_OF_SHIFT / 2.0)
        options = {"diff_step": 1e-4, "max_nfev": 20, "bounds": (-ends, ends), "x_scale": ends}
        with_shift = self.least_squares(residuals, start, **options)
        without_shift = self.least_squares(residuals, start, args=(0.0,), **options)
        is_better = without_shift.cost > _GAIN**2 * with_shift.cost
        return unit * float(with_shift.x[-1]) if is_better else 0.0

    def _coordinates_of_frequency_aliases(self, u: Floats) -> list[Floats]:
        """Return coordinates whose motion has an alias of the main frequency at the times.

        An alias turns as often, and a whole number of turns more or less between two times.
        """
        is_stiffness = np.array([p.field.startswith("stiffness") for p in self.parameters])
        is_mass = np.array([p.field == "mass" for p in self.parameters])
        direction = 1.0 * is_stiffness - is_mass
        interval = float(np.median(np.diff(self.times))) if len(self.times) > 1 else 0.0
        if not direction.any() or interval <= 0:
            return []
        frequency = self._main_frequency_in_hertz(u)
        least, most = self.bounds
        places = []
        for turns in range(1, _MOST_TURNS + 1):
            for alias in (turns / interval - frequency, turns / interval + frequency):
                if frequency <= 0 or alias <= 0:
                    continue
                place = u + 2 * math.log(alias / frequency) * direction * self.logarithmic
                inside = (np.abs(place) <= _REACH) & (least <= place) & (place <= most)
                if inside[direction != 0].all():
                    places.append(place)
        return places

    def _main_frequency_in_hertz(self, u: Floats) -> float:
        """Return the frequency [Hz] at which most of the measured points' motion is."""
        scene = self.scene_at(u)
        end = float(self.times[-1])
        longest = stable_dt(scene, METHOD)
        count = int(min(max(2 * end / longest, _LEAST_FRAMES), _MOST_FRAMES))
        moments = np.linspace(0, end, count + 1)[1:]
        run = simulate(scene, end, rtol=1e-3, times=moments, force=self.force)
        x = run.x[1:, self.mask.any(axis=0)]
        spectrum = np.abs(np.fft.rfft(x - x.mean(axis=0), axis=0)) ** 2
        weights = spectrum.sum(axis=1)
        peak = int(weights[1:].argmax()) + 1
        neighbours = slice(peak - 1, peak + 2)
        frequencies = np.fft.rfftfreq(count, end / count)[neighbours]
        return float((frequencies * weights[neighbours]).sum() / weights[neighbours].sum())
