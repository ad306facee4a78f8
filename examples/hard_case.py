"""Run the hard cases, and see how a run above the stable time step ends."""

import clothsim as cs

for name, case in cs.scenes.hard_cases().items():
    if case.steps > 5_000:
        continue  # the tests run all of them
    stepper = cs.Stepper(case.scene, precision=case.precisions[0])
    try:
        stepper.advance(case.steps, case.dt)
        outcome = f"takes {case.steps} steps"
    except cs.UnstableError as error:
        outcome = f"is unstable at step {error.step}"
    print(f"{name:38} {outcome}: {case.why}")

scene = cs.scenes.paper_swing()
limit = cs.max_stable_dt(scene)
try:
    cs.simulate(scene, 1.0, dt=3 * limit)
except cs.UnstableError as error:
    print(error)
cs.simulate(scene, 1.0, dt=0.9 * limit).picture(path="hard_case.png")  # below the limit
