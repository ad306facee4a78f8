"""Places of offset "face" that are hard to find, and steps that must not end without one."""

import clothsim as cs
import numpy as np
import pytest
from clothsim import _core
from contact_fuzz.shots import _passed, _shot, _squeeze


@pytest.mark.parametrize("width", [1e-2, 1e-5, 1e-9])
def test_a_thin_triangle_is_touched_between_its_sides(width):
    """200 m long: its long sides are further off than its middle."""
    long = np.array([(-100.0, 0, -width / 2), (100.0, 0, -width / 2), (3.0, 0, width / 2)])
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    radius = 0.1
    aside = np.hypot(radius, width / 2) - radius  # by so much are the sides further off
    for depth in (0.5 * aside, -0.5 * aside) if aside > 1e-10 else (1e-10,):
        for k in range(3):
            corners = (np.roll(long, k, axis=0) + (0, radius - depth, 0)) @ turn
            time = _core.triangle_touches(corners[None], corners[None], radius, 1e-13)[0]
            assert (time == 0.0) == (depth > 0), (k, depth)


def test_a_push_out_of_a_sphere_pushes_nothing_into_another():
    """The sheet starts 5 mm inside the lower sphere; a push of 10 mm a step would lead it into the upper."""
    cloth = cs.Cloth((3, 3), mass=9.0, stiffness=0.0, damping=0.0, pins=())
    lower = cs.Sphere((0.5, 5e-3 - 0.3, 0.5), 0.3, None, "continuous", "face", push_out_speed=1.0, restitution=1.0)
    upper = cs.Sphere((0.5, 1e-3 + 0.3, 0.5), 0.3, None, "continuous", "face", restitution=1.0)
    with pytest.warns(cs.ContactWarning):
        stepper = cs.Stepper(cs.Scene(cloth, (lower, upper), (0, 0, 0)))
    for _ in range(3):
        stepper.advance(1, 0.01)
        assert cs.penetration(stepper.positions, upper)["triangles"] == 0


@pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")
def test_a_fast_sphere_leaves_no_long_triangle_in_a_slow_one():
    """Shot 79 of seed 7 pulls a pinned sheet 1,000 times its size apart: triangles 1e4 times longer than high."""
    rng = np.random.default_rng(7)
    shots: list[tuple[cs.Scene, float]] = []
    while len(shots) < 80:
        if drawn := _shot(rng, several=len(shots) % 2 == 1):
            shots.append(drawn)
    scene, dt = shots[79]
    stepper = cs.Stepper(scene, threads=1)
    for _ in range(4):
        t, x = stepper.time, stepper.positions
        try:
            stepper.advance(1, dt)
        except cs.ContactError:
            return
        assert not _passed(scene, x, stepper.positions, t, dt)


def test_a_sheet_between_closing_spheres_finds_its_place_from_another_start():
    """Squeeze 584 of seed 1: projections from where the step leads find none."""
    rng = np.random.default_rng()
    state = {"state": 174262409596223728113997786355907657413, "inc": 194290289479364712180083596243593368443}
    rng.bit_generator.state = {"bit_generator": "PCG64", "state": state, "has_uint32": 0, "uinteger": 4079848784}
    drawn = _squeeze(rng)
    assert drawn is not None
    scene, dt, duration = drawn
    stepper = cs.Stepper(scene, threads=1)
    stepper.advance(int(duration / dt), dt)
    for sphere in scene.spheres:
        assert cs.penetration(stepper.positions, sphere, stepper.time)["triangles"] == 0
