"""The experiments: 1 to 4 of Kim et al., and 5, which is ours.

The tables at the top say what each experiment shows, and what its report measures.
`step_and_measure` measures contact, `measure_frame_rates` and `measure_speedup` measure speed.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import cache, partial
from time import perf_counter
from typing import Any

import numpy as np

import clothsim as cs
from clothsim.gpu import adapters, using
from clothsim.scenes import PAPER_DT


@dataclass(frozen=True)
class Experiment:
    """What an experiment compares, how it runs here, and what the paper shows."""

    title: str
    setting: str
    claim: str


EXPERIMENTS = {
    "1": Experiment(
        "static sphere, method 1 against method 2",
        "RK4 in double precision. A frame is 1.6 ms, 320 steps of the paper: if a frame were a "
        'single step of 5 us, as Table 2 reads ("0.000005 per frame"), frame 800 would come after '
        "4 ms, before any contact.",
        "Table 3, frames 150, 500 and 800: with method 1 the sphere penetrates the cloth's faces "
        "at all three, with method 2 at none.",
    ),
    "2": Experiment(
        "moving sphere, method 1 against method 2",
        "As experiment 1; frames of one step would end after 15.5 ms, before any contact.",
        "Table 4, frames 200, 1300 and 3100 in the text (the printed table is headed 150, 500 and "
        "800): the first, second and third contact. Frame 200, seen from the back: the edge folds "
        "with method 1 and wraps the sphere with method 2. Frames 1300 and 3100: the sphere "
        "penetrates the cloth with method 1, because the points are too slow to be moved out; not "
        "with method 2.",
    ),
    "3": Experiment(
        "frame rate, method 1 against method 2",
        "The falling cloth of experiment 1 on one thread, in double precision; the methods run in "
        "turns.",
        "Figure 9, mean of every 200 frames, 10 runs: method 2 is somewhat slower than method 1; "
        "both show more than 350 frames/s on a GTX 1070.",
    ),
    "4": Experiment(
        "method 2 by the core and the compute shader, against one scalar thread",
        "From one state in contact, in turns. The scalar reference walks the springs one by one, "
        "compiled with -O3.",
        "Figure 10: method 2 on the GPU (GTX 1070) is 60 % faster than on the CPU (i5-4460). Its "
        "first measurement is slower, because buffers are made in it.",
    ),
    "5": Experiment(
        "every collision response on three spheres, ours",
        "Steps of 0.1 ms. The static and the moving sphere are those of experiments 1 and 2, for "
        "0.8 s and 0.9 s; the fast one comes up at 100 m/s under the level cloth, for 12 ms.",
        "No such experiment. Two limits are named, without numbers: a fast sphere can pass between "
        "two steps, and method 1 penetrates slow cloth.",
    ),
}


@dataclass(frozen=True)
class Quantity:
    """A column of the report's tables; `factor` turns the values of report.json into its unit."""

    name: str
    definition: str
    unit: str = ""
    factor: float = 1.0

    @property
    def heading(self) -> str:
        return f"{self.name} [{self.unit}]" if self.unit else self.name


QUANTITIES = {
    "frame": Quantity("frame", "number of the frame"),
    "time": Quantity("t", "simulated time", "s"),
    "dt": Quantity("step", "integration step", "s"),
    "sphere": Quantity("sphere", "static, moving or fast"),
    "case": Quantity("case", "method and variant; in experiment 4 the program"),
    "points": Quantity(
        "deepest point",
        "largest depth of a mass point below the true radius; 0 if none is inside "
        "(`clothsim.penetration`)",
        "mm",
        factor=1e3,
    ),
    "triangles": Quantity(
        "deepest triangle", "the same of any place on a triangle", "mm", factor=1e3
    ),
    "points_so_far": Quantity(
        "point so far",
        "deepest point of all frames up to this one (experiment 5: every 0.4 ms, for the fast "
        "sphere every 0.1 ms)",
        "mm",
        factor=1e3,
    ),
    "triangles_so_far": Quantity(
        "triangle so far", "deepest triangle of the same frames", "mm", factor=1e3
    ),
    "points_passed": Quantity(
        "points passed",
        "mass points that left the sphere on another side than they entered, or jumped through it, "
        "at the same frames",
    ),
    "points_touching": Quantity(
        "points touching", "mass points inside the contact radius, or less than 1 mm outside it"
    ),
    "energy_gained": Quantity(
        "energy gained",
        "change of the total energy since the start; damping takes energy, contacts and a moving "
        "sphere add to it",
        "J",
    ),
    "steps_per_second": Quantity("steps/s, median", "over all repeats, by wall time"),
    "frames_per_second": Quantity(
        "frames/s", "steps/s divided by 320, the steps of a frame at the paper's step"
    ),
    "each": Quantity("steps/s, each", "in each run"),
    "times_the_first": Quantity(
        "times the reference", "steps/s over those of the scalar reference"
    ),
}

