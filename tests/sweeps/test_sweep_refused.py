"""Arguments that a sweep refuses, and the documentation of its metrics."""

import clothsim as cs
import numpy as np
import pytest
from clothsim.sweeps import metrics

pytest.importorskip("xarray")

SMALL = cs.scenes.hanging(shape=(6, 7), springs=("structural", "shear"))


def sweep(*args, **options):
    return cs.sweep(*args, progress=False, **options)


def test_an_impossible_member_of_a_large_grid_is_found():
    over = {"stiffness": np.linspace(1, 2, 100), "mass": [*np.linspace(1, 2, 99), -1.0]}
    with pytest.raises(ValueError, match="mass=-1.0"):
        sweep(SMALL, over, duration=1.0)


def test_metric_names_are_documented():
    for name in metrics.METRICS:
        assert f'"{name}"' in cs.sweep.__doc__
