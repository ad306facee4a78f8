"""The adapters of this machine, the choice of an adapter, and its errors as errors of clothsim.

Only this module imports wgpu, at the first use of an adapter.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from typing import Any

from ..base.extras import reason_of

ADAPTER_VARIABLE = "CLOTHSIM_GPU_ADAPTER"
# float64, and the integers of its size that `keep` takes it through.
FLOAT64 = ("shader-f64", "shader-int64")

# Drivers that the backend is written for; OpenGL would lack float64 and large buffers.
_BACKENDS = ("Vulkan", "Metal", "D3D12")
_ORDER = ("DiscreteGPU", "IntegratedGPU", "VirtualGPU", "CPU", "Unknown")
_LIMITS = ("max-buffer-size", "max-storage-buffer-binding-size")


def load_wgpu() -> Any:
    """The module wgpu, or an ImportError that names the extra."""
    try:
        import wgpu
        from wgpu.backends.wgpu_native import extras
    except ImportError as error:
        raise ImportError(reason_of(error, "wgpu", "backend 'gpu'", "gpu")) from error
    global _restricted
    if not _restricted:
        # OpenGL, and Mesa's layer that asks a display for its adapter, write to stderr if there is no display. No effect
        # where the caller has used wgpu before.
        has_display = "XDG_RUNTIME_DIR" in os.environ
        with nullcontext() if has_display else _environment("NODEVICE_SELECT", os.environ.get("NODEVICE_SELECT", "1")):
            extras.set_instance_extras(backends=("Vulkan", "Metal", "DX12"))
        _restricted = True
    return wgpu


_restricted = False


@dataclass(frozen=True)
class Adapter:
    """One graphics adapter.

    Attributes
    ----------
    name : str
    kind : str
        "DiscreteGPU", "IntegratedGPU", "VirtualGPU", "CPU" (software) or "Unknown".
    api, driver : str
    float64 : bool
        Whether the adapter's shaders compute in double precision.
    largest_buffer : int
        Bytes that one of a cloth's buffers may have.
    handle : wgpu.GPUAdapter
        The adapter as wgpu has it.
    place : int
        In `adapters()`; CLOTHSIM_GPU_ADAPTER takes it too.

    Examples
    --------
    >>> from clothsim.gpu import adapters
    >>> [(adapter.name, adapter.float64) for adapter in adapters()]  # doctest: +SKIP
    [('llvmpipe (LLVM 15.0.6, 256 bits)', True)]
    """

    name: str
    kind: str
    api: str
    driver: str
    float64: bool
    largest_buffer: int
    handle: Any = field(repr=False, compare=False)
    place: int = 0

    @property
    def software(self) -> bool:
        """Whether this adapter is a CPU that runs shaders, no GPU."""
        return self.kind == "CPU"

    def __str__(self) -> str:
        note = ", a CPU that runs shaders, no GPU" if self.software else ""
        return f"{self.name} ({self.api}{note})"


def _described(handle: Any) -> Adapter:
    info, limits = handle.info, handle.limits
    return Adapter(
        name=str(info["device"]).strip(),
        kind=str(info["adapter_type"]),
        api=str(info["backend_type"]),
        driver=str(info["description"]).strip(),
        float64=set(FLOAT64) <= set(handle.features),
        largest_buffer=min(int(limits[name]) for name in _LIMITS),
        handle=handle,
    )


def adapters() -> list[Adapter]:
    """The graphics adapters that `backend="gpu"` can use, best first.

    Returns
    -------
    list of Adapter
        Discrete adapters come first, software adapters (Mesa's lavapipe) last. The list may be empty.

    Raises
    ------
    ImportError
        Without wgpu, naming the extra that brings it.

    Examples
    --------
    >>> from clothsim.gpu import adapters
    >>> all(adapter.largest_buffer > 0 for adapter in adapters())  # doctest: +SKIP
    True
    """
    wgpu = load_wgpu()
    found = [_described(handle) for handle in wgpu.gpu.enumerate_adapters_sync()]
    usable = [adapter for adapter in found if adapter.api in _BACKENDS]
    usable.sort(key=lambda a: _ORDER.index(a.kind) if a.kind in _ORDER else len(_ORDER))
    return [replace(adapter, place=place) for place, adapter in enumerate(usable)]


@contextmanager
def _environment(name: str, value: str) -> Iterator[None]:
    """A context with this variable of the environment."""
    before = os.environ.get(name)
    os.environ[name] = value
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before


def chosen_adapter() -> Adapter:
    """The adapter in use: the best, or the choice of CLOTHSIM_GPU_ADAPTER by name or by number from 0."""
    found = adapters()
    if not found:
        raise RuntimeError(
            "backend 'gpu' found no Vulkan, Metal or Direct3D 12 adapter; install the graphics "
            "driver, or Mesa's software one (Debian: mesa-vulkan-drivers)"
        )
    wanted = os.environ.get(ADAPTER_VARIABLE, "")
    if wanted.isdecimal() and int(wanted) < len(found):
        return found[int(wanted)]
    for adapter in found:
        if wanted.lower() in adapter.name.lower():
            return adapter
    raise ValueError(
        f"{ADAPTER_VARIABLE} must be part of the name of an adapter, or its place from 0 on, "
        f"({', '.join(repr(a.name) for a in found)}), got {wanted!r}"
    )


class Device:
    """An opened adapter. Pipelines are kept with it, as they are slow to compile."""

    def __init__(self, adapter: Adapter, float64: bool = True) -> None:
        self.wgpu = load_wgpu()
        self.adapter = adapter
        self._process = os.getpid()
        self.float64 = adapter.float64 and float64
        limits = adapter.handle.limits
        with translated(adapter):
            self.handle = adapter.handle.request_device_sync(
                required_features=list(FLOAT64) if self.float64 else [],
                required_limits={name: limits[name] for name in _LIMITS},
            )
        self.groups_limit = int(self.handle.limits["max-compute-workgroups-per-dimension"])
        self.pipelines: dict[Any, Any] = {}

    def check_process(self) -> None:
        """Raise an error in a fork of the process that opened this device."""
        if os.getpid() != self._process:
            raise RuntimeError(
                "backend 'gpu' cannot be used in a process forked from one that has used it; "
                "start processes with the method 'spawn'"
            )

    def create_buffer(self, size: int, *usages: str) -> Any:
        """A buffer of `size` bytes; a ValueError if the adapter's limit is smaller."""
        if size > self.adapter.largest_buffer:
            raise ValueError(
                f"scene is too large for the graphics adapter: it needs a buffer of {size:,} "
                f"bytes, {self.adapter.name} has at most {self.adapter.largest_buffer:,}"
            )
        flags = 0
        for usage in usages:
            flags |= getattr(self.wgpu.BufferUsage, usage)
        with translated(self.adapter):
            return self.handle.create_buffer(size=-(-size // 16) * 16, usage=flags)


_opened: dict[tuple[int, str], Device] = {}


def opened() -> Device:
    """The device of the chosen adapter, shared by all states of this process."""
    key = (os.getpid(), os.environ.get(ADAPTER_VARIABLE, ""))
    if key not in _opened:
        for device in _opened.values():
            device.check_process()
        _opened[key] = Device(chosen_adapter())
    return _opened[key]


@contextmanager
def using(adapter: Adapter) -> Iterator[None]:
    """A context in which new states take this adapter, as with CLOTHSIM_GPU_ADAPTER.

    Parameters
    ----------
    adapter : Adapter
        One of `adapters()`.

    Examples
    --------
    >>> import clothsim as cs
    >>> from clothsim.gpu import adapters, using
    >>> for adapter in adapters():  # doctest: +SKIP
    ...     with using(adapter):
    ...         run = cs.simulate(cs.scenes.paper_static(), 0.1, dt=1e-4, precision="single", backend="gpu")
    ...     print(adapter.name, run.report["steps_per_second"])
    """
    with _environment(ADAPTER_VARIABLE, str(adapter.place)):
        yield


@contextmanager
def translated(adapter: Adapter) -> Iterator[None]:
    """Translate errors of wgpu into errors of clothsim."""
    wgpu = load_wgpu()
    try:
        yield
    except wgpu.GPUError as error:
        text = " ".join(str(error).split())
        if "lost" in text.lower():
            _opened.clear()
            told = f"the graphics adapter {adapter.name} was lost, and with it the state; go on from a snapshot"
            raise RuntimeError(told) from error
        if isinstance(error, wgpu.GPUOutOfMemoryError) or "memory" in text.lower():
            raise MemoryError(f"the graphics adapter {adapter.name} is out of memory") from error
        raise RuntimeError(f"the graphics adapter {adapter.name} failed: {text}") from error
