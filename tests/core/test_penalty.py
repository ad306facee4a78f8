"""Penalty contact in every kernel: the law against the oracles, order, balances, rest and slip."""

import clothsim as cs
import numpy as np
import pytest
from variants import cases

SHEET = cs.Cloth((9, 7), (0.8, 0.6), mass=2.0, stiffness=800.0, damping=0.5, pins=())
RISING = cs.Sinusoid((0.0, 0.1, 0.02), 3.0)
SCENES = {
    "sphere": (cs.Sphere((0.3, -0.12, 0.4), 0.1, friction=0.3),),
    "moving sphere": (cs.Sphere((0.2, -0.2, 0.3), 0.15, RISING),),
    "plane": (cs.Plane((0.0, -0.05, 0.0)),),
    "tilted plane": (cs.Plane((0.0, -0.1, 0.0), (0.1, 1.0, 0.2), friction=0.4),),
    "large sphere": (cs.Sphere((0.3, -1000.02, 0.4), 1000.0),),
    "groove": tuple(cs.Plane((0.3, -0.2, 0.4), (s, 0.8, 0.0), RISING) for s in (-0.6, 0.6)),
}
SCENES["all"] = SCENES["sphere"] + SCENES["moving sphere"] + SCENES["tilted plane"]


def rms(difference):
    return float(np.sqrt((difference**2).sum(axis=-1).mean()))


def falling(obstacles, cloth=SHEET, seed=5):
    rng = np.random.default_rng(seed)
    position = cloth.rest_positions + rng.normal(0, 0.004, (*cloth.shape, 3)) + (0.0, 0.1, 0.0)
    velocity = rng.normal(0, 0.5, position.shape) - (0.0, 1.0, 0.0)
    free = ~cloth.pinned[..., None]
    return cs.Scene(cloth, obstacles, position=position, velocity=velocity * free)


@cases(name=SCENES)
def test_steps_agree_with_the_scalar_reference(variant, name):
    cloth = SHEET.replace(pins=[(0, 0)], mass=np.linspace(0.5, 1.5, 63).reshape(9, 7) * 2.0 / 63)
    scene = falling(SCENES[name], cloth if name == "all" else SHEET)
    state = scene.initial_position, scene.initial_velocity
    x, v = cs.step(scene, *state, 2e-4, 300, t=0.1, **variant.options)
    expected = cs.reference_step(scene, *state, 2e-4, 300, t=0.1)
    assert cs.energy(scene, *expected, t=0.16)["contact"] > 0 or name != "sphere"
    bound = 1e-12 if variant.precision == "double" else 2e-7
    assert abs(x - expected[0]).max() < bound


@pytest.mark.parametrize("radius", [1e3, 1e4, 1e5])
def test_single_resolves_the_slope_of_a_large_sphere(radius):
    """The sheet slides 2 cm over a place far from the top, where gaps from there are rounded."""
    angle = 0.3
    normal = np.array([np.sin(angle), np.cos(angle), 0.0])
    obstacle = cs.Sphere(tuple(-radius * normal), radius)
    cloth = SHEET.replace(drag=0.5)
    x = cloth.rest_positions - cloth.rest_positions.mean(axis=(0, 1))
    turn = np.array([[normal[1], normal[0], 0], [-normal[0], normal[1], 0], [0, 0, 1]])
    scene = cs.Scene(cloth, obstacle, position=x @ turn.T + 0.05 * normal)
    runs = [cs.simulate(scene, 0.3, dt=5e-4, precision=p) for p in ("double", "single")]
    assert runs[0].report["first_contact"]["time"] < 0.2
    assert abs(runs[1].x[-1] - runs[0].x[-1]).max() < 2e-6


def drape(friction=0.0):
    cloth = cs.Cloth((16, 16), mass=128.0, stiffness=35_000.0, damping=50.0, pins=())
    return cs.Scene(cloth, cs.Sphere((0.5, -0.4, 0.5), friction=friction))


