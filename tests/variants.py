"""The ways in which the core computes a step, and the cases that a test takes of them.

The instruction set that is used by default gets the full product of a test's parameters; the others
get a pairwise array.
"""

import itertools
from dataclasses import dataclass

import clothsim as cs
import pytest
from clothsim.engine.options import KERNELS, PRECISIONS
from pairwise import pairwise

INSTRUCTION_SETS = tuple(cs.build_config()["instruction_sets_supported"])
NATIVE, *OTHERS = INSTRUCTION_SETS
FIXED = tuple(name for name, method in cs.integrators().items() if method.fixed)
NAMED_KERNELS = tuple(kernel for kernel in KERNELS if kernel != "auto")


@dataclass(frozen=True)
class Variant:
    """One of the ways in which the core can compute a step."""

    instruction_set: str
    kernel: str
    precision: str = "double"

    def __str__(self):
        return f"{self.instruction_set}-{self.kernel}-{self.precision}"

    @property
    def options(self):
        """Arguments of `step`; one thread, as that is what most tests are quickest with."""
        return {"kernel": self.kernel, "precision": self.precision, "threads": 1}


NATIVE_VARIANTS = [
    Variant(NATIVE, kernel, precision) for kernel in NAMED_KERNELS for precision in PRECISIONS
]


def _parametrize(names, rows):
    values = rows if len(names) > 1 else [value for (value,) in rows]
    return pytest.mark.parametrize(
        ",".join(names), values, indirect=["variant"] if "variant" in names else False, ids=str
    )


def cases(precision=PRECISIONS, **parameters):
    """Cases of `variant` and parameters: the full product natively, a pairwise array elsewhere.

    `precision`: the variants that count.
    """
    columns = [list(values) for values in parameters.values()]
    variants = [v for v in NATIVE_VARIANTS if v.precision in precision]
    rows = list(itertools.product(variants, *columns))
    for name, kernel, of, *values in (
        pairwise(OTHERS, NAMED_KERNELS, precision, *columns) if OTHERS else ()
    ):
        rows.append((Variant(name, kernel, of), *values))
    return _parametrize(["variant", *parameters], rows)


def pairs(**parameters):
    """Cases in which each value of a parameter meets each value of every other one."""
    return _parametrize(list(parameters), pairwise(*map(list, parameters.values())))
