from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
State = npt.NDArray[np.float32] | npt.NDArray[np.float64]

group_size: int
most_threads: int

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
        point_damping: float,
        mass: Floats,
        uniform_mass: bool,
        pinned: npt.NDArray[np.bool_],
    ) -> None: ...
    @property
    def mode_bounds(self) -> tuple[float, float]: ...

class Motion:
    def __init__(self) -> None: ...
    @staticmethod
    def linear(velocity: npt.ArrayLike) -> Motion: ...
    @staticmethod
    def reciprocate(
        direction: npt.ArrayLike, distance: float, period: float, deceleration: float, phase: float
    ) -> Motion: ...
    @staticmethod
    def keyframes(times: list[float], centers: list[Any]) -> Motion: ...

class Sphere:
    def __init__(
        self,
        *,
        center: npt.ArrayLike,
        radius: float,
        contact_radius: float,
        response: str,
        literal: bool,
        restitution: float,
        friction: float,
        motion: Motion,
        faces: bool = False,
        push_out_speed: float = 1.0,
    ) -> None: ...
    def center_at(self, t: float) -> Floats: ...
    def velocity_at(self, t: float) -> Floats: ...

class Plan:
    def __init__(
        self,
        *,
        cloth: Cloth,
        gravity: npt.ArrayLike,
        spheres: list[Sphere],
        precision: str,
        kernel: str,
        strict: bool,
        instruction_set: str,
        integrator: str,
    ) -> None: ...
    def sphere_states(self, times: list[float]) -> Floats: ...
    def runaway_speed(self, dt: float, stable_dt: float) -> float: ...
    @property
    def cloth(self) -> Cloth: ...
    @property
    def instruction_set(self) -> str: ...
    @property
    def lanes(self) -> int: ...

class StepController:
    h: float
    def __init__(self) -> None: ...

class Simulation:
    def __init__(self, plans: list[Plan], time: float) -> None: ...
    def load(self, x: State, v: State) -> None: ...
    def store(self, x: State, v: State) -> None: ...
    def advance(self, steps: int, dt: float, threads: int, optional: bool) -> dict[str, Any] | None: ...
    def accelerations(self, a: Floats, threads: int) -> None: ...
    def set_stable_dt(self, stable_dt: list[float]) -> None: ...
    def set_frozen(self, i: int, frozen: bool) -> None: ...
    @property
    def frozen(self) -> list[bool]: ...
    def advance_adaptive(
        self,
        until: float,
        end: float,
        steps: int,
        tolerance_x: float,
        tolerance_v: float,
        longest: float,
        controller: StepController,
        threads: int,
        optional: bool,
    ) -> dict[str, Any]: ...
    def dense(self, t: float, x: Floats, v: Floats, threads: int) -> None: ...
    def carry(
        self,
        x: Floats,
        v: Floats,
        e: Floats,
        w: Floats,
        duration: float,
        substeps: int,
        damping_part: float,
        displacement: float,
        threads: int,
    ) -> None: ...
    @property
    def evaluations(self) -> list[int]: ...
    @property
    def contacts(self) -> list[int]: ...
    def largest_stretch(self) -> list[float]: ...
    def snapshot(self) -> tuple[Any, ...]: ...
    def restore(self, origin: float, steps: int, dt: float, members: Any) -> None: ...
    def set_track_contact_energy(self, on: bool) -> None: ...
    @property
    def contact_energy(self) -> list[float]: ...
    @property
    def time(self) -> float: ...

def multiply_add_peak(precision: str, threads: int) -> float: ...
def memory_bandwidth(threads: int, bytes: int) -> dict[str, float]: ...
def core_round_trip() -> float: ...
def build_facts() -> dict[str, Any]: ...
def choose_instruction_set(name: str) -> str: ...
def available_threads() -> int: ...
def edge_offset(radius: float, rest_length: float) -> float: ...
def thread_ids(rows: int, columns: int) -> npt.NDArray[np.void]: ...
def triangles(rows: int, columns: int) -> npt.NDArray[np.int64]: ...
def energy(cloth: Cloth, gravity: npt.ArrayLike, x: Floats, v: Floats) -> tuple[float, float, float]: ...
def largest_stretch(cloth: Cloth, x: Floats) -> float: ...
def triangle_touches(p0: Floats, p1: Floats, reach: float, tolerance: float) -> Floats: ...
def penetration(
    rows: int, columns: int, x: Floats, center: npt.ArrayLike, radius: float
) -> tuple[float, float]: ...
def reference_step(
    plan: Plan, x: Floats, v: Floats, dt: float, steps: int, t: float
) -> tuple[Floats, Floats]: ...
def reference_step_as_printed(
    plan: Plan, x: Floats, v: Floats, dt: float, steps: int, t: float
) -> tuple[Floats, Floats]: ...
def extrapolate(
    *,
    i: npt.NDArray[np.int64],
    j: npt.NDArray[np.int64],
    rest_length: Floats,
    stiffness: Floats,
    damping: Floats,
    mass: Floats,
    pinned: npt.NDArray[np.bool_],
    gravity: tuple[float, float, float],
    point_damping: float,
    x: Floats,
    v: Floats,
    times: list[float],
    columns: int,
    tolerance: float,
    threads: int,
) -> dict[str, Any]: ...