@pytest.mark.parametrize(
    "integrator, part, lowest, highest",
    [
        ("rk4", 0.4, 3.5, 5.0),
        ("velocity_verlet", 0.4, 1.9, 2.4),
        ("implicit_midpoint", 1.0, 1.8, 2.2),
        ("dop853", 0.8, 7.0, 9.0),
    ],
)
def test_methods_keep_their_order_through_contact(integrator, part, lowest, highest):
    scene = drape()
    finest = 0.1 * cs.max_stable_dt(scene, "dop853")
    coarse, right = (
        cs.simulate(scene, 0.45, dt=dt, integrator="dop853") for dt in (finest, finest / 2)
    )
    assert right.report["energy"]["end"]["contact"] > 1
    limit = cs.max_stable_dt(scene, "rk4" if integrator == "implicit_midpoint" else integrator)
    count = int(0.45 / (part * limit)) + 1
    halvings = {"implicit_midpoint": 1, "dop853": 2}.get(integrator, 3)
    errors = []
    for k in range(halvings + 1):
        run = cs.simulate(scene, 0.45, dt=0.45 / (count * 2**k), integrator=integrator)
        errors.append(rms(run.x[-1] - right.x[-1]))
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert rms(right.x[-1] - coarse.x[-1]) < 0.5 * errors[-1]
    assert lowest < orders.mean() < highest and (integrator != "rk4" or orders.min() > 3)


def test_rk4_keeps_order_three_with_friction():
    scene = drape(friction=0.3)
    right = cs.simulate(scene, 0.45, rtol=1e-9)
    count = int(0.45 / (0.4 * cs.max_stable_dt(scene))) + 1
    errors = [
        rms(cs.simulate(scene, 0.45, dt=0.45 / (count * n)).x[-1] - right.x[-1]) for n in (1, 8)
    ]
    assert np.log2(errors[0] / errors[1]) / 3 > 3


def test_dissipation_and_friction_make_a_scene_damped():
    cloth = cs.Cloth((8, 8), damping=0.0, pins=())
    ball = cs.Sphere((0.5, -0.5, 0.5), dissipation=0.0)
    orders = cs.integrators()
    assert orders["pefrl"].order_of(cs.Scene(cloth, ball)) == 4
    for damped in (ball.replace(dissipation=None), ball.replace(friction=0.1)):
        scene = cs.Scene(cloth, damped)
        assert orders["pefrl"].order_of(scene) == 1
        with pytest.warns(cs.OrderWarning, match="pefrl is of order 1"):
            cs.Stepper(scene, integrator="pefrl")


ELASTIC = cs.Cloth((6, 6), (0.5, 0.5), mass=1.0, stiffness=300.0, damping=0.0, pins=())
BOUNCES = {
    "plane": cs.Plane((0.0, -0.1, 0.0), dissipation=0.0),
    "sphere": cs.Sphere((0.25, -0.35, 0.25), dissipation=0.0),
    "moving sphere": cs.Sphere((0.25, -0.4, 0.25), 0.25, RISING, dissipation=0.0),
}


@pytest.mark.parametrize("name", BOUNCES)
def test_elastic_bounces_keep_the_energy_but_for_the_work_of_the_obstacle(name):
    scene = cs.Scene(ELASTIC, BOUNCES[name])
    run = cs.simulate(scene, 1.0, rtol=1e-9, fps=50)
    energies = [cs.energy(scene, x, v, t=float(t)) for t, x, v in zip(run.t, run.x, run.v)]
    largest = max(e["kinetic"] + e["elastic"] + e["contact"] for e in energies)
    assert run.report["first_contact"]["time"] < 0.5
    if name != "moving sphere":
        assert max(abs(e["total"] - energies[0]["total"]) for e in energies) < 1e-9 * largest
    gained = energies[-1]["total"] - energies[0]["total"]
    (work,) = run.report["obstacle_work"]
    assert abs(gained - work) < 1e-9 * largest and (work != 0) == (name == "moving sphere")


@cases(integrator=["rk4", "velocity_verlet", "dop853", "implicit_midpoint"])
def test_impulses_balance_the_momentum(variant, integrator):
    scene = falling(SCENES["sphere"] + SCENES["moving sphere"])
    options = {**variant.options, "integrator": integrator}
    stepper = cs.Stepper(scene, **options)
    begin = stepper.v.mean(axis=(0, 1))
    stepper.advance(300, 5e-4)
    gained = 2.0 * (stepper.v.mean(axis=(0, 1)) - begin - 0.15 * np.array(scene.gravity))
    bound = 1e-12 if variant.precision == "double" else 1e-6
    assert np.linalg.norm(stepper.impulses, axis=1).min() > 0.1
    assert abs(stepper.impulses.sum(axis=0) + gained).max() < bound


