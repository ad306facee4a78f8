"""The paper's third experiment in small: steps a second with methods 1 and 2, in windows."""

import clothsim as cs
import matplotlib.pyplot as plt

WINDOW = 0.02  # s of simulated time

figure, axes = plt.subplots(figsize=(6, 4))
for name, scene in (
    ("method 1", cs.scenes.paper_static("reflect")),
    ("method 2", cs.scenes.paper_static("ray")),
):
    run = cs.simulate(scene, WINDOW, dt=1e-4, threads=1)
    rates = []
    for _ in range(20):
        run = run.resume(WINDOW)
        rates.append(run.report["steps_per_second"])
    print(f"{name}: {sorted(rates)[10]:,.0f} steps/s")
    axes.plot([WINDOW * (window + 1) for window in range(20)], rates, "o-", label=name)
axes.set(xlabel="simulated time [s]", ylabel="steps/s", ylim=(0, None))
axes.legend()
figure.savefig("paper_frame_rate.png")
