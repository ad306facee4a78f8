"""Arguments that a sweep refuses, and the documentation of its metrics."""

import operator

import clothsim as cs
import numpy as np
import pytest
from clothsim.sweeps import metrics
from tables import each

pytest.importorskip("xarray")

SMALL = cs.scenes.hanging(shape=(6, 7), springs=("structural", "shear"))


def sweep(*args, **options):
    return cs.sweep(*args, progress=False, **options)


@each(
    ("arguments", "error", "message"),
    [
        ({"over": {"stiffness": [1.0, -5.0]}}, ValueError, "member stiffness=-5.0.*stiffness must be"),
        ({"over": {"dt": [0.0]}}, ValueError, "dt must be"),
        ({"over": {"precision": ["half"]}}, ValueError, "precision must be one of"),
        ({"over": {"integrator": ["rk5"]}}, ValueError, "integrator must be one of"),
        ({"over": {"stiffness": []}}, ValueError, "at least one value"),
        ({"over": {"stiffness": 3.0}}, TypeError, "sequence of values"),
        ({"over": {"precision": "single"}}, TypeError, "sequence of values"),
        ({"over": {("dt", "mass"): [(1.0,)]}}, ValueError, "2 values in each row"),
        ({"over": {("dt", "mass"): [(1e-3, 1.0)], "dt": [1e-3]}}, ValueError, "more than once"),
        ({"over": [{"mass": 1.0}, {"dt": 1.0}]}, ValueError, "the same names"),
        ({"over": [3.0]}, TypeError, "sequence of mappings"),
        ({"metrics": "eror"}, ValueError, "'error'"),
        ({"metrics": ["stable", 3]}, TypeError, "metrics"),
        ({"metrics": {"error": len}}, ValueError, "must not be named"),
        ({"metrics": {"no name": len}}, ValueError, "needs a name"),
        ({"metrics": {"status": len}}, ValueError, "'status', every sweep has a variable"),
        ({"metrics": {"max_stable_dt": len}}, ValueError, "'max_stable_dt', every sweep has a variable"),
        ({"over": {("mass", "mass"): [(1.0, 2.0)]}}, ValueError, "each thing once.*'mass', 'mass'"),
        ({"over": {"threads": [1, 2]}}, ValueError, "'threads', which is the same for all members"),
        ({"over": {"sphere1_radius": [0.1]}}, ValueError, "needs a sphere with the index 1; the scene has 0 spheres"),
        ({"dt": 1e-3, "over": {"dt": [1e-3]}}, ValueError, "dt must be left out.*got dt = 0.001 beside its swept values"),
        ({"precision": "single", "over": [{"precision": "double"}]}, ValueError, "precision must be left out"),
        ({"resume": 1, "store": __file__}, TypeError, "resume must be True or False"),
        ({"metrics": {"mass": operator.length_hint}, "over": {"mass": [1.0]}}, ValueError, "'mass', a coordinate"),
        ({"task_seconds": 0.1}, ValueError, "task_seconds"),
        ({"frames": True, "over": {"duration": [1.0]}}, ValueError, "frames"),
        ({"frames": True, "every": 3, "over": {"dt": [1e-3]}}, ValueError, "every"),
        ({"store": __file__}, ValueError, "store"),
    ],
)
def test_bad_input_is_refused(arguments, error, message):
    given = {"duration": 0.01, "progress": False, **arguments}
    with pytest.raises(error, match=message):
        cs.sweep(SMALL, **given)


def test_an_impossible_member_of_a_large_grid_is_found():
    over = {"stiffness": np.linspace(1, 2, 100), "mass": [*np.linspace(1, 2, 99), -1.0]}
    with pytest.raises(ValueError, match="mass=-1.0"):
        sweep(SMALL, over, duration=1.0)


def test_no_scene_is_a_type_error():
    with pytest.raises(TypeError, match="scene must be a Scene"):
        sweep("paper_swing")


def test_metric_names_are_documented():
    for name in metrics.METRICS:
        assert f'"{name}"' in cs.sweep.__doc__
