"""A hard case: a scene, the settings of its run, and bounds on its final state."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

import clothsim as cs
from clothsim.typing import Precision

from ..base import check

PRECISIONS: tuple[Precision, ...] = get_args(Precision)

Floats = npt.NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Figure:
    """One measured figure and its accepted range.

    Attributes
    ----------
    name : str
    value, low, high : float
        Expected is low <= value <= high.
    """

    name: str
    value: float
    low: float
    high: float

    @property
    def passed(self) -> bool:
        return bool(self.low <= self.value <= self.high)


@dataclass(frozen=True)
class End:
    """How a run ended: the state (the last good one after an error), and the error if there was one."""

    x: Floats
    v: Floats
    error: cs.UnstableError | None
    precision: Precision
    stepper: cs.Stepper


@dataclass(frozen=True)
class HardCaseResult:
    """Result of `HardCase.run`.

    Attributes
    ----------
    figures : tuple of Figure
    passed : bool
        Whether all of them are as expected.
    """

    figures: tuple[Figure, ...]

    @property
    def passed(self) -> bool:
        return all(figure.passed for figure in self.figures)


Judge = Callable[["HardCase", End], "list[Figure]"]


@dataclass(frozen=True)
class HardCase:
    """A scene that is difficult for the method or the arithmetic, with the checks of its final state.

    Attributes
    ----------
    scene : Scene
    dt : float
        Time step [s].
    steps : int
        Number of steps.
    why : str
        The difficulty.
    precisions : tuple of str
        Precisions that the case is meant for.
    unstable : bool
        Whether an `UnstableError` is the expected outcome.
    """

    scene: cs.Scene
    dt: float
    steps: int
    why: str
    judges: tuple[Judge, ...] = field(repr=False)
    precisions: tuple[Precision, ...] = PRECISIONS
    unstable: bool = False

    def run(self, precision: Precision = "double", **options: Any) -> HardCaseResult:
        """Run the case and measure its figures.

        Parameters
        ----------
        precision : {"double", "single"}, default "double"
            One of `precisions`.
        **options
            Others of `Stepper`: kernel, threads.

        Examples
        --------
        >>> import clothsim as cs
        >>> result = cs.scenes.hard_cases()["a point at the exact centre"].run()
        >>> result.passed
        True
        >>> print(result.figures[1].name, result.figures[1].high)
        m from above the centre 1e-12
        """
        check.choice("precision", precision, self.precisions)
        stepper = cs.Stepper(self.scene, precision=precision, **{"threads": 1, **options})
        error = None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", cs.StabilityWarning)
            try:
                stepper.advance(self.steps, self.dt)
            except cs.UnstableError as raised:
                error = raised
        end = End(stepper.positions, stepper.velocities, error, precision, stepper)
        figures = [Figure("UnstableError", float(error is not None), self.unstable, self.unstable)]
        for judge in self.judges:
            figures += judge(self, end)
        return HardCaseResult(tuple(figures))


def within(
    name: str, measure: Callable[[HardCase, End], Any], double: float, single: float | None = None, low: float = 0.0
) -> Judge:
    """A judge of one figure, at most `double` or, in single, `single`."""
    high = {"double": double, "single": double if single is None else single}
    return lambda case, end: [Figure(name, float(measure(case, end)), low, high[end.precision])]


def moves_like_the_reference(double: float, single: float) -> Judge:
    """Largest distance to the scalar reference in double, over the largest distance moved."""

    def error(case: HardCase, end: End) -> Any:
        start = case.scene.initial_position
        expected, _ = cs.reference_step(case.scene, start, case.scene.initial_velocity, case.dt, case.steps, t=0.0)
        moved = np.abs(expected - start).max()
        return np.abs(end.x - expected).max() / moved if moved > 0 else np.abs(end.x - start).max()

    return within("error / distance moved", error, double, single)


def ends_at(place: Callable[[HardCase], Floats], name: str, double: float, single: float) -> Judge:
    """Largest distance [m] to known positions."""
    return within(name, lambda case, end: np.abs(end.x - place(case)).max(), double, single)


def gains_energy(double: float, single: float, loss: float = np.inf) -> Judge:
    """Total energy at the end less that at the start, over the larger kinetic + elastic energy."""

    def gain(case: HardCase, end: End) -> Any:
        scene = case.scene
        first = cs.energy(scene, scene.initial_position, scene.initial_velocity)
        last = cs.energy(scene, end.x, end.v)
        scale = max(e["kinetic"] + e["elastic"] for e in (first, last))
        return (last["total"] - first["total"]) / scale if scale > 0 else 0.0

    return within("energy gained / energy", gain, double, single, -loss)


def blows_up(within: int) -> Judge:
    """A judge that expects a `UnstableError` with all its attributes within `within` steps."""

    def judge(case: HardCase, end: End) -> list[Figure]:
        error = end.error
        if error is None:
            return []
        assert error.x is not None and error.v is not None
        reported = error.dt == case.dt and error.max_stable_dt is not None and error.max_stable_dt < case.dt
        finite = np.isfinite(error.x).all() and np.isfinite(error.v).all() and np.array_equal(error.x, end.x)
        return [
            Figure("at step", error.step, 1, within),
            Figure("names point, limit, last good state", float(reported and finite and error.point is not None), 1, 1),
            Figure("size of the last good state [m]", float(np.abs(error.x).max()), 0, 2.0),
        ]

    return judge


NO_GRAVITY = (0.0, 0.0, 0.0)


def sheet(shape: tuple[int, int] = (8, 8), **changes: Any) -> cs.Cloth:
    """Half a kilogram a point, undamped, pinned at two corners, unless `changes` say otherwise."""
    mass = 0.5 * shape[0] * shape[1]
    arguments: dict[str, Any] = {"shape": shape, "mass": mass, "damping": 0.0, **changes}
    return cs.Cloth(**arguments)


def noise(cloth: cs.Cloth, size: float) -> Floats:
    """Random displacements of the free points [m]."""
    displacements = np.random.default_rng(0).normal(scale=size, size=(*cloth.shape, 3))
    return displacements * ~cloth.pinned[..., None]
