"""RKC2: its steps by the formulas, its order, cost, bits, and where it is taken and refused."""

import math
from dataclasses import replace

import clothsim as cs
import numpy as np
import pytest
from clothsim import _core
from clothsim.engine.options import Options
from clothsim.methods.bound import least_rtol_of_rkc2, stable_dt_ratio_without_damping
from clothsim.run.error_control import rms_distance
from clothsim.run.frames import Frames
from clothsim.run.recording import Recording, Watch
from clothsim.run.trajectory import Job

LOSS = 2.9e-3  # s
EDGE = [(0, column) for column in range(12)]


def damped_scene(**changes):
    cloth = {"shape": (12, 12), "mass": 0.2, "stiffness": 1000.0, "damping": 1000.0 * LOSS}
    return cs.Scene(cs.Cloth(**{"pins": EDGE, **cloth, **changes}))


def scene_on_ball(**changes):
    ball = cs.Sphere((0.5, -0.32, 0.5), 0.25, friction=0.3)
    return damped_scene(pins=(), **changes).replace(spheres=[ball])


def grid_run(scene, ends, precision="double", start=0.0):
    """Run rkc2 with steps that end at these times."""
    options = Options("rkc2", precision)
    job = Job([scene], False, ends[-1] - start, options, start, tolerance=1.0, grid=tuple(ends))
    return Recording(job, Watch()).run_to_end().trajectory()


def chebyshev(s, kind, z):
    """Evaluate the polynomial of degree `s`, or a derivative of it (`kind` 1 or 2)."""
    unit = np.zeros(s + 1)
    unit[s] = 1
    return np.polynomial.Chebyshev(unit).deriv(kind)(z)


def numpy_step(scene, x, v, t, h, stages):
    """Take a step in the notation of Sommeijer, Shampine and Verwer, and estimate its error."""
    w0 = 1 + 2 / 13 / stages**2
    w1 = chebyshev(stages, 1, w0) / chebyshev(stages, 2, w0)
    b = [chebyshev(j, 2, w0) / chebyshev(j, 1, w0) ** 2 for j in range(2, stages + 1)]
    b = [b[0], b[0], *b]
    a = [1 - b[j] * chebyshev(j, 0, w0) for j in range(stages + 1)]
    c = [
        w1 * chebyshev(j, 2, w0) / chebyshev(j, 1, w0) if j > 1 else 0.0 for j in range(stages + 1)
    ]
    c[1] = c[2] / chebyshev(2, 1, w0)

    def slope(y, part):
        return np.stack([y[1], cs.acceleration(scene, *y, t=t + part * h)])

    y0 = np.stack([x, v])
    f0 = slope(y0, 0)
    older, y = y0, y0 + b[1] * w1 * h * f0
    for j in range(2, stages + 1):
        mu, nu = 2 * b[j] * w0 / b[j - 1], -b[j] / b[j - 2]
        factor = 2 * b[j] * w1 / b[j - 1]
        newer = (
            (1 - mu - nu) * y0
            + mu * y
            + nu * older
            + factor * h * (slope(y, c[j - 1]) - a[j - 1] * f0)
        )
        older, y = y, newer
    return y, 0.8 * (y0 - y) + 0.4 * h * (f0 + slope(y, 1))


def with_motion(scene):
    rng = np.random.default_rng(3)
    shape = scene.initial_position.shape
    x = scene.initial_position + 0.005 * rng.normal(size=shape)
    v = rng.normal(size=shape) * ~scene.cloth.pinned[..., None]
    x[scene.cloth.pinned] = scene.initial_position[scene.cloth.pinned]
    return scene.replace(position=x, velocity=v)


