"""What "single" promises: float32 arithmetic whose state does not stall at small steps."""

import clothsim as cs
import numpy as np
import pytest

DT = 5e-6  # s, the paper's step


@pytest.fixture(scope="module")
def swing():
    """Return the paper's swing after 0.1 s in double, and the state it starts from."""
    scene = cs.scenes.paper_swing()
    state = scene.initial_position, scene.initial_velocity
    return scene, state, cs.step(scene, *state, DT, 20_000, threads=1)[0]


def error(x, expected):
    return np.linalg.norm(x - expected, axis=-1).max()


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_single_follows_double_at_the_papers_time_step(kernel, swing, dtype):
    """The state is compensated inside a call, whatever the arrays hold."""
    scene, state, expected = swing
    state = [part.astype(dtype) for part in state]
    x, v = cs.step(scene, *state, DT, 20_000, precision="single", threads=1, kernel=kernel)
    assert x.dtype == v.dtype == dtype and error(x, expected) < 2e-7


def test_float32_without_compensation_would_not(swing):
    """float32 arrays drop it at each call: a call a step is plain float32, and stalls."""
    scene, (x, v), _ = swing
    steps = 2_000
    expected, _ = cs.step(scene, x, v, DT, steps, threads=1)
    compensated, _ = cs.step(scene, x, v, DT, steps, precision="single", threads=1)
    x = x.astype(np.float32)
    v = v.astype(np.float32)
    for _ in range(steps):
        x, v = cs.step(scene, x, v, DT, precision="single", threads=1)
    assert error(x, expected) > 20 * error(compensated, expected)
    assert error(x, expected) > 4e-7  # after a tenth of the time that the bound above is for


def test_float64_arrays_keep_the_compensation_between_calls(swing, relative):
    scene, (x0, v0), _ = swing
    at_once = cs.step(scene, x0, v0, DT, 1000, precision="single", threads=1)
    x, v = x0, v0
    for _ in range(1000):
        x, v = cs.step(scene, x, v, DT, precision="single", threads=1)
    double = cs.step(scene, x0, v0, DT, 1000, threads=1)
    assert np.abs(x - at_once[0]).max() <= 0.1 * np.abs(at_once[0] - double[0]).max() + 1e-15
    assert relative((x, v), at_once, x0) < 1e-6


def test_acceleration_in_single_is_rounded_like_float32(variant, crumpled):
    scene, x, v, _ = crumpled()
    a = cs.acceleration(scene, x, v, **variant.options)
    as_float32 = a.astype(np.float32).astype(float)
    assert (a == as_float32).all() == (variant.precision == "single")


@pytest.mark.parametrize("value", [1e39, -4e38])
def test_a_state_beyond_float32_is_not_finite(crumpled, value):
    """Finite in the float64 given, infinite in single: an error, not an infinity handed back."""
    scene, x, v, dt = crumpled()
    x[2, 3, 1] = value
    for steps in (0, 1):
        with pytest.raises((ValueError, cs.UnstableError)) as raised:
            cs.step(scene, x, v, dt, steps, precision="single")
        if isinstance(raised.value, cs.UnstableError):
            assert np.isfinite(raised.value.x).all()


FAR = np.array(
    (1000.0, 0.0, 0.0)
)  # m: "single" keeps positions relative to the cloth's middle there


@pytest.mark.parametrize("integrator", ["dopri5", "dop853"])
def test_frames_within_the_steps_of_a_far_cloth_are_where_it_is(integrator):
    cloth = cs.Cloth((8, 8), mass=0.4, stiffness=60.0, damping=0.01)
    near, far = (cs.Scene(cloth, position=cloth.rest_positions + place) for place in (0, FAR))
    expected = cs.simulate(near, 0.2, rtol=1e-3, integrator=integrator, fps=37)
    run = cs.simulate(far, 0.2, rtol=1e-3, integrator=integrator, precision="single", fps=37)
    assert len(run.t) > 3 and error(run.x - FAR, expected.x) < 2e-3


def test_a_step_of_an_implicit_method_starts_where_the_far_cloth_was():
    cloth = cs.Cloth((20, 20), mass=0.4, stiffness=60.0, damping=0.01, pins=())
    velocity = np.broadcast_to((0.1, -4.0, 0.0), (20, 20, 3))  # 8 mm a step
    ball = cs.Sphere(FAR + (0.5, -0.3, 0.5), 0.25, friction=0.3)
    scene = cs.Scene(cloth, ball, position=cloth.rest_positions + FAR, velocity=velocity)
    double, single = (
        cs.Stepper(scene, integrator="implicit_midpoint", precision=p) for p in ("double", "single")
    )
    for stepper in (double, single):
        stepper.advance(100, 2e-3)
    np.testing.assert_allclose(
        single.impulses, double.impulses, atol=1e-3 * np.abs(double.impulses).max()
    )
