"""The adapters of this machine, the choice of an adapter, and its errors as errors of clothsim.

Only this module imports wgpu, at the first use of an adapter.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from ..base.extras import import_from_extra

ADAPTER_VARIABLE = "CLOTHSIM_GPU_ADAPTER"
# `keep` takes float64 through integers of its size.
FLOAT64 = ("shader-f64", "shader-int64")

# Drivers that the backend is written for; OpenGL would lack float64 and large buffers.
_BACKENDS = ("Vulkan", "Metal", "D3D12")
_ORDER = ("DiscreteGPU", "IntegratedGPU", "VirtualGPU", "CPU", "Unknown")
_LIMITS = ("max-buffer-size", "max-storage-buffer-binding-size")


@cache
def import_wgpu() -> Any:
    """Return the module wgpu, or raise an ImportError that names the extra."""
    wgpu = import_from_extra("wgpu", "backend 'gpu'", "gpu")
    extras = import_from_extra("wgpu.backends.wgpu_native", "backend 'gpu'", "gpu").extras
    # OpenGL, and Mesa's layer that asks a display for its adapter, write to stderr if there is no
    # display.
    if "XDG_RUNTIME_DIR" not in os.environ:
        os.environ.setdefault("NODEVICE_SELECT", "1")
    extras.set_instance_extras(backends=("Vulkan", "Metal", "DX12"))
    return wgpu


@dataclass(frozen=True)
class Adapter:
    """One graphics adapter, as `adapters` describes it."""

    name: str
    kind: str  # "DiscreteGPU", "IntegratedGPU", "VirtualGPU", "CPU" (software) or "Unknown"
    api: str
    driver: str
    float64: bool  # whether its shaders compute in double precision
    largest_buffer: int  # bytes that one of a cloth's buffers may have
    handle: Any = field(repr=False, compare=False)  # as wgpu has it
    place: int = 0  # in `adapters()`; CLOTHSIM_GPU_ADAPTER takes it too

    @property
    def software(self) -> bool:
        """Whether this adapter is a CPU that runs shaders, no GPU."""
        return self.kind == "CPU"

    def __str__(self) -> str:
        note = ", a CPU that runs shaders, no GPU" if self.software else ""
        return f"{self.name} ({self.api}{note})"


def adapters() -> list[Adapter]:
    """Return the graphics adapters that `backend="gpu"` can use, best first.

    Returns
    -------
    list of Adapter
        Discrete adapters come first, software adapters (Mesa's lavapipe) last. The list may be
        empty. Each has name, kind, api, driver, float64 (whether its shaders have double precision)
        and largest_buffer [bytes].

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
    handles = [
        handle
        for handle in import_wgpu().gpu.enumerate_adapters_sync()
        if handle.info["backend_type"] in _BACKENDS
    ]
    handles.sort(key=lambda handle: _ORDER.index(handle.info["adapter_type"]))
    return [
        Adapter(
            name=str(handle.info["device"]).strip(),
            kind=str(handle.info["adapter_type"]),
            api=str(handle.info["backend_type"]),
            driver=str(handle.info["description"]).strip(),
            float64=set(FLOAT64) <= set(handle.features),
            largest_buffer=min(int(handle.limits[name]) for name in _LIMITS),
            handle=handle,
            place=place,
        )
        for place, handle in enumerate(handles)
    ]


def chosen_adapter() -> Adapter:
    """Return the adapter in use: the best, or that of CLOTHSIM_GPU_ADAPTER by name or by number
    from 0.
    """
    choices = adapters()
    if not choices:
        raise RuntimeError(
            "backend 'gpu' found no Vulkan, Metal or Direct3D 12 adapter; install the graphics "
            "driver, or Mesa's software one (Debian: mesa-vulkan-drivers)"
        )
    name = os.environ.get(ADAPTER_VARIABLE, "")
    for adapter in sorted(choices, key=lambda adapter: name != str(adapter.place)):
        if name == str(adapter.place) or name.lower() in adapter.name.lower():
            return adapter
    raise ValueError(
        f"{ADAPTER_VARIABLE} must be part of the name of an adapter, or its place from 0 on, "
        f"({', '.join(repr(a.name) for a in choices)}), got {name!r}"
    )


class Device:
    """An opened adapter."""

    def __init__(self, adapter: Adapter, float64: bool = True) -> None:
        self.wgpu = import_wgpu()
        self.adapter = adapter
        self._process = os.getpid()
        self.float64 = adapter.float64 and float64
        limits = adapter.handle.limits
        with translate_errors(adapter):
            self.handle = adapter.handle.request_device_sync(
                required_features=list(FLOAT64) if self.float64 else [],
                required_limits={name: limits[name] for name in _LIMITS},
            )
        self.groups_limit = int(self.handle.limits["max-compute-workgroups-per-dimension"])

    def check_process(self) -> None:
        """Raise an error in a fork of the process that opened this device."""
        if os.getpid() != self._process:
            raise RuntimeError(
                "backend 'gpu' cannot be used in a process forked from one that has used it; start "
                "processes with the method 'spawn'"
            )

    def create_buffer(self, size: int, *usages: str) -> Any:
        """Return a buffer of `size` bytes."""
        usage = sum(getattr(self.wgpu.BufferUsage, name) for name in usages)
        return self.handle.create_buffer(size=-(-size // 16) * 16, usage=usage)


_opened: dict[str, Device] = {}


def open_device() -> Device:
    """Return the device of the chosen adapter, shared by all states of this process."""
    for device in _opened.values():
        device.check_process()
    name = os.environ.get(ADAPTER_VARIABLE, "")
    if name not in _opened:
        _opened[name] = Device(chosen_adapter())
    return _opened[name]


@contextmanager
def using(adapter: Adapter) -> Iterator[None]:
    """Return a context in which new states take this adapter, as with CLOTHSIM_GPU_ADAPTER.

    Parameters
    ----------
    adapter : Adapter
        One of `adapters()`.

    Examples
    --------
    >>> from clothsim.gpu import adapters, using
    >>> scene = cs.scenes.paper_static()
    >>> for adapter in adapters():  # doctest: +SKIP
    ...     with using(adapter):
    ...         run = cs.simulate(scene, 0.1, dt=1e-4, precision="single", backend="gpu")
    """
    previous = os.environ.get(ADAPTER_VARIABLE, "")
    os.environ[ADAPTER_VARIABLE] = str(adapter.place)
    try:
        yield
    finally:
        os.environ[ADAPTER_VARIABLE] = previous


@contextmanager
def translate_errors(adapter: Adapter) -> Iterator[None]:
    """Translate errors of wgpu into errors of clothsim."""
    wgpu = import_wgpu()
    try:
        yield
    except wgpu.GPUError as error:
        text = " ".join(str(error).split())
        if "lost" in text.lower():
            raise RuntimeError(
                f"the graphics adapter {adapter.name} was lost; restart the process, and go on "
                "from a snapshot"
            ) from error
        if isinstance(error, wgpu.GPUOutOfMemoryError) or "memory" in text.lower():
            raise MemoryError(f"the graphics adapter {adapter.name} is out of memory") from error
        raise RuntimeError(f"the graphics adapter {adapter.name} failed: {text}") from error
