"""The hard cases end on the adapter as they end in the gather kernel, errors included."""

import clothsim as cs
import numpy as np
import pytest

CASES = cs.scenes.hard_cases()
STEPS = 300  # of the longer ones, the first


def assert_same(arrays, expected, precision):
    """Equal but for subnormal numbers, which the core flushes to zero and an adapter may keep."""
    tiny = np.finfo(np.float32 if precision == "single" else np.float64).tiny
    for a, b in zip(arrays, expected, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=100 * tiny)


def outcome(case, precision, backend, steps):
    """What a run ends with: its state and clock, or all that its error tells."""
    stepper = cs.Stepper(case.scene, precision=precision, kernel="gather", backend=backend)
    try:
        stepper.advance(steps, case.dt)
    except cs.UnstableError as error:
        said = error.step, error.time, error.point, error.dt, error.max_stable_dt, str(error)
        return stepper.snapshot().core, (error.x, error.v), said
    return stepper.snapshot().core, (stepper.positions, stepper.velocities), None


# The core ends this run by its energy, which the adapter does not compare.
BY_ENERGY = "dt at 1.05 of the limit"


@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
@pytest.mark.parametrize("name", [name for name in CASES if name != BY_ENERGY])
def test_it_ends_as_in_the_core(name, needs_float64):
    case = CASES[name]
    steps = min(case.steps, STEPS)
    for precision in case.precisions:
        cpu, gpu = (outcome(case, precision, backend, steps) for backend in ("cpu", "gpu"))
        assert gpu[2] == cpu[2], precision
        clocks = [[core["time"], core["clock_steps"], core["clock_step"]] for core in (gpu[0], cpu[0])]
        assert clocks[0] == clocks[1], precision
        assert_same(gpu[1], cpu[1], precision)
