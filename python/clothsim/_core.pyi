from collections.abc import Callable, Sequence
from typing import Any, Literal, overload

import numpy as np
import numpy.typing as npt

from clothsim.typing import Family

Floats = npt.NDArray[np.float64]
State = npt.NDArray[np.float32] | npt.NDArray[np.float64]

# What is called once, with all arguments by name, takes **values here: the core checks the names.

group_size: int
most_threads: int
spring_kinds: tuple[tuple[Family, int, int], ...]
neighbours: tuple[tuple[int, int, Family, int], ...]
heuristics: dict[str, Any]  # of cpp/memory/heuristics.hpp

class Cloth:
    def __init__(self, **values: Any) -> None: ...

class Motion:
    @overload
    def __init__(self) -> None: ...
    @overload
    def __init__(self, pieces: Floats, period: float, phase: float, relative: bool) -> None: ...
    def states(self, times: Floats) -> Floats: ...

class Sphere:
    def __init__(self, **values: Any) -> None: ...
    @property
    def normal(self) -> Floats: ...
    def center_at(self, t: float) -> Floats: ...
    def velocity_at(self, t: float) -> Floats: ...

SAMPLES: int
LIGHT_SIZE: float
PLANE_IN_SHADOW: float
PLANE_TONE: float

class View:
    def __init__(self, **values: Any) -> None: ...

class Shading:
    def __init__(self, **values: Any) -> None: ...

class Force:
    def __init__(self, name: str, values: list[float], motion: Motion) -> None: ...
    name: str
    def damping_bound(self, cloth: Cloth) -> float: ...
    def damping_blocks(
        self, cloth: Cloth, x: Floats, v: Floats, t: float
    ) -> tuple[npt.NDArray[np.int64], Floats]: ...

class Plan:
    def __init__(self, **values: Any) -> None: ...
    def contact_table(
        self,
        times: list[float],
        origin: npt.ArrayLike,
        normals: npt.ArrayLike,
        dt: float,
        single: bool,
    ) -> Floats: ...
    def normals_towards(
        self, place: npt.ArrayLike, origin: npt.ArrayLike, t: float
    ) -> list[Floats]: ...
    def with_python_force(self, function: Callable[..., Floats]) -> Plan: ...
    def with_c_force(
        self, address: int, data: int | None, owner: object, held: float | None
    ) -> Plan: ...
    def runaway_speed(self, dt: float, stable_dt: float) -> float: ...
    @property
    def instruction_set(self) -> str: ...

class Moment:
    seconds: float
    time: float
    def __init__(self, seconds: float, time: float) -> None: ...

class Segment:
    dt: float
    def __init__(
        self, *, begin: Moment, end: Moment, dt: float, whole: int, rest: float = 0.0
    ) -> None: ...

class RunInProgress:
    dt: float
    steps: int
    complete: bool
    ahead: bool
    frames: list[Moment]
    stored: int
    def frame(self, k: int) -> Moment: ...

class FixedRun(RunInProgress):
    def __init__(self, segments: list[Segment], moments: list[Moment]) -> None: ...
    def record(
        self, simulation: object, x: list[Floats], v: list[Floats], steps: int, frames: int
    ) -> list[Event] | None: ...

class AdaptiveRun(RunInProgress):
    controller: tuple[float, float, bool]
    ends: list[float]
    kinks: list[int]
    rejected: int
    local_error: float
    def __init__(
        self,
        *,
        tolerance_x: float,
        tolerance_v: float,
        near: float,
        stops: list[float],
        grid: list[float],
        controller: tuple[float, float, bool],
        moments: list[Moment],
        start: float,
        every: int,
        since_frame: int,
    ) -> None: ...

class Event:
    kind: str
    member: int
    point: int
    obstacle: int
    value: float
    step: int
    time: float
    def __init__(
        self,
        *,
        kind: str,
        member: int,
        point: int = -1,
        obstacle: int = -1,
        value: float = 0.0,
        step: int,
        time: float,
    ) -> None: ...