VARIANTS = ("as printed", "corrected")
# Method 1 and method 2 of the paper, in both variants, and contact as a force.
CASES: dict[str, dict[str, Any]] = {
    f"method {number}, {variant}": {"response": response, "as_printed": variant == VARIANTS[0]}
    for variant in VARIANTS
    for number, response in ((1, "reflect"), (2, "ray"))
}
RESPONSES = CASES | {"penalty": {"response": "penalty", "offset": "cell", "restitution": None}}
FRAMES = {"1": (150, 500, 800), "2": (200, 1300, 3100)}  # of Tables 3 and 4
NEAR = 1e-3  # m; a point this close to the contact radius counts as touching
PLAYED = 200  # states kept to be played; a page of four such runs is some 3 MB
AGREEMENT_STEPS = 100  # after which experiment 4 compares core and reference


def _make_fast_sphere_scene() -> cs.Scene:
    """Make the paper's cloth, level, and its sphere on the way up through it at 100 m/s."""
    scene = cs.scenes.paper_static()
    sphere = scene.spheres[0].replace(center=(0.5, -0.3, 0.5), motion=cs.Linear((0, 100.0, 0)))
    return scene.replace(spheres=[sphere])


# The spheres of experiment 5: scene, duration [s], steps between two looks
SPHERES: dict[str, tuple[Callable[[], cs.Scene], float, int]] = {
    "static": (cs.scenes.paper_static, 0.8, 4),
    "moving": (cs.scenes.paper_moving, 0.9, 4),
    "fast": (_make_fast_sphere_scene, 0.012, 1),
}
SPHERES_DT = 1e-4  # s


@dataclass(frozen=True)
class Settings:
    """Sizes of the experiments; `SIZES` says what each is. docs/reproduction.md says why a frame is
    1.6 ms.
    """

    dt: tuple[float, float, float] = (PAPER_DT, PAPER_DT, PAPER_DT)
    frame_dt: float = 1.6e-3
    study_dts: tuple[float, ...] = (1e-4, 4e-4, 1.6e-3)  # the last is a step a frame
    runs: int = 10
    timed_frames: int = 800
    speedup_steps: int = 20_000
    part: float = 1.0

    def steps_per_frame(self, dt: float = PAPER_DT) -> int:
        """Return the number of steps of `dt` that make a frame."""
        return round(self.frame_dt / dt)


SIZES = {
    "dt": "steps [s] of experiments 1, 2, and 3 and 4",
    "frame_dt": "time between two frames [s]",
    "study_dts": "coarser steps [s] for repeats of experiment 1",
    "runs": "repeats of a timed run",
    "timed_frames": "frames of a run in experiment 3",
    "speedup_steps": "steps a run in experiment 4",
    "part": "part of its durations that experiment 5 runs; the fast sphere runs in full",
}
"""Fields of `Settings`."""

FULL = Settings()
QUICK = Settings((4e-5, 8e-5, 5e-5), 1.6e-3, (4e-4, 1.6e-3), 3, 200, speedup_steps=500, part=0.4)


@dataclass
class Case:
    """The last frame of a cloth, its frames of the paper's tables, states to play, and why it ended
    early.
    """

    name: str
    scene: cs.Scene
    last: dict[str, Any] = field(default_factory=dict)
    cells: list[dict[str, Any]] = field(default_factory=list)
    played: list[tuple[float, np.ndarray, np.ndarray]] = field(default_factory=list)
    failure: str = ""


