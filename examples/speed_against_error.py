"""Wall time and error of three integrators: which is the fastest for the error that you need?"""

import clothsim as cs

scene = cs.scenes.paper_swing()
data = cs.work_precision(scene, 0.1, ["velocity_verlet", "rk4", "dop853 adaptive"], windows=2)
for one in data.rms_error:
    print(f"{one.solver.item()}: smallest rms error {float(one.min()):.0e} m")
by_time, by_evaluations = data.clothsim.plot()
by_time.figure.savefig("speed_against_error.png")
