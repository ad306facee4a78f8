from typing import Any, Literal, overload

import numpy as np
import numpy.typing as npt

from clothsim.typing import Family

Floats = npt.NDArray[np.float64]
State = npt.NDArray[np.float32] | npt.NDArray[np.float64]

group_size: int
contact_constants: dict[str, float]
most_threads: int
spring_kinds: tuple[tuple[Family, int, int], ...]
neighbours: tuple[tuple[int, int, Family, int], ...]
extents_that_are_far: float

class Cloth:
    def __init__(
        self,
        *,
        rows: int,
        columns: int,
        row_spacing: float,
        column_spacing: float,
        stiffness: dict[str, float],
        spring_damping: dict[str, float],
        drag: float,
        mass: Floats,
        uniform_mass: bool,
        pinned: npt.NDArray[np.bool_],
    ) -> None: ...
    @property
    def mode_bounds(self) -> tuple[float, float]: ...

class Motion:
    @overload
    def __init__(self) -> None: ...
    @overload
    def __init__(self, pieces: Floats, period: float, phase: float, relative: bool) -> None: ...
    def states(self, times: Floats) -> Floats: ...

class Sphere:
    def __init__(
        self,
        *,
        center: npt.ArrayLike,
        radius: float,
        offset: float,
        response: str,
        as_printed: bool,
        restitution: float,
        friction: float,
        motion: Motion,
        cells: bool,
        push_out_speed: float,
        normal: npt.ArrayLike,
        spread: float = 1.0,
    ) -> None: ...
    @property
    def normal(self) -> Floats: ...
    @property
    def spread(self) -> float: ...
    def center_at(self, t: float) -> Floats: ...
    def velocity_at(self, t: float) -> Floats: ...

SAMPLES: int

class View:
    def __init__(
        self, *, width: int, height: int, axes: Floats, target: tuple[float, float, float], scale: float, distance: float
    ) -> None: ...

class Shading:
    def __init__(
        self,
        *,
        colors: dict[str, Floats],
        full_red_depth: float,
        least_red: float,
        key: Floats,
        light: tuple[float, float, float, float],
        grid_line: float,
        grid_shade: float,
        shadow: bool,
        depth_colors: Any,
        depth_range: tuple[float, float],
    ) -> None: ...

class Plan:
    def __init__(
        self,
        *,
        cloth: Cloth,
        gravity: npt.ArrayLike,
        force: Floats | None,
        pin_motions: list[Motion],
        driven_pins: list[tuple[int, Floats, int]],
        spheres: list[Sphere],
        precision: str,
        kernel: str,
        integrator: str,
    ) -> None: ...
    def contact_table(self, times: list[float], origin: npt.ArrayLike, dt: float, single: bool) -> Floats: ...
    def runaway_speed(self, dt: float, stable_dt: float) -> float: ...
    @property
    def instruction_set(self) -> str: ...

class AdaptiveRun:
    controller: tuple[float, float, bool]
    steps: int
    begin: float
    ends: list[float]
    kinks: list[int]
    rejected: int
    local_error: float
    def __init__(
        self,
        tolerance_x: float,
        tolerance_v: float,
        near: float,
        stops: list[float],
        grid: list[float],
        controller: tuple[float, float, bool],
    ) -> None: ...

class Simulation:
    def __init__(self, plans: list[Plan], time: float, threads: int) -> None: ...
    def load(self, x: State, v: State, time: float | None = None) -> None: ...
    @property
    def current(self) -> bool: ...
    def set_scene(self, plans: list[Plan], stable_dt: list[float]) -> None: ...
    def step(
        self, time: float, x: State, v: State, steps: int, dt: float, threads: int, x_out: State, v_out: State, /
    ) -> dict[str, Any] | Literal[False] | None: ...
    def store(self, x: State | None, v: State | None) -> None: ...
    def advance(self, steps: int, dt: float, threads: int) -> dict[str, Any] | None: ...
    @overload
    def accelerations(self, x: State, v: State, a: Floats, threads: int, /) -> bool: ...
    @overload
    def accelerations(self, a: Floats, threads: int, /) -> None: ...
    def set_stable_dt(self, stable_dt: list[float]) -> None: ...
    def set_sphere(self, sphere: int, centers: list[Floats], motions: list[Motion]) -> None: ...
    def set_force(self, force: Floats) -> None: ...
    def set_frozen(self, i: int, frozen: bool) -> None: ...
    @property
    def frozen(self) -> list[bool]: ...
    def advance_adaptive(self, run: AdaptiveRun, until: float, steps: int, threads: int) -> dict[str, Any] | None: ...
    def dense(self, t: float, x: Floats, v: Floats, threads: int) -> None: ...
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
def granted_threads(threads: int) -> int: ...
def render(
    *,
    view: View,
    shading: Shading,
    points: Floats,
    screen: Floats,
    normals: Floats,
    colors: Floats | None,
    balls: Any,
    planes: Any,
    threads: int,
) -> npt.NDArray[np.uint8]: ...
def thread_ids(rows: int, columns: int) -> npt.NDArray[np.void]: ...
def methods() -> dict[str, dict[str, Any]]: ...
def edge_offset(radius: float, rest_length: float) -> float: ...
def energy(
    cloth: Cloth, gravity: npt.ArrayLike, force: Floats | None, x: Floats, v: Floats
) -> tuple[float, float, float, float]: ...
def largest_stretch(cloth: Cloth, x: Floats) -> float: ...
def penetration(rows: int, columns: int, x: Floats, sphere: Sphere, t: float) -> tuple[float, float]: ...
def reference_step(
    plan: Plan, x: Floats, v: Floats, dt: float, steps: int, t: float, as_printed: bool
) -> tuple[Floats, Floats]: ...
def extrapolate(
    plan: Plan, x: Floats, v: Floats, times: list[float], columns: int, tolerance: float, threads: int
) -> tuple[float, Floats, Floats] | tuple[float, None, None]: ...