def _dot_products(a: Any, b: Any) -> Any:
    return np.einsum("...k,...k->...", a, b)


class PassedPoints:
    """A count of mass points that go through a sphere: between two states, or out on another side
    than they came in.

    Positions are from the centre, of one cloth or of a batch.
    """

    def __init__(self, from_center: np.ndarray, radius: float) -> None:
        self._last = from_center
        self._entered = from_center
        self._radius = radius
        self.count = np.zeros(from_center.shape[:-3], int)

    def count_passed(self, new: np.ndarray) -> None:
        last = self._last
        radius2 = self._radius**2
        was_outside = _dot_products(last, last) >= radius2
        is_outside = _dot_products(new, new) >= radius2
        self._entered = np.where((was_outside & ~is_outside)[..., None], last, self._entered)
        way = new - last
        part = np.clip(
            -_dot_products(last, way) / np.maximum(_dot_products(way, way), 1e-300), 0, 1
        )
        nearest = last + part[..., None] * way
        between = (
            was_outside & is_outside & (_dot_products(nearest, nearest) < radius2 * (1 - 2e-9))
        )
        turned = ~was_outside & is_outside & (_dot_products(self._entered, new) < 0)
        self.count = self.count + (between | turned).sum(axis=(-2, -1))
        self._last = new


def sharpest_fold_in_degrees(x: np.ndarray) -> np.ndarray:
    """Measure the largest angle [degrees] between normals of neighbouring cells of each cloth."""
    normals = np.cross(x[:, 1:, :-1] - x[:, :-1, :-1], x[:, :-1, 1:] - x[:, :-1, :-1])
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-300)
    cosines = (
        _dot_products(normals[:, 1:], normals[:, :-1]),
        _dot_products(normals[:, :, 1:], normals[:, :, :-1]),
    )
    least = np.minimum(*(cosine.min(axis=(1, 2)) for cosine in cosines))
    return np.asarray(np.degrees(np.arccos(np.clip(least, -1.0, 1.0))))


def simulated_seconds(key: str, settings: Settings) -> float:
    """Sum up the seconds with which an experiment calls its `advance`; cases that run side by side
    count once.
    """
    if key in FRAMES:
        dts = (settings.dt[int(key) - 1], *(settings.study_dts if key == "1" else ()))
        return sum(max(FRAMES[key]) * settings.steps_per_frame(dt) * dt for dt in dts)
    if key == "3":
        steps = settings.timed_frames * settings.steps_per_frame(settings.dt[2])
        return settings.runs * steps * settings.dt[2]
    if key == "4":
        return settings.runs * settings.speedup_steps * settings.dt[2]
    return sum(
        _count_measurements(name, settings.part, steps, duration) * steps * SPHERES_DT
        for name, (_, duration, steps) in SPHERES.items()
    )


def _count_measurements(sphere: str, part: float, steps: int, duration: float) -> int:
    """Count the measurements of experiment 5 on a sphere."""
    return round((1.0 if sphere == "fast" else part) * duration / SPHERES_DT / steps)


