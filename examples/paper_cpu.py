"""The paper's fourth experiment in small: the scalar reference, the core, and a graphics card where
one is.
"""

import time
from contextlib import suppress

import clothsim as cs
import matplotlib.pyplot as plt
from clothsim import gpu

DT = 1e-4
scene = cs.scenes.paper_static()
x, v = scene.initial_position, scene.initial_velocity


def rate(steps, call, **options):
    """Return steps a second of the second of two calls."""
    call(scene, x, v, DT, steps, **options)
    start = time.perf_counter()
    call(scene, x, v, DT, steps, **options)
    return steps / (time.perf_counter() - start)


rates = {
    "scalar reference": rate(100, cs.reference_step),
    "core": rate(2000, cs.step, precision="single"),
}
with suppress(ImportError):  # without wgpu there is no graphics card
    if cards := [adapter for adapter in gpu.adapters() if adapter.kind != "CPU"]:
        rates[cards[0].name] = rate(2000, cs.step, precision="single", backend="gpu")
for name, value in rates.items():
    print(f"{name}: {value:,.0f} steps/s")
figure, axes = plt.subplots(figsize=(6, 3), layout="constrained")
axes.plot(list(rates.values()), list(rates), "o")
axes.set(xlabel="steps/s", xscale="log")
axes.margins(y=0.3)
axes.grid(alpha=0.3)
figure.savefig("paper_cpu.png")
