"""The options that every stepping function takes, checked once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, get_args

from .. import _core
from ..base import check
from ..base.build import available_threads
from ..methods.integrators import integrator_name
from ..typing import Backend, Kernel, Precision

if TYPE_CHECKING:
    from typing_extensions import Self


PRECISIONS: tuple[Precision, ...] = ("double", "single")
KERNELS: tuple[Kernel, ...] = get_args(Kernel)
BACKENDS: tuple[Backend, ...] = get_args(Backend)

# Mass points from which one cloth is stepped by all threads. Smaller ones gain less than the threads would take from others.
_LEAST_POINTS_OF_TEAM = 16_384


@dataclass(frozen=True)
class Options:
    """The options of the steps, as `step` takes them.

    Made once from the arguments of a call, and handed down to the core. An integrator's alias becomes its name.
    """

    integrator: str = "rk4"
    precision: str = "double"
    threads: int | None = None
    kernel: str = "auto"
    backend: str = "cpu"

    def __post_init__(self) -> None:
        check.choice("precision", self.precision, PRECISIONS)
        check.choice("kernel", self.kernel, KERNELS)
        object.__setattr__(self, "integrator", integrator_name(self.integrator))
        if check.choice("backend", self.backend, BACKENDS) == "gpu":
            self._check_gpu()
        if self.threads is not None:
            check.integer("threads", self.threads, minimum=1, maximum=_core.most_threads)

    def _check_gpu(self) -> None:
        for name, value, accepted in (
            ("integrator", self.integrator, ("rk4",)),
            ("kernel", self.kernel, ("gather", "auto")),
            ("threads", self.threads, (None,)),
        ):
            if value not in accepted:
                raise ValueError(f"{name} must be {' or '.join(map(repr, accepted))} with backend 'gpu', got {value!r}")

    def replace(self, **changes: Any) -> Self:
        """A copy with other values."""
        return replace(self, **changes)

    @property
    def chosen_kernel(self) -> str:
        """The kernel that "auto" stands for."""
        return "edge" if self.kernel == "auto" else self.kernel

    def threads_for(self, shape: tuple[int, int], members: int = 1) -> int:
        """`threads`; None: all for large cloths, else one a member."""
        if self.threads is not None:
            return self.threads
        most = _core.most_threads if shape[0] * shape[1] >= _LEAST_POINTS_OF_TEAM else members
        return 1 if most == 1 else min(most, available_threads())
