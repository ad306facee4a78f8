"""Every hard case keeps to its figures: in double on the edge kernel, in single on the other."""

import dataclasses
import itertools

import clothsim as cs
import pytest

CASES = cs.scenes.hard_cases()
LONG = 10_000  # steps; for longer cases the default kernel is enough
MILLION = 10**6  # steps, from which on a case is slow
SLOW = pytest.mark.slow
KERNELS = {"double": "edge", "single": "gather"}


def variants(case):
    """Return the pairs of precision and kernel that a case is run with."""
    if case.steps > LONG:
        return [(precision, "auto") for precision in case.precisions]
    if len(case.precisions) == 2:
        return KERNELS.items()
    return itertools.product(case.precisions, ("edge", "gather"))


RUNS = [
    pytest.param(
        name,
        precision,
        kernel,
        id=f"{name}-{precision}-{kernel}",
        marks=SLOW if case.steps >= MILLION else (),
    )
    for name, case in CASES.items()
    for precision, kernel in variants(case)
]


@pytest.mark.parametrize("name, precision, kernel", RUNS)
def test_hard_case(name, precision, kernel):
    result = CASES[name].run(precision, kernel=kernel)
    assert len(result.figures) > 1
    failed = [figure for figure in result.figures if not figure.passed]
    assert not failed and result.passed


def test_a_wrong_outcome_is_seen():
    """The judges of one case over the run of another."""
    case = CASES["a point at rest inside"]
    assert (
        not dataclasses.replace(case, scene=CASES["a point at the exact centre"].scene).run().passed
    )
    assert not dataclasses.replace(CASES["dt at 1.05 of the limit"], dt=case.dt).run().passed
    assert not dataclasses.replace(CASES["dt at 0.95 of the limit"], dt=0.1).run().passed
    soft = CASES["a strip of 1 x 12"]
    stiffer = soft.scene.replace(cloth=soft.scene.cloth.replace(stiffness=1001.0))
    verdict = soft.judges[0](soft, dataclasses.replace(_end(soft), x=_end(soft, stiffer).x))
    assert not verdict[0].passed


def _end(case, scene=None):
    from clothsim.hard_cases import End

    stepper = cs.Stepper(scene or case.scene)
    stepper.advance(case.steps, case.dt)
    return End(stepper.positions, stepper.velocities, None, "double", "auto")
