"""Values: the model hashes as it compares, and what is long prints short."""

import copy
import json
import pickle

import clothsim as cs
import numpy as np
import pytest


def scene_with_arrays(zero=0.0, dtype=np.float64):
    cloth = cs.Cloth(
        (6, 5), mass=np.full((6, 5), 0.5), damping={"structural": 1, "shear": 2, "bend": 3}
    )
    position = cloth.rest_positions.astype(dtype) + zero
    motion = cs.Keyframes([0, 1], [(0, zero, 0), (1, 0, 0)])
    return cs.Scene(cloth, cs.Sphere((0, -1, 0), motion=motion), position=position)


PAIRS = [
    (cs.Cloth(), cs.Cloth()),
    (cs.Cloth(stiffness=2), cs.Cloth(stiffness=2.0)),
    (cs.Cloth(size=(1, 2)), cs.Cloth(size=np.array([1.0, 2.0]))),
    (cs.Sphere(motion=cs.Linear((0, -0.0, 1))), cs.Sphere(motion=cs.Linear((0, 0, 1)))),
    (cs.Reciprocate((1, 0, 0)), cs.Reciprocate((1, 0, 0))),
    (scene_with_arrays(0.0), scene_with_arrays(0.0)),
    (scene_with_arrays(-0.0), scene_with_arrays(0.0)),
    (cs.scenes.paper_moving(), cs.scenes.paper_moving()),
]


FAMILIES = ("structural", "shear", "bend")
VALUES = [
    cs.Cloth(),
    cs.Cloth((2, 3), mass=np.arange(1.0, 7.0).reshape(2, 3), pins=np.eye(2, 3) > 0),
    cs.Cloth(springs=("bend", "structural"), stiffness={"structural": 1, "bend": 0.1}),
    cs.Cloth(damping=0.1, drag=0.3, pins=()),
    cs.Cloth(springs=(), stiffness={}, damping={}),
    cs.Cloth(stiffness=dict.fromkeys(FAMILIES, 2)),
    cs.Sphere(),
    cs.Sphere(np.array([1, 2, 3]), np.float32(0.5), response="ray", offset=0.01, as_printed=True),
    cs.Sphere(motion=cs.Reciprocate((1, 0, 0)), response="reflect", offset="none"),
    cs.Sphere(
        motion=cs.Keyframes([0, 1], np.eye(2, 3)), response="reflect", restitution=0.5, friction=0.3
    ),
    cs.Sphere(thickness=0.01, stiffness=1e5, dissipation=0.0, friction=0.3, slip_speed=1e-3),
    cs.Plane(normal=(0.0, 2.0, 0.0), dissipation=1.0),
    cs.Linear((1.0, -2.0, 0.5)),
    cs.Reciprocate((0.0, 3.0, 4.0), distance=0.8, period=1.7, deceleration=3.0, phase=0.3),
    cs.Keyframes([0.0, 0.4, 1.3], [(0, 0, 0), (0.3, 0.6, 0), (1, 2, -1)], smooth=True),
    cs.Sinusoid((0.1, 0, 0), 2.0),
    cs.scenes.paper_swing(),
    scene_with_arrays(),
    scene_with_arrays().replace(gravity=(1, 2, 3), spheres=(cs.Sphere(), cs.Sphere(radius=0.1))),
    scene_with_arrays().replace(velocity=np.ones((6, 5, 3)) * ~cs.Cloth((6, 5)).pinned[..., None]),
]


@pytest.mark.parametrize("value", VALUES)
def test_values_round_trip(value):
    copies = (
        type(value).from_dict(json.loads(json.dumps(value.to_dict()))),
        pickle.loads(pickle.dumps(value)),
    )
    for copied_value in (*copies, copy.deepcopy(value), value.replace()):
        assert copied_value == value
    assert all(value != different for different in VALUES if different is not value)


@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_equal_values_have_one_hash(one, other):
    assert one is not other and one == other
    assert hash(one) == hash(other) and len({one, other}) == 1
    assert hash(pickle.loads(pickle.dumps(one))) == hash(one)


def test_long_arrays_print_as_their_shape():
    shape = (64, 48)
    pins = np.ones(shape, bool)
    cloth = cs.Cloth(shape, mass=np.ones(shape), pins=pins)
    scene = cs.Scene(cloth, [cs.Sphere()] * 50, position=cloth.rest_positions)
    text = repr(scene)
    assert len(text) < 700
    assert (
        "mass=<array of shape (64, 48)>" in text and "position=<array of shape (64, 48, 3)>" in text
    )
    assert "pins=<3072 entries, the first (0, 0)>" in text
    assert "spheres=<50 entries, the first Sphere(center=(0.0, 0.0, 0.0), " in text