@pytest.mark.parametrize("h, stages", [(1e-5, 2), (1e-4, 3), (2e-3, 11)])
@pytest.mark.parametrize("wind", [None, cs.Wind((3.0, 1.0, 0.0))])
def test_a_step_is_that_of_the_paper(h, stages, wind):
    scene = with_motion(damped_scene()).replace(wind=wind)
    start = scene.initial_position, scene.initial_velocity
    (x, v), estimate = numpy_step(scene, *start, 0.0, h, stages)
    run = grid_run(scene, [h])
    assert run.evaluations == stages + 1
    free = ~scene.cloth.pinned
    scale = np.abs(x - start[0]).max(), np.abs(v - start[1]).max()
    assert np.abs(run.x[-1] - x).max() < 1e-11 * scale[0] + 1e-15
    assert np.abs(run.v[-1] - v)[free].max() < 1e-11 * scale[1]
    stiffness, damping = _core.mode_bounds(scene.cloth.core, scene.core_forces)
    rate = min(3 * max(math.sqrt(stiffness), 1 / h), max(stiffness / damping, 1 / h))
    squares = np.square(estimate[0]) + np.square(estimate[1] / rate)
    expected = math.sqrt(squares[free].sum() / free.size)
    assert run.local_error == pytest.approx(expected, rel=1e-6)


def test_its_order_is_two():
    """Steps are so short that all take two stages: each number has its own constant."""
    scene = damped_scene(stiffness=100.0, damping=0.3)
    exact = cs.reference(scene, 0.2).x[-1]
    errors = []
    for n in (400, 800, 1600):
        run = grid_run(scene, (0.2 * np.arange(1, n + 1) / n).tolist())
        assert run.evaluations == 2 * n + 1
        errors.append(rms_distance(run.x[-1] - exact))
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, 2, atol=0.05)


def test_frames_within_a_step_are_of_its_order():
    scene = damped_scene(stiffness=100.0, damping=0.3)
    at = tuple(np.linspace(0.011, 0.189, 20).tolist())
    exact = cs.simulate(scene, 0.2, rtol=1e-9, integrator="dop853", times=at)
    errors = []
    for n in (400, 800):
        grid = tuple((0.2 * np.arange(1, n + 1) / n).tolist())
        job = Job([scene], False, 0.2, Options("rkc2"), 0.0, Frames(times=at))
        run = Recording(replace(job, tolerance=1.0, grid=grid), Watch()).run_to_end().trajectory()
        errors.append(
            [rms_distance(x - y) for x, y in zip(run.x[1:-1], exact.x[1:-1], strict=True)]
        )
    np.testing.assert_allclose(np.log2(np.divide(*errors)), 2, atol=0.2)


@pytest.mark.parametrize("make", [damped_scene, scene_on_ball])
@pytest.mark.parametrize("rtol", [1e-3, 1e-5])
def test_the_error_is_told(make, rtol):
    scene = make()
    run = cs.simulate(scene, 0.4, rtol=rtol, integrator="rkc2")
    error = rms_distance(run.x[-1] - cs.simulate(scene, 0.4, rtol=1e-9, integrator="dop853").x[-1])
    assert error <= run.report["error_estimate"]["rms"] <= rtol
    assert run.report["integrator"] == "rkc2"


def test_it_takes_a_tenth_of_the_evaluations():
    scene = damped_scene(shape=(32, 32), pins=[(0, column) for column in range(32)])
    runs = [
        cs.simulate(scene, 0.1, rtol=1e-3, integrator=name).report["force_evaluations"]
        for name in ("rkc2", "dop853")
    ]
    assert runs[0] < 0.1 * runs[1]


def test_threads_batches_and_frames_change_no_bit(precision, same_bits):
    scene = damped_scene(shape=(40, 33), pins=[(0, 0)])
    options = {"rtol": 1e-3, "integrator": "rkc2", "precision": precision}
    expected = cs.simulate(scene, 0.02, threads=1, **options)
    for other in (
        cs.simulate(scene, 0.02, threads=2, **options),
        cs.simulate([scene, scene], 0.02, **options)[1],
        cs.simulate(scene, 0.02, fps=333, **options),
    ):
        assert same_bits([other.x[-1], other.v[-1]], [expected.x[-1], expected.v[-1]])


def test_single_adds_its_rounding_alone():
    """Increments from the start of the step keep it below that of some positions."""
    scene = damped_scene()
    ends = np.linspace(0, 0.2, 101)[1:].tolist()
    single, double = (grid_run(scene, ends, precision) for precision in ("single", "double"))
    assert rms_distance(single.x[-1] - double.x[-1]) < 3e-7


