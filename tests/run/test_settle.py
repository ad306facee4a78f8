"""The rest state is balanced, and the minimum that SciPy finds; some scenes have none."""

import clothsim as cs
import numpy as np
import pytest

LIGHT = cs.Scene(cs.Cloth((12, 12), mass=0.3, stiffness=100.0, damping=0.05))


def drape(pins=(), **sphere):
    cloth = cs.Cloth((16, 16), mass=0.3, stiffness=100.0, damping=0.05, pins=pins)
    return cs.Scene(cloth, cs.Sphere((0.5, -0.3, 0.5), 0.25, **sphere))


def minimise(scene, x):
    """Find the state of least energy near `x` with SciPy."""
    optimize = pytest.importorskip("scipy.optimize")
    free = ~scene.cloth.pinned
    mass = scene.cloth.mass_per_point[..., None]
    v = np.zeros_like(x)

    def state(free_points):
        y = x.copy()
        y[free] = free_points.reshape(-1, 3)
        return y

    def value(free_points):
        y = state(free_points)
        energy = cs.energy(scene, y, v)
        force = mass * cs.acceleration(scene, y, v)
        return energy["elastic"] + energy["gravity"], -force[free].ravel()

    options = {"maxiter": 9999, "maxfun": 20_000, "ftol": 1e-16, "gtol": 0}
    result = optimize.minimize(value, x[free].ravel(), jac=True, method="L-BFGS-B", options=options)
    return state(result.x)


@pytest.mark.parametrize("scene", [LIGHT, cs.scenes.paper_swing()], ids=["light", "paper_swing"])
def test_the_rest_state_is_the_minimum_of_the_energy(scene):
    run = cs.settle(scene, 1e-7)
    assert run.report["residual"] < 1e-7 and run.report["reason"] == ""
    x = run.x[-1]
    free = ~scene.cloth.pinned
    acceleration = cs.acceleration(scene, x, np.zeros_like(x))
    force = scene.cloth.mass_per_point * np.linalg.norm(acceleration, axis=-1)
    weight = scene.cloth.mass_per_point.max() * 9.80665
    assert force[free].max() / weight == pytest.approx(run.report["residual"], rel=1e-3)
    noise = np.random.default_rng(3).normal(size=x.shape) * free[..., None]
    assert abs(minimise(scene, x + 1e-6 * noise) - x).max() < 1e-6
    assert (run.v[-1] == 0).all() and (x[~free] == scene.initial_position[~free]).all()


@pytest.mark.parametrize("response", ["reflect", "ray", "penalty"])
def test_a_pinned_sheet_rests_in_the_layer_of_a_sphere(response):
    scene = drape(pins=[(0, 0), (0, -1)], response=response)
    run = cs.settle(scene)
    assert run.report["residual"] < 1e-6 and run.report["reason"] == ""
    assert run.penetration()["points"][-1] == 0 and run.x[-1, ..., 1].min() < -0.35
    layer = drape(pins=[(0, 0), (0, -1)])
    assert run == cs.settle(layer) or response != "penalty"
    later = cs.simulate(layer.replace(position=run.x[-1]), 0.2, dt=2e-4)
    assert later.report["energy"]["start"]["contact"] > 0
    assert abs(later.x[-1] - run.x[-1]).max() < 1e-6


def test_a_sheet_that_slips_off_a_sphere_has_no_rest_state():
    scene = drape(friction=0.0)
    run = cs.settle(scene.replace(spheres=scene.spheres[0].replace(center=(0.6, -0.3, 0.55))))
    assert run.report["residual"] > 1e-6 and "moves away" in run.report["reason"]


def test_a_sheet_that_nothing_holds_says_so():
    run = cs.settle(cs.Scene(cs.Cloth((4, 4), pins=())))
    assert run.report["reason"] == "the cloth moves away: no pin and no sphere holds it"
    assert run.report["residual"] == pytest.approx(1.0)


def test_too_few_evaluations_end_with_the_best_state():
    run = cs.settle(LIGHT, max_evaluations=700)
    assert run.report["reason"] == "max_evaluations = 700 did not suffice"
    assert 1e-6 < run.report["residual"] < 10 and run.report["force_evaluations"] == 700


def test_moving_spheres_are_held_where_they_are_at_the_time(same_bits):
    ball = cs.Sphere((0.5, -0.5, 0.5), 0.25, cs.Linear((0, 0.4, 0)), stiffness=1e3)
    ball_at_rest = ball.replace(center=(0.5, -0.3, 0.5), motion=None)
    run = cs.settle(LIGHT.replace(spheres=ball), t=0.5)
    assert same_bits([run.x], [cs.settle(LIGHT.replace(spheres=ball_at_rest)).x])


def test_driven_pins_are_held_where_they_are_at_the_time():
    pins = {(0, 0): cs.Linear((0.0, 0.2, 0.0)), (-1, 0): None}
    run = cs.settle(LIGHT.replace(cloth=LIGHT.cloth.replace(pins=pins)), t=0.5)
    assert run.report["residual"] < 1e-6
    assert run.x[-1, 0, 0] == pytest.approx([0, 0.1, 0])
    assert run.x[-1, -1, 0] == pytest.approx([0, 0, 1])
    x = LIGHT.initial_position.copy()
    x[0, 0, 1] = 0.1
    expected = cs.settle(LIGHT.replace(position=x))
    assert (run.x[-1] == expected.x[-1]).all()


def test_a_run_in_time_has_no_residual():
    report = cs.simulate(LIGHT, 0.01, dt=1e-3).report
    assert np.isnan(report["residual"]) and report["reason"].startswith("not a run to rest")
    assert report.keys() == cs.settle(LIGHT).report.keys()


def test_a_point_that_goes_through_a_layer_gives_its_run_with_a_reason(leak):
    run = cs.settle(leak().replace(gravity=(0.0, -9.8, 0.0)))
    assert len(run) == 2 and run.report["residual"] == pytest.approx(1.0)
    assert "has gone through the layer of spheres[0]" in run.report["reason"]