class Simulation:
    def __init__(self, plans: list[Plan], time: float, threads: int) -> None: ...
    def load(self, x: State, v: State, time: float | None = None) -> None: ...
    @property
    def has_current_kernels(self) -> bool: ...
    @property
    def instruction_set(self) -> str: ...
    def set_scene(self, plans: Sequence[Plan], stable_dt: list[float]) -> None: ...
    def step(
        self,
        time: float,
        x: State,
        v: State,
        steps: int,
        dt: float,
        threads: int,
        x_out: State,
        v_out: State,
        /,
    ) -> list[Event] | Literal[False] | None: ...
    def store(self, x: State | None, v: State | None) -> None: ...
    def advance(self, steps: int, dt: float, threads: int) -> list[Event] | None: ...
    @overload
    def accelerations(
        self, time: float, x: State, v: State, a: Floats, threads: int, /
    ) -> bool: ...
    @overload
    def accelerations(self, a: Floats, threads: int, /) -> None: ...
    def set_stable_dt(self, stable_dt: list[float]) -> None: ...
    def set_stable_layer_depths(self, i: int, depths: list[float]) -> None: ...
    def set_sphere(self, sphere: int, centers: list[Floats], motions: list[Motion]) -> None: ...
    def set_force(self, force: Floats) -> None: ...
    def set_frozen(self, i: int, frozen: bool) -> None: ...
    @property
    def frozen(self) -> list[bool]: ...
    def record(
        self,
        run: RunInProgress,
        x: list[Floats],
        v: list[Floats],
        steps: int,
        frames: int,
        threads: int,
    ) -> list[Event] | None: ...
    @property
    def evaluations(self) -> list[int]: ...
    @property
    def contacts(self) -> list[int]: ...
    def set_watch(self, every: int, interval: float) -> None: ...
    def set_watch_energy(self, on: bool) -> None: ...
    def sample(self) -> None: ...
    @property
    def watched(self) -> list[dict[str, Any]]: ...
    def snapshot(self) -> dict[str, Any]: ...
    def restore(self, fields: dict[str, Any]) -> None: ...
    time: float

def build_facts() -> dict[str, Any]: ...
def choose_instruction_set() -> str: ...
def processors() -> int: ...
def available_threads() -> int: ...
def granted_threads(threads: int) -> int: ...
def render(**values: Any) -> npt.NDArray[np.uint8]: ...
def thread_ids(rows: int, columns: int) -> npt.NDArray[np.void]: ...
def methods() -> dict[str, dict[str, Any]]: ...
def interpolate(
    plan: Plan,
    t: float,
    begin: float,
    length: float,
    x0: Floats,
    v0: Floats,
    x1: Floats,
    v1: Floats,
) -> tuple[Floats, Floats]: ...
def mode_bounds(cloth: Cloth, forces: list[Force]) -> tuple[float, float]: ...
def capsule_facts(capsule: object) -> tuple[str, int, int]: ...
def edge_offset(radius: float, rest_length: float) -> float: ...
def energy(
    plan: Plan, x: Floats, v: Floats, t: float
) -> tuple[float, float, float, float, float]: ...
def contact_derivatives(plan: Plan, x: Floats, v: Floats, t: float) -> tuple[Floats, Floats]: ...
def contact_depths(plan: Plan, x: Floats, t: float) -> list[tuple[float, int]]: ...
def largest_stretch(cloth: Cloth, x: Floats) -> float: ...
def penetration(
    rows: int, columns: int, x: Floats, sphere: Sphere, t: float
) -> tuple[float, float]: ...
def reference_step(
    plan: Plan, x: Floats, v: Floats, dt: float, steps: int, t: float, as_printed: bool
) -> tuple[Floats, Floats]: ...
def extrapolate(
    plan: Plan,
    x: Floats,
    v: Floats,
    times: list[float],
    columns: int,
    tolerance: float,
    threads: int,
) -> tuple[float, Floats, Floats] | tuple[float, None, None]: ...
