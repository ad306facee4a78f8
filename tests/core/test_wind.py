"""Wind in every kernel: states of balance by formula, the law against oracles, order and work."""

import pickle

import clothsim as cs
import numpy as np
import pytest
from clothsim.gpu.shader import check_scenes
from variants import cases

GRAVITY, SLOW_SPEED = 9.80665, 0.01  # m/s^2, m/s
GUSTS = cs.Sinusoid((0.1, 0.15, 0.05), 1.7, 0.2)  # gusts of up to 2 m/s
# It carries the sheet, so that no triangle turns through the wind, where forces are hardly smooth.
WIND = cs.Wind((1.0, 6.0, -2.0), normal=1.1, tangential=0.3, motion=GUSTS)
SHEET = cs.Cloth((9, 7), (0.8, 0.6), mass=1.0, stiffness=100.0, damping=0.1)


def flat_cloth(shape, mass, **arguments):
    """Return a cloth whose points have masses as their areas: even pressure leaves it flat."""
    triangles = np.bincount(cs.triangles(shape).ravel()).reshape(shape)
    return cs.Cloth(shape, mass=mass * triangles / triangles.sum(), **arguments)


def law(scene, t, x, v):
    """Return the force of the wind on each mass point, written down as in `Wind`."""
    wind = scene.wind
    corners = cs.triangles(scene.cloth.shape)
    air = np.array(wind.velocity) + (wind.motion.velocity_at(t) if wind.motion else 0.0)
    a, b, c = x.reshape(-1, 3)[corners.T]
    product = np.cross(b - a, c - a)
    length = np.linalg.norm(product, axis=1, keepdims=True)
    n = np.divide(product, length, out=np.zeros_like(product), where=length > 0)
    u = air - v.reshape(-1, 3)[corners].mean(axis=1)
    un = (u * n).sum(axis=1, keepdims=True)
    ut = u - un * n
    pressure = wind.normal * np.hypot(un, SLOW_SPEED) * un * n
    shear = wind.tangential * np.hypot(np.linalg.norm(ut, axis=1, keepdims=True), SLOW_SPEED) * ut
    force = np.zeros((x.size // 3, 3))
    for corner in corners.T:
        np.add.at(force, corner, wind.density / 2 * length / 2 * (pressure + shear) / 3)
    return force.reshape(x.shape)


def random_scene(seed=3, cloth=SHEET, wind=WIND):
    """Return a scene that starts crumpled and moving."""
    rng = np.random.default_rng(seed)
    position = cloth.rest_positions + rng.normal(0, 0.005, (*cloth.shape, 3))
    velocity = rng.normal(0, 0.3, position.shape) * ~cloth.pinned[..., None]
    return cs.Scene(cloth, position=position, velocity=velocity, wind=wind)


def rms(difference):
    return float(np.sqrt((difference**2).sum(axis=-1).mean()))


@pytest.mark.parametrize(
    "flat, normal, tangential",
    [(True, 0.8, 0.6), (True, 1.4, 0.0), (False, 0.8, 0.6), (False, 0.0, 1.0)],
)
def test_a_sheet_falls_at_the_terminal_speed_of_its_attitude(flat, normal, tangential):
    # It starts with the air, and falls across its plane or in it. Its weight comes to balance
    # density / 2 A c sqrt(s^2 + w^2) s; without w, s would be 3e-6 larger.
    mass = 0.05
    density = 1.1
    size = (0.5, 0.8)
    air = np.array([1.0, -2.0, 3.0])
    cloth = flat_cloth((4, 5), mass, size=size, stiffness=200.0, damping=0.05, pins=())
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    down = turn @ ((0, 1, 0) if flat else (0.6, 0, 0.8))
    scene = cs.Scene(
        cloth,
        gravity=GRAVITY * down,
        position=cloth.rest_positions @ turn.T,
        velocity=np.broadcast_to(air, (4, 5, 3)),
        wind=cs.Wind(air, density, normal, tangential),
    )
    run = cs.simulate(scene, 2.0, dt=1e-3)
    square = 2 * mass * GRAVITY / (density * (normal if flat else tangential) * 0.4)
    speed = np.sqrt((np.sqrt(SLOW_SPEED**4 + 4 * square**2) - SLOW_SPEED**2) / 2)
    assert abs(run.v[-1] - air - speed * down).max() < 1e-7 * speed


@pytest.mark.parametrize("speed", [2.0, 6.0, 15.0])
def test_a_hinged_sheet_rests_at_the_angle_of_balance(speed):
    # On each point, so that the sheet stays flat: m g sin a = density / 2 A normal (speed cos a)^2.
    # The springs stretch by some 5e-4. Shear tightens the sheet, which would flutter otherwise.
    mass = 0.1
    density = 1.2
    normal = 1.3
    size = (0.5, 0.4)
    pins = [(0, k) for k in range(3)]
    cloth = flat_cloth((6, 3), mass, size=size, stiffness=1e3, damping=1.0, pins=pins)
    across, _, along = np.moveaxis(cloth.rest_positions, -1, 0)
    position = np.stack([across, -along, 0 * along], axis=-1)
    wind = cs.Wind((0.0, 0.0, speed), density, normal, tangential=0.2)
    run = cs.settle(cs.Scene(cloth, position=position, wind=wind))
    assert run.report["reason"] == ""
    lift = density / 2 * 0.2 * normal * speed**2 / (mass * GRAVITY)
    sine = (np.sqrt(1 + 4 * lift**2) - 1) / (2 * lift)
    sides = run.x[-1, 1:] - run.x[-1, :-1]
    assert sides[..., 2] / np.linalg.norm(sides, axis=-1) == pytest.approx(sine, abs=1e-3)


@pytest.mark.parametrize("t", [0.0, 0.3])
def test_settle_keeps_the_gusts_of_its_time(t):
    scene = random_scene(cloth=SHEET.replace(shape=(5, 4), pins=[(0, 0), (0, 3)]))
    air = np.array(WIND.velocity) + GUSTS.velocity_at(t)
    steady = scene.replace(wind=WIND.replace(velocity=air, motion=None))
    assert abs(cs.settle(scene, t=t).x[-1] - cs.settle(steady).x[-1]).max() < 1e-4


@cases()
def test_the_acceleration_is_that_of_the_law(variant):
    mass = np.random.default_rng(4).uniform(0.002, 0.008, (9, 7))
    cloth = SHEET.replace(mass=mass, drag=0.001, pins=[(0, 0), (4, 3)])
    for k in range(6):
        scene = random_scene(k, cloth, WIND if k % 2 else cs.Wind(tangential=0.4))
        t = 0.1 * k
        # The speeds go from less than w to much more
        x = scene.initial_position.copy()
        v = scene.initial_velocity * 50.0 ** (k // 2 - 1)
        if k > 3:
            x[3, 2] = x[2, 3]  # the diagonal of a cell, so that two triangles have no area
        calm = cs.acceleration(scene.replace(wind=None), x, v, t, **variant.options)
        acceleration = cs.acceleration(scene, x, v, t, **variant.options)
        expected = law(scene, t, x, v) / mass[..., None] * ~cloth.pinned[..., None]
        bound = (1e-13 if variant.precision == "double" else 1e-6) * abs(acceleration).max()
        assert np.isfinite(acceleration).all()
        assert abs(acceleration - calm - expected).max() < bound


def test_blocks_of_damping_are_the_derivative_of_the_law():
    scene = random_scene()
    t = 0.2
    h = 1e-5
    x, v = scene.initial_position, scene.initial_velocity
    (points, blocks) = scene.core_forces[0].damping_blocks(scene.cloth.core, x, v, t)
    change = np.random.default_rng(0).normal(size=x.shape)
    product = np.zeros((63, 3))
    np.add.at(
        product, points[:, 0], np.einsum("nij,nj->ni", blocks, change.reshape(-1, 3)[points[:, 1]])
    )
    slope = (law(scene, t, x, v + h * change) - law(scene, t, x, v - h * change)) / (2 * h)
    assert abs(product.reshape(x.shape) + slope).max() < 1e-7 * abs(slope).max()


@pytest.mark.parametrize("shape", [(1, 6), (6, 1)])
def test_a_chain_has_no_triangles(shape):
    scene = random_scene(cloth=SHEET.replace(shape=shape, pins=[(0, 0)]))
    runs = [cs.simulate(chain, 0.1, dt=1e-3) for chain in (scene, scene.replace(wind=None))]
    assert abs(runs[0].x - runs[1].x).max() < 1e-14 and runs[0].report["wind_work"] == 0


@cases()
def test_steps_agree_with_the_scalar_reference(variant):
    scene = random_scene()
    state = scene.initial_position, scene.initial_velocity
    x, v = cs.step(scene, *state, 5e-4, 300, t=0.1, **variant.options)
    expected = cs.reference_step(scene, *state, 5e-4, 300, t=0.1)
    bound = 1e-12 if variant.precision == "double" else 2e-7
    assert abs(x - expected[0]).max() < bound and abs(v - expected[1]).max() < 100 * bound


def test_two_solutions_and_the_law_as_a_function_agree():
    scene = random_scene(cloth=SHEET.replace(shape=(5, 4)))
    right = cs.reference(scene, 0.4)
    assert right.error_bound["max"][-1] < 1e-12
    run = cs.simulate(scene, 0.4, rtol=1e-10)
    assert right.error_of(run.x[-1])["rms"] <= run.report["error_estimate"]["rms"] < 1e-10
    calm = scene.replace(wind=None)
    copy = cs.simulate(calm, 0.4, rtol=1e-10, force=lambda *state: law(scene, *state))
    assert right.error_of(copy.x[-1])["rms"] < 1e-10
    assert copy.report["force_work"] == pytest.approx(run.report["wind_work"], rel=1e-9)


@pytest.mark.parametrize(
    "integrator, part, lowest, highest",
    [
        ("rk4", 0.2, 3.8, 4.2),
        ("velocity_verlet", 0.8, 1.8, 2.2),
        ("implicit_midpoint", 0.8, 1.8, 2.2),
        ("dop853", 1.0, 7.0, 9.0),
    ],
)
def test_methods_keep_their_order_in_gusts(integrator, part, lowest, highest):
    scene = random_scene()
    right = cs.simulate(scene, 0.3, rtol=1e-13)
    limit = cs.max_stable_dt(scene, "rk4" if integrator == "implicit_midpoint" else integrator)
    dt = 0.3 / (int(0.3 / (part * limit)) + 1)
    runs = [cs.simulate(scene, 0.3, dt=dt / n, integrator=integrator) for n in (2, 4)]
    errors = [rms(run.x[-1] - right.x[-1]) for run in runs]
    assert lowest < np.log2(errors[0] / errors[1]) < highest


ELASTIC = random_scene(cloth=SHEET.replace(damping=0.0)).replace(gravity=(0, 0, 0))


def imbalance(run):
    """Return the part of the change of energy that is not the work of the wind [J]."""
    start, end = (run.report["energy"][moment]["total"] for moment in ("start", "end"))
    return abs(end - start - run.report["wind_work"])


def test_the_wind_does_the_work_by_which_the_energy_changes():
    run = cs.simulate(ELASTIC, 0.5, rtol=1e-11)
    work = run.report["wind_work"]
    start, end = (cs.energy(ELASTIC, run.x[k], run.v[k])["total"] for k in (0, -1))
    assert work > 0.1 and abs(end - start - work) < 1e-9 * work
    assert abs(run.report["energy"]["gained"]) < 1e-9 * work


@pytest.mark.parametrize(
    "integrator, fall", [("rk4", 10), ("velocity_verlet", 3), ("implicit_midpoint", 3)]
)
def test_work_is_summed_with_the_order_of_the_method(integrator, fall):
    runs = [cs.simulate(ELASTIC, 0.1, dt=dt, integrator=integrator) for dt in (1e-3, 5e-4)]
    assert fall * imbalance(runs[1]) < imbalance(runs[0]) < 2e-2 * runs[0].report["wind_work"]


def test_single_precision_is_near_double():
    runs = [cs.simulate(random_scene(), 0.5, dt=5e-4, precision=p) for p in ("double", "single")]
    assert abs(runs[1].x[-1] - runs[0].x[-1]).max() < 1e-6


@cases()
def test_bits_depend_on_neither_batch_threads_nor_cuts(variant):
    cloth = SHEET.replace(shape=(160, 140), mass=10.0)
    scenes = [random_scene(1, cloth), random_scene(2, cloth, cs.Wind((5.0, 1.0, 0.0)))]
    singles = [cs.Stepper(scene, **variant.options) for scene in scenes]
    batch = cs.Stepper(scenes, **{**variant.options, "threads": 2})
    threads = cs.Stepper(scenes[0], **{**variant.options, "threads": 2})
    for stepper in (*singles, batch, threads):
        stepper.advance(4, 1e-4)
    parts = cs.Stepper(scenes[0], **variant.options)
    for steps in (1, 3):
        parts.advance(steps, 1e-4)
        parts = cs.Stepper.restore(parts.snapshot())
    for k, stepper in enumerate(singles):
        assert np.array_equal(batch.x[k], stepper.x) and np.array_equal(batch.v[k], stepper.v)
    for stepper in (threads, parts):
        assert np.array_equal(stepper.x, singles[0].x) and np.array_equal(stepper.v, singles[0].v)


def test_strong_wind_limits_the_step_of_a_light_cloth():
    # Wind across a flat sheet damps its motion as a whole most, by density A normal speed / m.
    cloth = flat_cloth((8, 6), 1e-3, size=(0.7, 0.5), stiffness=1e-3, damping=0.0, pins=())
    storm = cs.Wind((0.0, 20.0, 0.0), density=1.3, normal=1.2, tangential=0.1)
    scene, calm = (cs.Scene(cloth, gravity=(0, 0, 0), wind=wind) for wind in (storm, None))
    rest = cloth.rest_positions, np.zeros((8, 6, 3))
    limit = cs.max_stable_dt(scene, "rk4", *rest)
    assert limit == pytest.approx(2.785 / (1.3 * 0.35 * 1.2 * 20 / 1e-3), rel=0.05)
    assert 3 * limit < cs.max_stable_dt(calm, "rk4", *rest)
    with_half = cs.max_stable_dt(scene, "rk4", rest[0], rest[1] + (0, 10, 0))
    assert with_half == pytest.approx(2 * limit, rel=0.05)
    assert 0.1 * limit < cs.max_stable_dt(scene) <= limit < 0.1 * cs.max_stable_dt(calm)
    gusts = cs.Sinusoid((0.0, 8.0 / (2 * np.pi), 0.0), 1.0)  # a wind of 8 m/s
    gusty = scene.replace(wind=storm.replace(velocity=(0.0, 12.0, 0.0), motion=gusts))
    assert cs.max_stable_dt(gusty) == pytest.approx(cs.max_stable_dt(scene), rel=2e-3)
    account = scene.explain()
    assert "wind" in account["computed"] and "wind" in calm.explain()["left_out"]
    assert "the damping of the wind" in account["limited_by"]


@pytest.mark.parametrize("motion", [None, GUSTS, cs.Keyframes([0.0, 1.0], offsets=np.eye(3)[:2])])
def test_files_and_copies_keep_a_wind(motion, tmp_path):
    scene = random_scene(wind=WIND.replace(motion=motion))
    cs.save_scene(scene, tmp_path / "scene.toml")
    for copy in (
        cs.Scene.from_dict(scene.to_dict()),
        cs.load_scene(tmp_path / "scene.toml"),
        pickle.loads(pickle.dumps(scene)),
    ):
        assert copy == scene and copy.wind == scene.wind and hash(copy.wind) == hash(scene.wind)
    assert scene != scene.replace(wind=None) != scene.replace(wind=WIND.replace(density=1.0))


@pytest.mark.parametrize(
    "make, error, message",
    [
        (lambda: cs.Wind("x"), TypeError, "velocity"),
        (lambda: cs.Wind((1.0, 2.0)), ValueError, "velocity"),
        (lambda: cs.Wind((1.0, 2.0, np.nan)), ValueError, "velocity"),
        (lambda: cs.Wind(density=-1), ValueError, "density"),
        (lambda: cs.Wind(normal=-1e-3), ValueError, "normal"),
        (lambda: cs.Wind(tangential="a"), TypeError, "tangential"),
        (lambda: cs.Wind(motion=3), TypeError, "motion"),
        (lambda: cs.Wind.from_dict({"motion": {"kind": "x"}}), ValueError, "motion kind"),
        (lambda: cs.Wind.from_dict({"speed": 1.0}), (TypeError, ValueError), "speed"),
        (lambda: cs.Scene(SHEET, wind=3), TypeError, "wind"),
        (
            lambda: check_scenes([random_scene()]),
            ValueError,
            "wind must be left out with backend 'gpu'",
        ),
    ],
)
def test_errors_name_the_argument(make, error, message):
    with pytest.raises(error, match=message):
        make()


def test_a_sweep_over_the_wind_has_the_runs_of_its_scenes():
    pytest.importorskip("xarray")
    scene = random_scene()
    over = {"wind_velocity_x": [0.0, 5.0]}
    metrics = {"x": lambda run: run.x[-1]}
    grid = cs.sweep(scene, over, duration=0.1, dt=1e-3, progress=False, metrics=metrics)
    for k, speed in enumerate(over["wind_velocity_x"]):
        wind = WIND.replace(velocity=(speed, *WIND.velocity[1:]))
        run = cs.simulate(scene.replace(wind=wind), 0.1, dt=1e-3)
        assert np.array_equal(grid.x[k], run.x[-1])


def test_a_fit_finds_the_coefficients_of_the_wind():
    pytest.importorskip("scipy")
    pytest.importorskip("xarray")
    times = np.linspace(0.05, 0.4, 8)
    values = {"wind_normal": 1.1, "wind_tangential": 0.3}
    scene = random_scene(cloth=SHEET.replace(shape=(5, 4)))
    x = cs.simulate(scene, 0.4, rtol=1e-9, times=times).x[1:]
    noise = np.random.default_rng(0).normal(0, 1e-3, x.shape)
    start = scene.replace(wind=WIND.replace(normal=0.6, tangential=0.5))
    fit = cs.fit(start, times, x + noise, list(values), sigma=1e-3)
    assert fit.report["reason"] == ""
    for name, value in values.items():
        assert abs(fit.values[name] - value) < 3 * fit.errors[name] < 0.2 * value
