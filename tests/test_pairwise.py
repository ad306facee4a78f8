"""The generator of pairwise arrays: whole, and far smaller than the product."""

import itertools
import math

import pytest
from pairwise import pairwise


@pytest.mark.parametrize("sizes", [(2, 2), (5,), (6, 7, 3, 2), (2, 3, 2, 7, 3, 2, 2), (12, 7, 3, 2, 2)], ids=str)
def test_every_pair_of_values_occurs(sizes):
    columns = [[f"{i}.{k}" for k in range(size)] for i, size in enumerate(sizes)]
    rows = pairwise(*columns)
    for i, j in itertools.combinations(range(len(sizes)), 2):
        assert {(row[i], row[j]) for row in rows} == set(itertools.product(columns[i], columns[j]))
    # No array can have fewer rows than the two longest columns have pairs.
    assert len(rows) <= 1.1 * math.prod(sorted(sizes)[-2:])
