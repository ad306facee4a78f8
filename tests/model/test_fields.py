"""What can be swept: every name changes what it says, and nothing else."""

import clothsim as cs
import pytest
from clothsim.model import fields
from clothsim.model.fields import change_scene

LINEAR = cs.Sphere((0, -1, 0), 0.3, cs.Linear((3.0, 0.0, 4.0)))
AROUND = cs.Sphere((1, -1, 0), 0.2, cs.Reciprocate((1, 0, 0), distance=0.5, period=2.0))
CLOTH = cs.Cloth((4, 5), mass=2.0, stiffness=100.0, damping=0.5)
SCENE = cs.Scene(CLOTH, (LINEAR, AROUND))
FAMILIES = {"structural": 100.0, "shear": 100.0, "bend": 100.0}

CASES = [
    ("shape", (6, 3), lambda s: s.cloth.shape, (6, 3)),
    ("mass", 3.0, lambda s: s.cloth.mass, 3.0),
    ("stiffness", 7.0, lambda s: s.cloth.stiffness, 7.0),
    ("stiffness_shear", 7.0, lambda s: s.cloth.family_stiffness, {**FAMILIES, "shear": 7.0}),
    ("damping_bend", 7.0, lambda s: s.cloth.family_damping["bend"], 7.0),
    ("damping_bend", 7.0, lambda s: s.cloth.family_damping["shear"], 0.5),
    ("springs", ("bend",), lambda s: s.cloth.springs, ("bend",)),
    ("pins", ((1, 1),), lambda s: s.cloth.pins, ((1, 1),)),
    ("gravity", (1, 2, 3), lambda s: s.gravity, (1, 2, 3)),
    ("gravity_z", 3.0, lambda s: s.gravity, (0.0, -9.80665, 3.0)),
    ("pin1_y", 0.3, lambda s: s.initial_position[-1, 0].tolist(), [0.0, 0.3, 1.0]),
    ("sphere_radius", 0.4, lambda s: [b.radius for b in s.spheres], [0.4, 0.4]),
    ("sphere1_radius", 0.4, lambda s: [b.radius for b in s.spheres], [0.3, 0.4]),
    ("sphere0_center_y", 9.0, lambda s: s.spheres[0].center, (0.0, 9.0, 0.0)),
    ("sphere_response", "reflect", lambda s: s.spheres[1].response, "reflect"),
    ("sphere1_period", 4.0, lambda s: s.spheres[1].motion.period, 4.0),
    ("sphere0_velocity", (0, 1, 0), lambda s: s.spheres[0].motion.velocity, (0.0, 1.0, 0.0)),
    ("scene", cs.scenes.paper_swing(), lambda s: s, cs.scenes.paper_swing()),
]


@pytest.mark.parametrize(("name", "value", "read", "expected"), CASES)
def test_a_changed_name_changes_the_result(name, value, read, expected):
    fields.check_sweep_name(name)
    assert read(change_scene(SCENE, {name: value})) == expected
    assert read(SCENE) != expected or name == "damping_bend"


@pytest.mark.parametrize("order", [1, -1])
def test_parts_are_parts_of_the_new_whole(order):
    values = [
        ("stiffness", 5.0),
        ("stiffness_bend", 2.0),
        ("sphere0_motion", cs.Linear((2, 0, 0))),
        ("sphere0_velocity", (3, 0, 0)),
        ("gravity", (1, 1, 1)),
        ("gravity_x", 4.0),
    ]
    scene = change_scene(SCENE, dict(values[::order]))
    assert dict(scene.cloth.stiffness) == {"structural": 5.0, "shear": 5.0, "bend": 2.0}
    assert scene.spheres[0].motion.velocity == (3.0, 0.0, 0.0)
    assert scene.gravity == (4.0, 1.0, 1.0)


@pytest.mark.parametrize("order", [1, -1])
def test_arguments_of_a_sphere_come_together(order):
    values = {"sphere_restitution": 0.0, "sphere_response": "ray", "sphere0_radius": 0.1}
    scene = change_scene(
        cs.Scene(cs.Cloth(), (cs.Sphere(), cs.Sphere())), dict(list(values.items())[::order])
    )
    assert [(s.response, s.restitution, s.radius) for s in scene.spheres] == [
        ("ray", 0.0, 0.1),
        ("ray", 0.0, 0.25),
    ]
    ray = cs.Scene(cs.Cloth(), cs.Sphere(response="ray"))
    layer = {"sphere_response": "penalty", "sphere_thickness": 0.01}
    sphere = change_scene(ray, dict(list(layer.items())[::order])).spheres[0]
    assert sphere.restitution is None and sphere.thickness == 0.01


def test_every_argument_of_the_model_has_a_name():
    import dataclasses

    for cls, prefix in ((cs.Cloth, ""), (cs.Sphere, "sphere_")):
        for field in dataclasses.fields(cls):
            assert prefix + field.name in fields.NAMES
    for name in ("dt", "duration", "integrator", "precision", "kernel", "gravity"):
        assert name in fields.NAMES
