"""The hard cases end on the adapter as they end in the strict core, errors included."""

import clothsim as cs
import pytest

CASES = cs.scenes.hard_cases()
STEPS = 300  # of the longer ones, the first


def outcome(case, precision, backend, steps):
    """What a run ends with: its state and clock, or all that its error tells."""
    stepper = cs.Stepper(case.scene, precision=precision, strict=True, backend=backend)
    try:
        stepper.advance(steps, case.dt)
    except cs.UnstableError as error:
        said = error.step, error.time, error.point, error.dt, error.max_stable_dt, str(error)
        return stepper.snapshot().core, (error.x, error.v), said
    return stepper.snapshot().core, (stepper.positions, stepper.velocities), None


@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
@pytest.mark.parametrize("name", CASES)
def test_it_ends_as_in_the_core(name, needs_float64, same_bits):
    case = CASES[name]
    steps = min(case.steps, STEPS)
    for precision in case.precisions:
        cpu, gpu = (outcome(case, precision, backend, steps) for backend in ("cpu", "gpu"))
        assert gpu[2] == cpu[2], precision
        clocks = [[core["time"], core["clock_steps"], core["clock_step"]] for core in (gpu[0], cpu[0])]
        assert clocks[0] == clocks[1], precision
        assert same_bits(gpu[1], cpu[1]), precision