def test_rejected_steps_and_frames_leave_no_impulse():
    scene = falling(SCENES["moving sphere"] + SCENES["tilted plane"])
    runs = [cs.simulate(scene, 0.15, rtol=1e-6, **kw) for kw in ({}, {"fps": 1000})]
    assert runs[0].report["impulse"] == runs[1].report["impulse"]
    gained = (runs[0].v[-1] - runs[0].v[0]).mean(axis=(0, 1)) - 0.15 * np.array(scene.gravity)
    assert abs(np.sum(runs[0].report["impulse"], axis=0) + 2.0 * gained).max() < 1e-12


@cases(name=["all"])
def test_bits_depend_on_neither_batch_threads_nor_cuts(variant, name):
    scenes = [falling(SCENES[name], seed=seed) for seed in (1, 2)]
    singles = [cs.Stepper(scene, **variant.options) for scene in scenes]
    for stepper in singles:
        stepper.advance(200, 2e-4)
    batch = cs.Stepper(scenes, **{**variant.options, "threads": 2})
    batch.advance(200, 2e-4)
    pieces = cs.Stepper(scenes[0], **variant.options)
    for steps in (1, 66, 133):
        pieces.advance(steps, 2e-4)
        pieces = cs.Stepper.restore(pieces.snapshot())
    for k, stepper in enumerate(singles):
        assert np.array_equal(batch.x[k], stepper.x) and np.array_equal(batch.v[k], stepper.v)
        assert np.array_equal(batch.impulses[k], stepper.impulses)
    assert np.array_equal(pieces.x, singles[0].x)
    assert np.array_equal(pieces.impulses, singles[0].impulses)


def test_a_drape_comes_to_rest_and_keeps_its_symmetry():
    cloth = cs.Cloth((9, 9), mass=1.0, stiffness=300.0, damping=0.1, drag=0.05, pins=())
    scene = cs.Scene(cloth, cs.Plane((0.0, -0.05, 0.0)))
    stepper = cs.Stepper(scene)
    stepper.advance(20_000, 5e-4)
    assert abs(stepper.v).max() < 1e-6
    x = stepper.x
    assert abs(x[:, ::-1] * (-1, 1, 1) + (1, 0, 0) - x).max() < 1e-9
    assert abs(x.swapaxes(0, 1)[..., ::-1] - x).max() < 1e-9


def test_a_sheet_creeps_down_a_slope_within_the_friction_angle():
    """Friction mu s / sqrt(s^2 + v_s^2) of the push balances tan a of it at the slip s."""
    tangent, friction, slip_speed = 0.2, 0.5, 0.01
    floor = cs.Plane(
        (0.0, -0.03, 0.0), (tangent, 1.0, 0.0), friction=friction, slip_speed=slip_speed
    )
    cloth = cs.Cloth((5, 5), (0.4, 0.4), mass=0.5, stiffness=300.0, damping=0.5, pins=())
    slope = np.array([1.0, -tangent, 0.0]) / np.hypot(1, tangent)
    x = cloth.rest_positions[..., :1] * slope + cloth.rest_positions * (0, 0, 1)
    run = cs.simulate(cs.Scene(cloth, floor, position=x), 4.0, rtol=1e-5)
    expected = slip_speed * tangent / np.sqrt(friction**2 - tangent**2)
    assert (run.v[-1] @ slope).mean() == pytest.approx(expected, rel=1e-4)


def test_settle_finds_the_rest_of_a_hung_sheet_and_of_one_on_a_floor():
    hung = cs.Cloth((8, 8), mass=1.0, stiffness=300.0, damping=0.5)
    floor = cs.Plane((0.0, -0.05, 0.0))
    for scene in (
        cs.Scene(hung, cs.Sphere((0.3, -0.6, 0.5), 0.2)),
        cs.Scene(hung.replace(pins=()), floor),
    ):
        run = cs.settle(scene)
        state = run.x[-1], np.zeros_like(run.x[-1])
        weight = 1.0 * 9.80665
        force = cs.acceleration(scene, *state) / 64
        assert run.report["reason"] == "" and abs(force).max() < 2e-6 * weight
        assert cs.energy(scene, *state)["contact"] > 0
