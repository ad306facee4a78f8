"""Wall time and error of three integrators: which one is the fastest for the error that you need?"""

import clothsim as cs
import matplotlib.pyplot as plt

scene = cs.scenes.paper_swing()
methods = ["velocity_verlet", "rk4", "dop853"]
data = cs.work_precision(scene, 0.02, methods, windows=1)

figure, axes = plt.subplots(figsize=(6, 4))
for one in data.transpose("solver", ...).rms_error:
    wall_time = data.wall_time.sel(solver=one.solver)
    name = str(one.integrator.values)
    axes.loglog(wall_time, one, "o-", label=name)
    print(f"{name}: smallest rms error {float(one.min()):.0e} m")
axes.set(xlabel="wall seconds per simulated second", ylabel="rms error [m]")
axes.legend()
figure.savefig("speed_against_error.png")
