"""The cloth: springs, rest lengths, masses, pins, and what it refuses."""

import copy
import pickle

import numpy as np
import pytest
from clothsim.model.cloth import Cloth

DEFAULT = ("structural", "shear", "bend")  # families
SHAPES = [(32, 32), (2, 2), (3, 5), (17, 4), (2, 1), (1, 7), (1, 2), (16, 33)]


def springs_by_definition(rows, columns):
    """{(i, j): (family, steps along the rows, along the columns)}, point by point."""
    steps = {"structural": [(0, 1), (1, 0)], "shear": [(1, 1), (1, -1)], "bend": [(0, 2), (2, 0)]}
    springs = {}
    for r in range(rows):
        for c in range(columns):
            for family, offsets in steps.items():
                for dr, dc in offsets:
                    if r + dr < rows and 0 <= c + dc < columns:
                        ends = (r * columns + c, (r + dr) * columns + c + dc)
                        springs[ends] = (family, dr, dc)
    return springs


@pytest.mark.parametrize("shape", SHAPES)
def test_springs_are_those_of_the_definition(shape):
    cloth = Cloth(shape=shape, size=(0.7, 2.1), pins=())
    table = cloth.spring_table()
    expected = springs_by_definition(*shape)
    assert len(table) == len(expected) == cloth.spring_count()
    assert (table["i"] < table["j"]).all()
    springs = {(int(s["i"]), int(s["j"])): str(s["family"]) for s in table}
    assert springs == {ends: family for ends, (family, _, _) in expected.items()}
    for family in DEFAULT:
        assert cloth.spring_count(family) == int((table["family"] == family).sum())


@pytest.mark.parametrize("shape", SHAPES)
def test_rest_lengths_are_the_distances_of_the_flat_sheet(shape):
    cloth = Cloth(shape=shape, size=(0.7, 2.1), pins=())
    table = cloth.spring_table()
    x = cloth.rest_positions.reshape(-1, 3)
    distance = np.linalg.norm(x[table["j"]] - x[table["i"]], axis=1)
    # Coordinates up to 2.1 m are rounded to 2.2e-16 m each.
    np.testing.assert_allclose(table["rest_length"], distance, rtol=0, atol=1e-15)


def test_each_family_has_its_own_numbers():
    stiffness = {"bend": 3.0, "structural": 1.0, "shear": 2.0}
    cloth = Cloth(stiffness=stiffness, damping={"structural": 0.1, "shear": 0, "bend": 0.3})
    assert cloth.family_stiffness == stiffness
    assert list(cloth.family_stiffness) == list(DEFAULT)
    table = cloth.spring_table()
    for family, k, c in [("structural", 1, 0.1), ("shear", 2, 0), ("bend", 3, 0.3)]:
        of = table[table["family"] == family]
        assert (of["stiffness"] == k).all() and (of["damping"] == c).all()
    with pytest.raises(TypeError):
        cloth.stiffness["bend"] = -1.0
    stiffness["bend"] = -1.0
    assert cloth.family_stiffness["bend"] == 3.0


def test_springs_and_points_are_damped():
    spring = Cloth(damping=7.0)
    assert (spring.drag, set(spring.family_damping.values())) == (0.0, {7.0})
    point = Cloth(damping=0.0, drag=7.0)
    assert (point.drag, set(point.family_damping.values())) == (7.0, {0.0})
    assert (point.spring_table()["damping"] == 0).all()
    assert spring.damped and point.damped
    assert not Cloth(damping=0).damped
    assert not Cloth(damping=0.0, drag=0).damped
    assert not Cloth(damping=5.0, springs=()).damped
    cloth = Cloth(damping=dict.fromkeys(DEFAULT, 1.0), drag=2.0)
    assert (cloth.drag, set(cloth.family_damping.values())) == (2.0, {1.0})


def test_geometry_follows_shape_and_size():
    cloth = Cloth(shape=(3, 5), size=(1.0, 8.0))
    assert (cloth.rows, cloth.columns) == (3, 5)
    assert cloth.spacing == (0.5, 2.0)
    assert cloth.rest_positions.shape == (3, 5, 3)
    assert cloth.rest_positions[1, 3].tolist() == [6.0, 0.0, 0.5]
    assert cloth.rest_positions[-1, -1].tolist() == [8.0, 0.0, 1.0]
    assert Cloth(shape=(1, 3), size=(4.0, 1.0)).spacing == (0.0, 0.5)


def test_default_pins_are_the_ends_of_the_side_x_0():
    pinned = Cloth().pinned
    assert np.argwhere(pinned).tolist() == [[0, 0], [31, 0]]
    assert (Cloth().rest_positions[pinned][:, 0] == 0).all()
    # Negative indices keep their meaning when the shape changes.
    assert np.argwhere(Cloth().replace(shape=(5, 4)).pinned).tolist() == [[0, 0], [4, 0]]


def test_pins_as_pairs_and_as_mask_agree():
    mask = np.zeros((3, 4), dtype=bool)
    mask[1, 3] = mask[2, 0] = True
    for pins in [mask, [(1, -1), (2, 0), (1, 3)], np.array([[1, 3], [-1, 0]])]:
        np.testing.assert_array_equal(Cloth(shape=(3, 4), pins=pins).pinned, mask)
    for pins in [(), [], np.empty((0, 2), int), np.zeros((3, 4), bool)]:
        assert not Cloth(shape=(3, 4), pins=pins).pinned.any()


def test_mass():
    assert (Cloth().mass_per_point == 0.5).all()
    assert Cloth().uniform_mass
    masses = np.arange(1.0, 7.0).reshape(2, 3)
    cloth = Cloth(shape=(2, 3), mass=masses)
    masses[0, 0] = 99.0
    assert cloth.mass_per_point.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert not cloth.uniform_mass
    assert Cloth(shape=(2, 3), mass=np.full((2, 3), 4)).uniform_mass
    assert Cloth(mass=np.float32(2)).mass == 2.0


def test_derived_arrays_are_read_only():
    cloth = Cloth(shape=(2, 3), mass=np.ones((2, 3)))
    for clone in (cloth, copy.deepcopy(cloth), pickle.loads(pickle.dumps(cloth))):
        for array in (clone.mass, clone.mass_per_point, clone.pinned, clone.rest_positions):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1
    with pytest.raises(AttributeError):
        cloth.mass = 1.0
