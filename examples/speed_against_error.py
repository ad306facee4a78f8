"""Wall time and error of three integrators: which one is the fastest for the error that you need?"""

import clothsim as cs
import matplotlib.pyplot as plt

scene = cs.scenes.paper_swing()
methods = ["velocity_verlet", "rk4", "dop853"]
data = cs.work_precision(scene, 0.1, methods, precisions=["double"], windows=1)

figure, axes = plt.subplots(figsize=(6, 4))
for method, group in data.groupby("method"):
    one = group.squeeze()
    axes.loglog(one.wall_time, one.rms_error, "o-", label=str(method))
    print(f"{method}: {one.rms_error.size} settings, smallest rms error {float(one.rms_error.min()):.0e} m")
axes.set(xlabel="wall time [s]", ylabel="rms error [m]")
axes.legend()
figure.savefig("speed_against_error.png")
