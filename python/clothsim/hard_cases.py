"""Scenes that strain the method or the arithmetic, each with the settings of its run and bounds on
its final state.

Bounds are about five to twenty times the measured figures, which docs/stability.md lists.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

import clothsim as cs
from clothsim.typing import Precision

from .base import Floats, check

__all__ = ["Figure", "HardCase", "HardCaseResult", "hard_cases"]


@dataclass(frozen=True)
class Figure:
    """One measured figure: expected is low <= value <= high."""

    name: str
    value: float
    low: float
    high: float

    @property
    def passed(self) -> bool:
        return bool(self.low <= self.value <= self.high)


@dataclass(frozen=True)
class End:
    """How a run ended: the state (the last good one after an error), and the error, if any."""

    x: Floats
    v: Floats
    error: cs.UnstableError | None
    precision: Precision
    kernel: str


@dataclass(frozen=True)
class HardCaseResult:
    """Result of `HardCase.run`; it has passed if all figures have."""

    figures: tuple[Figure, ...]

    @property
    def passed(self) -> bool:
        return all(figure.passed for figure in self.figures)


Judge = Callable[["HardCase", End], "list[Figure]"]


@dataclass(frozen=True)
class HardCase:
    """A scene that is difficult for the method or the arithmetic, with the checks of its final
    state.

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
    precisions: tuple[Precision, ...] = ("double", "single")
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
        end = End(
            stepper.positions, stepper.velocities, error, precision, options.get("kernel", "auto")
        )
        figures = [Figure("UnstableError", float(error is not None), self.unstable, self.unstable)]
        for judge in self.judges:
            figures += judge(self, end)
        return HardCaseResult(tuple(figures))


def within(
    name: str,
    measure: Callable[[HardCase, End], Any],
    double: float,
    single: float | None = None,
    low: float = 0.0,
) -> Judge:
    """A judge of one figure, at most `double` or, in single, `single`."""
    high = {"double": double, "single": double if single is None else single}
    return lambda case, end: [Figure(name, float(measure(case, end)), low, high[end.precision])]


