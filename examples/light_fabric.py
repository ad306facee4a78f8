"""Hang measured fabrics, and ask which term limits the time step of each."""

import clothsim as cs

for name in ("cotton", "denim"):
    scene = getattr(cs.scenes, name)(shape=(12, 12))
    print(f"{name:7} stable up to {cs.max_stable_dt(scene):.2e} s")
    run = cs.simulate(scene, 0.05, dt=0.5 * cs.max_stable_dt(scene))
    print(f"        largest stretch {100 * run.report['stretch']['largest']:.2f} %")
    run.picture(path=f"light_fabric_{name}.png", color="stretch", label=True)
