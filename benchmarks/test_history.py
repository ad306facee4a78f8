"""A handful of stable cases whose history pytest-benchmark keeps; see docs/benchmarks.md."""

import clothsim as cs
import pytest
from clothsim.lab.bench import works
from clothsim.lab.bench.bench_settings import PAPER_DT
from clothsim.lab.bench.sections import kernels

STEPS = 500
ROUNDS = {"rounds": 40, "warmup_rounds": 2}


@pytest.mark.parametrize("kernel", kernels())
@pytest.mark.parametrize("precision", ("single", "double"))
@pytest.mark.parametrize("threads", (1, 2))
@pytest.mark.parametrize("bend", (False, True), ids=("3906", "5826"))
def test_step(benchmark, kernel, precision, threads, bend):
    start = works.paper(bend, sphere=True)
    stepper = cs.Stepper(start.scene, start.x, start.v, t=start.t, kernel=kernel, precision=precision, threads=threads)
    benchmark.extra_info["steps"] = STEPS
    benchmark.pedantic(stepper.advance, (STEPS, PAPER_DT), **ROUNDS)


@pytest.mark.parametrize("precision", ("single", "double"))
def test_batch(benchmark, precision):
    start = works.batch()
    stepper = cs.Stepper(start.scene, start.x, start.v, t=start.t, precision=precision)
    benchmark.pedantic(stepper.advance, (20, PAPER_DT), **ROUNDS)


@pytest.mark.parametrize("precision", ("single", "double"))
def test_large(benchmark, precision):
    start = works.grid(512)
    stepper = cs.Stepper(start.scene, start.x, start.v, precision=precision)
    benchmark.pedantic(stepper.advance, (2, PAPER_DT), rounds=15, warmup_rounds=1)


def test_scalar_reference(benchmark):
    start = works.paper(True, sphere=True)
    arguments = (start.scene, start.x, start.v, PAPER_DT, 20, start.t)
    benchmark.pedantic(cs.reference_step, arguments, **ROUNDS)