def test_momentum_and_work_are_counted():
    scene = with_motion(scene_on_ball())
    mass = scene.cloth.mass_per_point[..., None]
    run = cs.simulate(scene, 0.3, rtol=1e-4, integrator="rkc2")
    gained = (mass * (run.v[-1] - run.v[0])).sum((0, 1))
    fall = mass.sum() * np.array(scene.gravity) * 0.3
    assert run.report["first_contact"]["time"] < 0.2
    np.testing.assert_allclose(run.report["impulse"][0], fall - gained, atol=1e-12)
    windy = scene.replace(wind=cs.Wind((2.0, 0.0, 1.0)))
    works = [
        cs.simulate(windy, 0.3, rtol=rtol, integrator=name).report["wind_work"]
        for name, rtol in (("rkc2", 1e-6), ("dop853", 1e-9))
    ]
    assert works[0] == pytest.approx(works[1], rel=1e-4)


def test_auto_takes_it_by_the_damping_of_springs_and_drag():
    scene = damped_scene()
    assert stable_dt_ratio_without_damping(scene) == pytest.approx(
        cs.max_stable_dt(damped_scene(damping=0.0)) / cs.max_stable_dt(scene)
    )
    assert least_rtol_of_rkc2(scene) == 1e-5
    for rtol, expected in ((1e-3, "rkc2"), (1e-5, "rkc2"), (9e-6, "dop853")):
        assert cs.simulate(scene, 0.05, rtol=rtol).report["integrator"] == expected
    assert cs.simulate(scene, 0.05).report["integrator"] == "rkc2"
    assert "rkc2 from rtol 1e-05 on" in scene.explain()["with_tolerance"]
    strong = damped_scene(damping=20e-3 * 1000)
    assert stable_dt_ratio_without_damping(strong) > 20
    assert cs.simulate(strong, 0.05, rtol=1e-6).report["integrator"] == "rkc2"
    weak = damped_scene(damping=0.1)
    assert weak.explain()["with_tolerance"] == "dop853"
    windy = weak.replace(wind=cs.Wind((200.0, 0, 0)))
    assert cs.simulate(windy, 0.01, rtol=1e-3).report["integrator"] != "rkc2"
    ray = scene.replace(spheres=[cs.Sphere((0.5, -2.0, 0.5), 0.25, response="ray")])
    assert ray.explain()["with_tolerance"] == "dop853"


@pytest.mark.parametrize(
    "call",
    [
        lambda scene: cs.simulate(scene, 0.1, dt=1e-4, integrator="rkc2"),
        lambda scene: cs.Stepper(scene, integrator="rkc2"),
        lambda scene: cs.step(
            scene, scene.initial_position, scene.initial_velocity, 1e-4, integrator="rkc2"
        ),
        lambda scene: cs.max_stable_dt(scene, "rkc2"),
        lambda scene: scene.explain(integrator="rkc2"),
        lambda scene: cs.convergence(scene, 0.1, [1e-3], integrator="rkc2"),
        lambda scene: cs.work_precision(scene, 0.1, methods=["rkc2"]),
        lambda scene: cs.sweep(scene, {"stiffness": [1e3]}, dt=1e-4, integrator="rkc2"),
    ],
)
def test_steps_of_a_given_length_are_refused(call):
    with pytest.raises(ValueError, match="rkc2.*takes no steps of a given length"):
        call(damped_scene())


def test_a_function_may_be_stiffer_than_the_bounds():
    """Stages follow from springs, drag, wind and layers alone: error control shortens the steps."""

    def brake(t, x, v):
        return -10.0 * v

    options = {"force": brake}
    run = cs.simulate(damped_scene(), 0.02, rtol=1e-3, integrator="rkc2", **options)
    better = cs.simulate(damped_scene(), 0.02, rtol=1e-6, integrator="dop853", **options)
    assert rms_distance(run.x[-1] - better.x[-1]) <= run.report["error_estimate"]["rms"] <= 1e-3
