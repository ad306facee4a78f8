"""The options of steps, checked once, and the plan of the core for a scene with them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, get_args

from .. import _core
from ..base import check
from ..base.build import available_thread_count, processor_count
from ..base.text import format_count
from ..errors import warn_caller
from ..methods.integrators import check_integrator_name
from ..model.scene import Scene
from ..typing import Backend, Kernel, Precision

PRECISIONS: tuple[Precision, ...] = ("double", "single")
KERNELS: tuple[Kernel, ...] = get_args(Kernel)
BACKENDS: tuple[Backend, ...] = get_args(Backend)

_MOST_PLANS = 8  # most plans that a scene keeps
_past_warnings: set[str] = set()  # kinds of warnings that this process has had


@dataclass(frozen=True)
class Options:
    """The options of the steps, as `step` takes them.

    They are made once from the arguments of a call, and handed down to the core.
    """

    integrator: str = "rk4"
    precision: str = "double"
    threads: int | None = None
    kernel: str = "auto"
    backend: str = "cpu"

    def __post_init__(self) -> None:
        check.choice("precision", self.precision, PRECISIONS)
        check.choice("kernel", self.kernel, KERNELS)
        check_integrator_name(self.integrator)
        if check.choice("backend", self.backend, BACKENDS) == "gpu":
            self._check_gpu_options()
        if self.threads is not None:
            check.integer("threads", self.threads, minimum=1, maximum=_core.most_threads)

    def _check_gpu_options(self) -> None:
        for name, value, choices in (
            ("integrator", self.integrator, ("rk4",)),
            ("kernel", self.kernel, ("gather", "auto")),
            ("threads", self.threads, (None,)),
        ):
            if value not in choices:
                raise ValueError(
                    f"{name} must be {' or '.join(map(repr, choices))} with backend 'gpu', "
                    f"got {value!r}"
                )

    @property
    def chosen_kernel(self) -> str:
        """The kernel that "auto" stands for."""
        return "edge" if self.kernel == "auto" else self.kernel

    def thread_count_for(self, shape: tuple[int, int], members: int = 1) -> int:
        """Return `threads`, or a number by size if it is None.

        Large cloths get all processors, others one thread for each member.
        """
        if self.threads is not None:
            _warn_of_many_threads(self.threads)
            return self.threads
        points = shape[0] * shape[1]
        team = 1
        if points >= _core.heuristics["points_of_team"]:
            team = points // _core.heuristics["points_per_thread_of_step"]
        return min(max(team, members), available_thread_count(), _core.most_threads)


def _warn_of_many_threads(threads: int) -> None:
    """Warn once of more threads than processors: they wait for each other in turns."""
    if threads > (count := processor_count()) and "threads" not in _past_warnings:
        _past_warnings.add("threads")
        warn_caller(
            f"threads = {threads} is above the {format_count(count, 'processor')} that this "
            "process may use: steps take several times as long as with one thread",
            UserWarning,
        )


def cached_plan(scene: Scene, options: Options) -> _core.Plan:
    """Return the plan of a scene, which is compiled once: a scene cannot change."""
    plans: dict[Any, _core.Plan] = scene.__dict__.setdefault("_plans", {})
    key = options.precision, options.kernel, options.integrator, _core.choose_instruction_set()
    plan = plans.get(key)
    if plan is None:
        if len(plans) >= _MOST_PLANS:
            make_room_in_cache(plans, _MOST_PLANS)
        plan = plans[key] = compile_plan(scene, options)
    return plan


def make_room_in_cache(cache: dict[Any, Any], most: int) -> None:
    """Remove the oldest entries until there is room for another; other threads may do so too."""
    for key in list(cache)[: len(cache) + 1 - most]:
        cache.pop(key, None)


def compile_plan(scene: Scene, options: Options) -> _core.Plan:
    """Compile a scene for the core, with the kernels of the chosen instruction set."""
    return _core.Plan(
        cloth=scene.cloth.core,
        gravity=scene.gravity,
        force=scene.force,
        **scene.core_pins,
        spheres=scene.core_spheres,
        forces=scene.core_forces,
        precision=options.precision,
        kernel=options.chosen_kernel,
        integrator=options.integrator,
    )