def moves_like_the_reference(double: float, single: float) -> Judge:
    """Largest distance to the scalar reference in double, over the largest distance moved."""

    def error(case: HardCase, end: End) -> Any:
        start = case.scene.initial_position
        expected, _ = cs.reference_step(
            case.scene, start, case.scene.initial_velocity, case.dt, case.steps, t=0.0
        )
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
        reported = (
            error.dt == case.dt
            and error.max_stable_dt is not None
            and error.max_stable_dt < case.dt
        )
        finite = (
            np.isfinite(error.x).all()
            and np.isfinite(error.v).all()
            and np.array_equal(error.x, end.x)
        )
        return [
            Figure("at step", error.step, 1, within),
            Figure(
                "names point, limit, last good state",
                float(reported and finite and error.point is not None),
                1,
                1,
            ),
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


def stiffness() -> dict[str, HardCase]:
    """Springs of 1e6 to 1e12 N/m, and of 1e7 beside 1 N/m."""
    cases = {}
    for k, double, single in ((1e6, 3e-13, 1e-4), (1e9, 3e-11, 1e-2), (1e12, 1e-11, 1e-2)):
        cloth = sheet(stiffness=k, damping=1e-3 * k**0.5)
        scene = cs.Scene(cloth, position=cloth.rest_positions + noise(cloth, 1e-3))
        cases[f"stiffness {k:.0e} N/m".replace("e+", "e")] = HardCase(
            scene,
            0.9 * cs.max_stable_dt(scene),
            1000,
            "waves of a thousand to a million Hz beside gravity",
            (moves_like_the_reference(double, single), gains_energy(0.0, 0.0)),
        )
    for strong in ("structural", "shear"):
        families = {f: 1e7 if f == strong else 1.0 for f in ("structural", "shear", "bend")}
        scene = cs.Scene(sheet(stiffness=families))
        cases[f"{strong} springs of 1e7 beside 1 N/m"] = HardCase(
            scene,
            0.9 * cs.max_stable_dt(scene),
            2000,
            "one family is 10 million times stiffer than the others",
            (moves_like_the_reference(1e-13, 1e-5), gains_energy(1e-7, 1e-5, 1e-5)),
        )
    return cases


@cache  # eigenvalues of a dense matrix take a second
def time_steps() -> dict[str, HardCase]:
    """Right below and right above the limit, very small steps, very many steps."""
    cloth = sheet(stiffness=900.0)
    scene = cs.Scene(cloth, gravity=NO_GRAVITY, velocity=noise(cloth, 1e-5))
    limit = cs.max_stable_dt(scene, x=cloth.rest_positions) / 0.97  # which is 3 % below the limit
    return {
        "dt at 0.95 of the limit": HardCase(
            scene,
            0.95 * limit,
            4000,
            "every wave turns by almost half a turn a step",
            (gains_energy(1e-12, 1e-5),),
        ),
        "dt at 1.05 of the limit": HardCase(
            scene,
            1.05 * limit,
            4000,
            "the fastest wave grows by two fifths a step",
            (blows_up(within=300),),
            unstable=True,
        ),
        "dt 5e-6 s in single": HardCase(
            cs.Scene(sheet((12, 12), damping=100.0)),
            5e-6,
            50_000,
            "a step moves a point by less than float32 can tell",
            (_ends_like_double(1e-7),),
            precisions=("single",),
        ),
        "a million steps": HardCase(
            drum((4, 4), damping=0.0),
            5e-6,
            1_000_000,
            "rounding adds up",
            (gains_energy(1e-11, 2e-5, 2e-5),),
        ),
        "a million steps in single": HardCase(
            drum((4, 4)),
            5e-6,
            1_000_000,
            "rounding adds up, in float32 at steps that float32 alone could not take",
            (_ends_like_double(2e-7),),
            precisions=("single",),
        ),
    }


def drum(shape: tuple[int, int], damping: float = 100.0) -> cs.Scene:
    """A cloth with the paper's springs and masses, stretched by a tenth and pinned along its
    border.

    It swings in gravity without folding, so that rounding is not amplified: two computations of it
    can be compared after any time.
    """
    clamped = np.ones(shape, bool)
    clamped[1:-1, 1:-1] = False
    cloth = sheet(shape, pins=clamped, damping=damping)
    return cs.Scene(cloth, position=1.1 * cloth.rest_positions)


def _ends_like_double(bound: float) -> Judge:
    def error(case: HardCase, end: End) -> Any:
        start = case.scene.initial_position, case.scene.initial_velocity
        other: Precision = "double" if end.precision == "single" else "single"
        options: dict[str, Any] = {"t": 0.0, "precision": other, "threads": 1, "kernel": end.kernel}
        expected, _ = cs.step(case.scene, *start, case.dt, case.steps, **options)
        return np.linalg.norm(end.x - expected, axis=-1).max()

    return within("m between single and double", error, bound)


def masses() -> dict[str, HardCase]:
    """One light or heavy point."""
    cases = {}
    for name, ratio in (("lighter", 1e-6), ("heavier", 1e6)):
        mass = np.ones((8, 8))
        mass[3, 4] = ratio
        scene = cs.Scene(sheet(mass=mass, stiffness=1000.0))
        cases[f"a point 1e6 times {name}"] = HardCase(
            scene,
            0.9 * cs.max_stable_dt(scene),
            2000,
            "one point is a thousand times faster or slower than the others",
            (moves_like_the_reference(2e-13, 1e-4), gains_energy(1e-12, 1e-6, 1e-7)),
        )
    return cases


def geometry() -> dict[str, HardCase]:
    """Coincident points, springs of zero length, narrow cloths, positions far from the origin."""
    tiny = sheet(size=(1e-300, 1e-300), stiffness=100.0, pins=())
    linear = cs.Scene(tiny, gravity=NO_GRAVITY, position=noise(tiny, 1.0))
    cloth = sheet(stiffness=1000.0, damping=1.0)
    coincident = cloth.rest_positions.copy()
    coincident[3, 3] = coincident[3, 4]
    at_once = np.full((8, 8, 3), 0.25)
    free = cloth.replace(pins=())
    undamped = sheet(stiffness=1000.0, pins=())
    noisy = cs.Scene(undamped, gravity=NO_GRAVITY, position=at_once + noise(undamped, 1e-9))
    collapsed = cs.Scene(cloth, position=at_once)
    fine = 0.005 * cs.max_stable_dt(noisy)
    half = 0.5 * cs.max_stable_dt(cs.Scene(cloth))
    here = cs.Scene(cloth, cs.Sphere((0.5, -0.4, 0.5), 0.25, offset="none", response="ray"))
    far = np.array([1e6, 1e6, 1e6])
    moved = here.spheres[0].replace(center=far + here.spheres[0].center)
    there = here.replace(spheres=moved, position=cloth.rest_positions + far)
    cases = {
        "zero rest length": HardCase(
            linear,
            0.02 * cs.max_stable_dt(linear),
            5000,
            "springs of 1e-300 m are linear in every direction, also through zero length",
            (
                ends_at(_normal_modes, "m from the normal modes", 1e-4, 1e-4),
                moves_like_the_reference(1e-11, 1e-3),
            ),
        ),
        "coincident points": HardCase(
            cs.Scene(cloth, position=coincident),
            half,
            500,
            "a spring without length has no direction",
            (moves_like_the_reference(1e-11, 1e-3), gains_energy(0.0, 0.0)),
        ),
        "collapsed cloth": HardCase(
            cs.Scene(free, position=at_once),
            1e-3,
            1000,
            "all points in one place: no spring has a direction",
            (ends_at(_fallen, "m from free fall", 1e-12, 1e-6),),
        ),
        "collapsed cloth with two pins": HardCase(
            collapsed,
            half,
            2000,
            "the fall parts points by rounding alone, and the springs drive them on",
            (gains_energy(0.0, 0.0),),
        ),
        "collapsed cloth with noise": HardCase(
            noisy,
            fine,
            8000,
            "points 1e-9 m apart whose springs want 0.14 m: directions turn in no time",
            (gains_energy(3e-5, 3e-5, 3e-5),),
        ),
        "1e6 m away": HardCase(
            there,
            5e-4,
            1000,
            "float32 tells points there apart by 6 cm",
            (ends_at(lambda case: _moved(here, case, far), "m from the motion here", 5e-8, 5e-6),),
        ),
    }
    for shape in ((1, 2), (1, 12), (12, 1), (2, 12)):
        scene = cs.Scene(sheet(shape, stiffness=1000.0, damping=1.0, pins=[(0, 0)]))
        cases["a strip of {} x {}".format(*shape)] = HardCase(
            scene,
            0.5 * cs.max_stable_dt(scene),
            400,
            "no cell, or one row of them; families without a spring",
            (moves_like_the_reference(5e-12, 5e-4),),
        )
    return cases


def _fallen(case: HardCase) -> Floats:
    t = case.steps * case.dt
    return case.scene.initial_position + np.array(case.scene.gravity) * t * t / 2


def _moved(here: cs.Scene, case: HardCase, by: Floats) -> Floats:
    start = here.initial_position, here.initial_velocity
    return cs.step(here, *start, case.dt, case.steps, t=0.0)[0] + by


def _normal_modes(case: HardCase) -> Floats:
    """x(t) = cos(sqrt(L) t) x(0), L the spring Laplacian per unit mass."""
    cloth = case.scene.cloth
    table = cloth.spring_table()
    laplacian = np.zeros((cloth.rows * cloth.columns,) * 2)
    for a, b, sign in (("i", "i", 1), ("j", "j", 1), ("i", "j", -1), ("j", "i", -1)):
        np.add.at(laplacian, (table[a], table[b]), sign * table["stiffness"])
    squares, modes = np.linalg.eigh(laplacian / cloth.mass_per_point[0, 0])
    phase = np.cos(np.sqrt(squares.clip(0)) * case.steps * case.dt)
    start = case.scene.initial_position.reshape(-1, 3)
    return np.reshape(modes @ (phase[:, None] * (modes.T @ start)), (*cloth.shape, 3))


def contact() -> dict[str, HardCase]:
    """Points and pins inside a sphere from the start, and a sphere that is faster than the test."""
    soft = sheet(stiffness=1000.0, damping=1.0)
    loose = sheet((2, 2), stiffness=0.0, pins=())
    inside, centre = loose.rest_positions + 10.0, loose.rest_positions + 10.0
    inside[0, 0], centre[0, 0] = (0.03, -0.04, 0.12), (0.0, 0.0, 0.0)
    unit = cs.Sphere((0.0, 0.0, 0.0), 0.5, offset="none", response="ray")
    at_pin = cs.Sphere((0.0, 0.0, 0.0), 0.3, offset="none", restitution=0.5, response="ray")
    in_sheet = cs.Sphere((0.5, 0.0, 0.5), 0.25, offset="none", restitution=0.5, response="ray")
    fast = cs.Sphere(
        (0.5, -2.0, 0.5), 0.25, cs.Linear((0.0, 100.0, 0.0)), offset="none", response="ray"
    )
    settled = 0.2 * cs.max_stable_dt(cs.Scene(soft))
    return {
        "pins inside a sphere": HardCase(
            cs.Scene(soft, at_pin),
            settled,
            1000,
            "what holds the cloth may not move, what hangs on it may not stay",
            (_PINS_STAY, _free_points_out(1e-12)),
        ),
        "a sphere that starts inside the cloth": HardCase(
            cs.Scene(soft, in_sheet),
            settled,
            1000,
            "points inside at rest have no ray to go back along",
            (_free_points_out(1e-12), _speeds(0.0, 10.0)),
        ),
        "a point at rest inside": HardCase(
            cs.Scene(loose, unit, NO_GRAVITY, position=inside),
            1e-3,
            1,
            "no velocity, so no ray",
            (
                ends_at(
                    lambda case: _only(case, (3 / 26, -4 / 26, 12 / 26)),
                    "m from the foot of the normal",
                    1e-15,
                    1e-7,
                ),
            ),
        ),
        "a point at the exact centre": HardCase(
            cs.Scene(loose, unit, NO_GRAVITY, position=centre),
            1e-3,
            1,
            "no velocity and no normal",
            (
                ends_at(
                    lambda case: _only(case, (0.0, 0.5, 0.0)),
                    "m from above the centre",
                    1e-12,
                    1e-7,
                ),
            ),
        ),
        "a sphere at 100 m/s": HardCase(
            cs.Scene(soft, fast, NO_GRAVITY),
            1e-4,
            180,
            "it moves by 1 cm a step and is through the sheet in 50",
            (moves_like_the_reference(1e-13, 1e-5), _speeds(150.0, 201.0), _free_points_out(0.0)),
        ),
    }


def _only(case: HardCase, place: tuple[float, float, float]) -> Floats:
    expected = case.scene.initial_position.copy()
    expected[0, 0] = place
    return expected


_PINS_STAY = within(
    "m that pins moved",
    lambda case, end: np.abs(end.x - case.scene.initial_position)[case.scene.cloth.pinned].max(),
    0.0,
)


def _free_points_out(depth: float) -> Judge:
    def inside(case: HardCase, end: End) -> Any:
        (sphere,) = case.scene.spheres
        return np.maximum(
            0.0, -sphere.height(end.x[~case.scene.cloth.pinned], case.steps * case.dt).min()
        )

    return within("m inside", inside, depth)


def _speeds(least: float, most: float) -> Judge:
    return within(
        "fastest point [m/s]",
        lambda case, end: np.linalg.norm(end.v, axis=-1).max(),
        most,
        low=least,
    )


def hard_cases() -> dict[str, HardCase]:
    """Scenes that are difficult for the method or the arithmetic, each with checks of its final
    state, by name.

    Returns
    -------
    dict of str to clothsim.hard_cases.HardCase
        A case has `scene`, `dt`, `steps`, `why` (a text that explains the difficulty) and `run`.

    Examples
    --------
    >>> case = cs.scenes.hard_cases()["1e6 m away"]
    >>> case.why
    'float32 tells points there apart by 6 cm'
    >>> result = case.run("single")
    >>> result.passed, len(result.figures)
    (True, 2)
    """
    families = (stiffness, time_steps, geometry, masses, contact)
    return {name: case for family in families for name, case in family().items()}
