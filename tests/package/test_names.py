"""One misspelling, one answer: the error of each public call suggests the name that is meant."""

import inspect

import clothsim as cs
import numpy as np
import pytest
from clothsim.base import check
from tables import each

SCENE = cs.scenes.oscillator()
X, V = SCENE.initial_position, SCENE.initial_velocity
RUN = cs.simulate(SCENE, 0.01, dt=1e-3)
FLOOR = cs.Plane((0, -1, 0))
SHEET = cs.Cloth((3, 4), pins=())


@each(
    "call, said",
    [
        (lambda: cs.Cloth(stifness=1.0), "Cloth.*'stifness'.*did you mean 'stiffness'.*accepted:"),
        (lambda: cs.Sphere(centre=(0, 0, 0)), "Sphere.*'centre' .did you mean 'center'"),
        (lambda: cs.Scene(SHEET, floor=FLOOR), "Scene.*'floor'; a floor is a cs.Plane"),
        (lambda: cs.simulate(SCENE, 1.0, presicion="single"), "simulate.*mean 'precision'"),
        (lambda: cs.step(SCENE, X, V, 1e-3, step=2), "step.*did you mean 'steps'"),
        (lambda: cs.Stepper(SCENE).advance(1, 1e-3, center={}), "advance.*mean 'centers'"),
        (lambda: SHEET.replace(stifness=1.0), "Cloth.*did you mean 'stiffness'"),
        (lambda: RUN.picture(widht=3), "picture.*did you mean 'width'"),
        (lambda: cs.scenes.hanging(shap=(4, 4)), "hanging.*did you mean 'shape'"),
        (lambda: cs.Keyframes([0, 1], offset=np.eye(2, 3)), "Keyframes.*mean 'offsets'"),
    ],
)
def test_a_misspelt_argument_suggests_the_right_one(call, said):
    with pytest.raises(TypeError, match=said):
        call()


def test_every_public_function_answers_so():
    pytest.importorskip("xarray")
    for name in cs.__all__:
        value = getattr(cs, name)
        if not inspect.isfunction(value):
            continue
        kinds = {parameter.kind for parameter in inspect.signature(value).parameters.values()}
        if kinds and inspect.Parameter.VAR_KEYWORD not in kinds:
            with pytest.raises(TypeError, match=f"{name} has the unknown argument 'cuda'"):
                value(cuda=1)


def test_what_is_not_alike_is_not_suggested():
    assert check.nearest_name_hint("cuda", ("cpu", "gpu")) == ""
    assert check.nearest_name_hint("gup", ("cpu", "gpu")) == ""
    assert "'gather'" in check.nearest_name_hint("gathre", ("auto", "gather", "edge"))


def test_planes_are_called_planes():
    scene = cs.Scene(SHEET, FLOOR)
    run = cs.simulate(scene, 0.01, dt=1e-4)
    assert "1 plane (response" in repr(run) and "sphere" not in repr(run).splitlines()[0]
    mixed = scene.replace(spheres=[cs.Sphere((9, 9, 9)), FLOOR, FLOOR])
    assert "1 sphere and 2 planes (" in repr(cs.Stepper(mixed))
    account = scene.explain()
    assert "planes" in account["computed"] and "spheres" in account["left_out"]
    moving = cs.Scene(SHEET, FLOOR.replace(motion=cs.Linear((0, 1, 0))))
    with pytest.raises(ValueError, match="where a plane moves"):
        cs.step(moving, SHEET.rest_positions, 0 * SHEET.rest_positions, 1e-4)
    pinned = cs.Scene(cs.Cloth((3, 4)), moving.spheres[0].replace(point=(0, -1e-4, 0)))
    with pytest.warns(cs.ContactWarning, match="is inside a plane"):
        cs.simulate(pinned, 0.01, dt=1e-4)


def test_planes_are_swept_by_names_of_their_own():
    names = cs.sweepable()
    assert names["plane_point_y"] == "m" and names["plane_normal_x"] == "1"
    from clothsim.model.fields import change_scene

    ball = cs.Sphere((0, 5, 0))
    scene = cs.Scene(SHEET, [ball, FLOOR])
    values = {"plane_point_y": -2.0, "plane1_normal_x": 0.5, "plane_friction": 0.3}
    swept = change_scene(scene, values)
    floor = cs.Plane((0, -2.0, 0), (0.5, 1, 0), friction=0.3)
    assert swept.spheres == (ball, floor)
    assert change_scene(scene, {"sphere_radius": 0.1}).spheres[1] == FLOOR
    assert change_scene(cs.Scene(SHEET, FLOOR), {"sphere_center": (0, -2, 0)}).spheres[0] == (
        cs.Plane((0, -2, 0))
    )
    with pytest.raises(ValueError, match="plane0_point_y needs a plane, and spheres.0. is a sph"):
        change_scene(scene, {"plane0_point_y": 1.0})
    with pytest.raises(ValueError, match="plane_point needs a plane"):
        change_scene(cs.Scene(SHEET, ball), {"plane_point": (0, 0, 0)})