def step_and_measure(
    scenes: dict[str, cs.Scene],
    dt: float,
    steps: int,
    looks: int,
    frames: Collection[int] = (),
    threads: int | None = None,
    advance: Callable[[float], object] = bool,
) -> list[Case]:
    """Step scenes that differ in the responses of their sphere alone as one batch, and measure each
    every `steps` steps.

    There are `looks` measurements; those of `frames` are kept as cells. `advance` is called with
    the simulated time between two of them [s].
    """
    cases = [Case(name, scene) for name, scene in scenes.items()]
    members = list(scenes.values())
    sphere = members[0].spheres[0]
    radii = [scene.spheres[0].contact_radius(scene.cloth) for scene in members]
    touching = NEAR + np.array(radii)
    stepper = cs.Stepper(members, threads=threads)
    start = np.asarray(cs.energy(members, stepper.positions, stepper.velocities, 0.0)["total"])
    passage = PassedPoints(stepper.positions - sphere.center_at(0.0), sphere.radius)
    for look in range(looks + 1):
        if look:
            _advance_or_freeze(stepper, steps, dt, cases)
            advance(steps * dt)
        x = stepper.positions
        v = stepper.velocities
        t = float(stepper.time)
        from_center = x - sphere.center_at(t)
        passage.count_passed(from_center)
        energy = cs.energy(members, x, v, t)
        measures = {
            **cs.penetration(x, sphere, t),
            "energy_gained": energy["total"] - start,
            "kinetic_energy": energy["kinetic"],
            "points_passed": passage.count,
        }
        if look in frames:
            touches = np.linalg.norm(from_center, axis=-1) < touching[:, None, None]
            measures["points_touching"] = touches.sum(axis=(1, 2))
            measures["sharpest_fold"] = sharpest_fold_in_degrees(x)
        for k, case in enumerate(cases):
            if case.failure:
                continue
            values = {name: np.asarray(value)[k].item() for name, value in measures.items()}
            for kind in ("points", "triangles"):
                values[f"{kind}_so_far"] = max(values[kind], case.last.get(f"{kind}_so_far", 0.0))
            case.last = {"case": case.name, "frame": look, "time": t, **values}
            if frames and (look % -(-looks // PLAYED) == 0 or look in frames):
                case.played.append((t, x[k].copy(), v[k].copy()))
            if look in frames:
                case.cells.append(case.last)
    return cases


def _advance_or_freeze(stepper: cs.Stepper, steps: int, dt: float, cases: Sequence[Case]) -> None:
    while steps:
        try:
            return stepper.advance(steps, dt)
        except (cs.ContactError, cs.UnstableError) as error:
            member = error.member or 0
            end = "unstable" if isinstance(error, cs.UnstableError) else "passed through"
            cases[member].failure = f"{end} at t = {error.time:g} s"
            stepper.freeze(member)
            steps -= error.step - 1


def scenes_by_response(
    scene: cs.Scene, responses: dict[str, dict[str, Any]]
) -> dict[str, cs.Scene]:
    """Make scenes with each of these responses of their sphere."""
    (sphere,) = scene.spheres
    return {
        name: scene.replace(spheres=[sphere.replace(**changes)])
        for name, changes in responses.items()
    }


def run_contact(
    number: str,
    settings: Settings,
    dt: float,
    cases: Collection[str] = tuple(CASES),
    **options: Any,
) -> list[Case]:
    """Experiment "1" (static sphere) or "2" (moving sphere) with steps of `dt`; `options` are those
    of `step_and_measure`.
    """
    scene = cs.scenes.paper_static() if number == "1" else cs.scenes.paper_moving()
    scenes = scenes_by_response(scene, {name: CASES[name] for name in cases})
    frames = FRAMES[number]
    steps = settings.steps_per_frame(dt)
    with warnings.catch_warnings():
        # A step as long as a frame is above the guarantee.
        warnings.simplefilter("ignore", cs.StabilityWarning)
        return step_and_measure(scenes, dt, steps, looks=max(frames), frames=frames, **options)


def run_step_study(
    settings: Settings, threads: int, advance: Callable[[float], object] = bool
) -> list[dict[str, Any]]:
    """Run experiment 1 as printed at each of `settings.study_dts`; depths at each frame."""
    rows = []
    printed = [name for name in CASES if "printed" in name]
    for dt in settings.study_dts:
        for case in run_contact("1", settings, dt, printed, threads=threads, advance=advance):
            if case.failure:
                continue
            depths = {kind: [cell[kind] for cell in case.cells] for kind in ("points", "triangles")}
            rows.append({**case.last, **depths, "dt": dt})
    return rows


def run_comparison(
    spheres: Collection[str] = tuple(SPHERES),
    responses: Collection[str] = tuple(RESPONSES),
    part: float = 1.0,
    every: int | None = None,
    **options: Any,
) -> list[dict[str, Any]]:
    """Run experiment 5: every response on every sphere, a row each, measured every `every` steps;
    `options` as for `step_and_measure`.

    `QUANTITIES` defines the columns.
    """
    rows = []
    for name in spheres:
        make, duration, steps = SPHERES[name]
        if every is not None:
            steps = every
        looks = _count_measurements(name, part, steps, duration)
        scenes = scenes_by_response(
            make(), {response: RESPONSES[response] for response in responses}
        )
        with warnings.catch_warnings():
            # The layer of the fast sphere asks for shorter steps than all responses take here.
            warnings.simplefilter("ignore", cs.StabilityWarning)
            cases = step_and_measure(scenes, SPHERES_DT, steps, looks, **options)
        rows += [{"sphere": name, **case.last, "failure": case.failure} for case in cases]
    return rows


def _time_in_turns(
    jobs: dict[str, Any], repeats: int, steps: int, dt: float, advance: Callable[[float], object]
) -> list[dict[str, Any]]:
    """Time jobs of so many steps, and return a row of rates for each: the median, which one
    disturbed repeat does not move, and all.
    """
    seconds: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(repeats):
        for name, job in jobs.items():
            begin = perf_counter()
            job()
            seconds[name].append(perf_counter() - begin)
        advance(steps * dt)
    middle = {name: float(np.median(times)) for name, times in seconds.items()}
    first = next(iter(middle.values()))
    return [
        {
            "case": name,
            "steps_per_second": steps / middle[name],
            "times_the_first": first / middle[name],
            "each": (steps / np.array(times)).tolist(),
        }
        for name, times in seconds.items()
    ]


def measure_frame_rates(
    settings: Settings, advance: Callable[[float], object] = bool
) -> dict[str, Any]:
    """Run experiment 3: all cases on the falling cloth, on one thread, in turns; "each": steps/s in
    each run.

    A frame is its steps and one copy of the positions, as a renderer needs.
    """
    dt = settings.dt[2]
    frame_steps = settings.steps_per_frame()
    steps = settings.steps_per_frame(dt)

    def fall(scene: cs.Scene) -> None:
        stepper = cs.Stepper(scene, threads=1)
        for _ in range(settings.timed_frames):
            stepper.advance(steps, dt)
            stepper.positions  # noqa: B018

    scenes = scenes_by_response(cs.scenes.paper_static(), CASES)
    jobs = {name: partial(fall, scene) for name, scene in scenes.items()}
    rows = _time_in_turns(jobs, settings.runs, steps * settings.timed_frames, dt, advance)
    for row in rows:
        row["frames_per_second"] = row["steps_per_second"] / frame_steps
    return {"rows": rows, "frame_steps": frame_steps}


def measure_speedup(
    settings: Settings, threads: int, advance: Callable[[float], object] = bool
) -> dict[str, Any]:
    """Run experiment 4: method 2 by the scalar reference, the core and every graphics card. They
    start from one state in contact.

    "each": steps/s in each run; the first makes the buffers, as in the paper.
    """
    dt = settings.dt[2]
    steps = settings.speedup_steps
    t = 0.5
    scene = cs.scenes.paper_static(response="ray")
    x, v = cs.step(scene, scene.initial_position, scene.initial_velocity, 5e-5, 10_000)
    cards = []
    missing = "no graphics card here"
    try:
        cards = [adapter for adapter in adapters() if not adapter.software]
    except ImportError as error:
        missing = str(error)

    @cache  # The first run makes a stepper, with its buffers.
    def stepper(card: Any = None, **options: Any) -> cs.Stepper:
        return cs.Stepper(scene, x, v, t=t, **options)

    def job(card: Any = None, **options: Any) -> None:
        with using(card) if card else nullcontext():
            stepper(card, **options).advance(steps, dt)

    jobs: dict[str, Any] = {
        "scalar reference": lambda: cs.reference_step(scene, x, v, dt, steps=steps, t=t)
    }
    for precision in ("double", "single"):
        for n in sorted({1, threads}):
            jobs[f"core, {precision}, {n} thread{'s' * (n > 1)}"] = partial(
                job, precision=precision, threads=n
            )
        for card in cards:
            if card.float64 or precision == "single":
                jobs[f"shader, {precision}, {card.name}"] = partial(
                    job, card, precision=precision, backend="gpu"
                )
    rows = _time_in_turns(jobs, settings.runs, steps, dt, advance)
    ends = [step(scene, x, v, dt, AGREEMENT_STEPS, t=t)[0] for step in (cs.reference_step, cs.step)]
    return {"rows": rows, "agreement": float(np.abs(ends[0] - ends[1]).max()), "missing": missing}
