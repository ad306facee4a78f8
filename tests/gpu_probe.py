"""Measurements of an adapter: the mass point of each invocation, and rounding of its arithmetic."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from clothsim import Cloth, Scene, thread_grid
from clothsim.gpu.device import Device, open_device, translate_errors
from clothsim.gpu.shader import Features, keep_function_wgsl, step_wgsl

_COUNT = 1 << 14
# Of `results` in layout.wgsl.
_RESULTS = 8
_PROBE = Path(__file__).with_suffix(".wgsl").read_text()

# Result of each probe from a and b, here and in WGSL; `z` is a zero that no compiler knows.
_OPERATIONS: dict[str, tuple[str, Callable[..., Any]]] = {
    "product": ("a * b", lambda a, b: a * b),
    "quotient": ("a / b", lambda a, b: a / b),
    "root": ("sqrt(a)", lambda a, b: np.sqrt(a)),
    "reciprocal of root": ("T(1.0) / sqrt(a)", lambda a, b: a.dtype.type(1) / np.sqrt(a)),
    "product and sum": ("a * b + a", lambda a, b: a * b + a),
    "compensation": ("b - ((a + b) - a)", lambda a, b: b - ((a + b) - a)),
    "compensation, kept": ("b - (keep(a + b) - a)", lambda a, b: b - ((a + b) - a)),
    "subnormal": ("a * T(1e-40)", lambda a, b: a * a.dtype.type(1e-40)),
}


def _run(
    device: Device,
    code: str,
    entry_point: str,
    data: list[np.ndarray],
    size: int,
    groups: tuple[int, ...],
    out_binding: int,
) -> bytes:
    """Run one dispatch with `data` bound from 0, the first as uniform; return the written array."""
    handle = device.handle
    with translate_errors(device.adapter):
        out = device.create_buffer(size, "STORAGE", "COPY_SRC")
        buffers = []
        for k, values in enumerate(data):
            buffer = device.create_buffer(values.nbytes, "STORAGE" if k else "UNIFORM", "COPY_DST")
            handle.queue.write_buffer(buffer, 0, values)
            buffers.append(buffer)
        module = handle.create_shader_module(code=code)
        pipeline = handle.create_compute_pipeline(
            layout="auto", compute={"module": module, "entry_point": entry_point}
        )
        bound = [*enumerate(buffers), (out_binding, out)]
        entries = [{"binding": k, "resource": {"buffer": buffer}} for k, buffer in bound]
        layout = pipeline.get_bind_group_layout(0)
        bindings = handle.create_bind_group(layout=layout, entries=entries)
        encoder = handle.create_command_encoder()
        work = encoder.begin_compute_pass()
        work.set_pipeline(pipeline)
        work.set_bind_group(0, bindings)
        work.dispatch_workgroups(*groups)
        work.end()
        handle.queue.submit([encoder.finish()])
        return bytes(handle.queue.read_buffer(out, 0, size))


_THREAD_IDS = """
@compute @workgroup_size(group_size, group_size, 1)
fn thread_ids(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) thread: vec3<u32>,
    @builtin(global_invocation_id) dispatch: vec3<u32>,
) {
    if (!inside(dispatch)) { return; }
    let index = place(dispatch);
    var ids = array<u32, 7>(group.x, group.y, thread.x, thread.y, dispatch.x, dispatch.y, index);
    for (var k = 0u; k < 7u; k++) { atomicStore(&results[7u * index + k], ids[k]); }
}
"""


def thread_ids(shape: tuple[int, int]) -> npt.NDArray[np.void]:
    """Return `thread_grid` as the adapter has it: each invocation of the shader writes its own."""
    dtype = thread_grid(shape).dtype
    rows, columns = shape
    device = open_device()
    plain = Features.of_scene(Scene(Cloth((2, 2))))
    code = step_wgsl(plain, "single", device.float64) + _THREAD_IDS
    constants = np.array([*[0] * 4, rows, columns, *[0] * 10], np.uint32)
    names = ("group_x", "group_y", "thread_x", "thread_y", "dispatch_x", "dispatch_y", "index")
    size = 4 * len(names) * rows * columns
    raw = _run(
        device,
        code,
        "thread_ids",
        [constants],
        size,
        (-(-columns // 16), -(-rows // 16), 1),
        _RESULTS,
    )
    numbers = np.frombuffer(raw, np.uint32).reshape(rows, columns, len(names))
    ids = np.empty((rows, columns), dtype)
    for k, name in enumerate(names):
        ids[name] = numbers[..., k]
    return ids


def arithmetic(device: Device | None = None) -> dict[str, dict[str, Any]]:
    """Return the adapter's rounding of each operation, by type.

    It is the largest difference from the correctly rounded result, in units in the last place, of
    numbers over 40 powers of two.

    WGSL lets a compiler fuse products with sums and replace (a + b) - a by b; the shader passes
    such values through `keep`.
    """
    device = device or open_device()
    types = {"float32": "f32", **({"float64": "f64"} if device.float64 else {})}
    rng = np.random.default_rng(8)
    sets = {}
    for name, word in types.items():
        scales = np.exp2(rng.integers(-20, 21, (2, _COUNT)))
        a, b = (rng.uniform(1, 2, (2, _COUNT)) * scales).astype(name)
        errors = {}
        for operation, (wgsl, numpy) in _OPERATIONS.items():
            if operation == "subnormal" and word == "f64":
                continue
            # A function of every binding, so that none is left out of the automatic layout.
            write = "if (id.x + z < n) { out[id.x] = value; } else { out[0] = b; }"
            out = f"let value = {wgsl}; {write}"
            keep = keep_function_wgsl(word, zero="z")
            code = f"alias T = {word};\n{keep}\n{_PROBE.replace('OUT', out)}"
            data = [np.zeros(4, np.uint32), a, b]
            raw = _run(device, code, "probe", data, a.nbytes, (_COUNT // 256, 1, 1), len(data))
            result = np.frombuffer(raw, name)
            exact = numpy(a, b)
            ulp = np.spacing(np.maximum(np.abs(exact), np.finfo(name).tiny))
            errors[operation] = float((np.abs(result.astype(float) - exact) / ulp).max())
        sets[name] = errors
    return sets
