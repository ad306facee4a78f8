"""The paper's fourth experiment in small: the scalar reference, the core, and a graphics card where one is."""

import time
from contextlib import suppress

import clothsim as cs
import matplotlib.pyplot as plt
from clothsim import gpu

DT = 1e-4
scene = cs.scenes.paper_static()
x, v = scene.initial_position, scene.initial_velocity


def rate(steps, backend=None):
    """Steps a second of the second of two calls."""
    for _ in range(2):
        start = time.perf_counter()
        if backend == "reference":
            cs.reference_step(scene, x, v, DT, steps)
        else:
            cs.step(scene, x, v, DT, steps, backend=backend, precision="single")
        wall = time.perf_counter() - start
    return steps / wall


rates = {"scalar reference": rate(100, "reference"), "core": rate(2000, "cpu")}
with suppress(ImportError):  # without wgpu there is no graphics card
    if cards := [adapter for adapter in gpu.adapters() if adapter.kind != "CPU"]:
        rates[cards[0].name] = rate(2000, "gpu")
for name, value in rates.items():
    print(f"{name}: {value:,.0f} steps/s")
figure, axes = plt.subplots(figsize=(6, 3), layout="constrained")
axes.barh(list(rates), list(rates.values()))
axes.set(xlabel="steps/s", xscale="log")
figure.savefig("paper_cpu.png")
