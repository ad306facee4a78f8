"""Driven pins: place and velocity at each stage, in every method, kernel, run, file and picture."""

import pickle

import clothsim as cs
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from variants import FIXED, cases

ORDERS = {name: cs.integrators()[name].order for name in FIXED}
# Smooth for half a second from t = 0; its speed falls from 1.8 m/s.
SWING = cs.Reciprocate((1.0, 0.5, -0.3), distance=0.3, period=1.0, deceleration=3.0)
SHAKE = cs.Sinusoid((0.05, -0.02, 0.03), frequency=3.0, phase=0.1)
LIFT = cs.Keyframes([0.0, 0.1, 0.3], offsets=[(0, 0, 0), (0, 0.02, 0), (0.1, 0.02, 0.05)])
CURVE = cs.Keyframes(
    [0.0, 0.01, 0.02, 0.05],
    offsets=[(0, 0, 0), (0, 0.02, 0), (0.02, 0.01, 0), (0, 0, 0.01)],
    smooth=True,
)


def driven_sheet(crumpled, shape=(6, 7), motions=None, **features):
    """Return a crumpled sheet at its own state, with two driven pins and one at rest."""
    pins = (
        {(0, 0): SWING, (-1, -1): cs.Linear((0.2, -0.4, 0.1)), (2, 3): None}
        if motions is None
        else motions
    )
    scene, x, v, dt = crumpled(shape=shape, pins=list(pins), **features)
    cloth = scene.cloth.replace(pins=pins)
    for pin, motion in cloth.driven.items():
        v[pin] = motion.velocity_at(0.0)
    return scene.replace(cloth=cloth, position=x, velocity=v), dt


def oracle_solution(scene, oracle, duration):
    """Positions at the end by SciPy: driven pins follow their motions, written out here."""
    shape = (2, *scene.cloth.shape, 3)

    def place(x, v, t):
        for pin, motion in scene.cloth.driven.items():
            start = scene.initial_position[pin] - motion.center_at(0.0, (0, 0, 0))
            if isinstance(motion, cs.Keyframes):
                start = scene.initial_position[pin]
            x[pin] = motion.center_at(t, start)
            v[pin] = motion.velocity_at(t)

    def rate(t, y):
        x, v = y.reshape(shape).copy()
        place(x, v, t)
        return np.stack([v, oracle.acceleration(scene, x, v)]).ravel()

    start = np.stack([scene.initial_position, scene.initial_velocity]).ravel()
    x, v = (
        solve_ivp(rate, (0, duration), start, "DOP853", rtol=1e-12, atol=1e-13)
        .y[:, -1]
        .reshape(shape)
    )
    place(x, v, duration)
    return x


@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
@pytest.mark.parametrize(
    "motion", [SWING, SHAKE, "spline"], ids=["reciprocate", "sinusoid", "spline"]
)
@pytest.mark.parametrize("integrator", ORDERS)
def test_every_method_keeps_its_order(integrator, motion, kernel, crumpled, oracle):
    method = cs.integrators()[integrator]
    damped_by = "springs" if method.damped else "nothing"
    *_, dt = crumpled(shape=(6, 7), damped_by=damped_by)
    duration = (2 if method.order == 1 else 8) * dt
    if motion == "spline":  # one of its pieces ends where a step does
        times = np.array([0.0, 0.5, 1.0, 3.0, 4.0]) * duration
        motion = cs.Keyframes(
            times, offsets=np.outer(np.sin(40 * times), (0.05, -0.02, 0.03)), smooth=True
        )
    scene, _ = driven_sheet(
        crumpled,
        motions={(0, 0): motion, (-1, -1): cs.Linear((0.2, -0.4, 0.1))},
        damped_by=damped_by,
    )
    exact = oracle_solution(scene, oracle, duration)
    first = {1: 64, 2: 32, 4: 48, 5: 12, 8: 6}[method.order]
    counts = np.array([first, 3 * first // 2, 2 * first])
    errors = []
    for n in counts:
        stepper = cs.Stepper(scene, integrator=integrator, kernel=kernel)
        stepper.advance(int(n), duration / n)
        errors.append(np.abs(stepper.positions - exact).max())
    if method.order == 8:
        assert errors[-1] < 1e-11
    else:
        assert abs(-np.polyfit(np.log(counts), np.log(errors), 1)[0] - method.order) < 0.2


@cases()
def test_steps_agree_with_the_reference(variant, crumpled, relative):
    bound = {"double": 1e-12, "single": 5e-5}[variant.precision]
    side = {(r, 0): CURVE for r in range(9)} | {(4, 19): SWING}
    for motions, shape in ((None, (6, 7)), (side, (9, 20)), ({(0, 1): SHAKE}, (1, 9))):
        scene, dt = driven_sheet(crumpled, shape, motions, damped_by="both")
        state = scene.initial_position, scene.initial_velocity
        expected = cs.reference_step(scene, *state, dt, 60, t=0.0)
        assert (
            relative(cs.step(scene, *state, dt, 60, t=0.0, **variant.options), expected, state[0])
            < bound
        )
        still_scene = scene.replace(
            cloth=scene.cloth.replace(pins=list(scene.cloth.pins)), velocity=None
        )
        still = cs.step(still_scene, state[0], 0 * state[1], dt, 60, **variant.options)
        assert relative(still, expected, state[0]) > 1e-2


def test_the_trusted_solution_agrees_with_scipy_and_runs_reach_it(crumpled, oracle):
    scene, _ = driven_sheet(crumpled, motions={(0, 0): LIFT, (3, 3): SWING})
    solution = cs.reference(scene, 0.2, every=0.1)
    assert solution.error_bound["max"][-1] < 1e-11
    for frame, t in ((1, 0.1), (2, 0.2)):
        assert np.abs(solution.x[frame] - oracle_solution(scene, oracle, t)).max() < 1e-8
    run = cs.simulate(scene, 0.2, rtol=1e-8, times=[0.05, 0.1, 0.15])
    assert np.abs(run.x[-1] - solution.x[-1]).max() < 1e-7
    for t, x, v in zip(run.t, run.x, run.v):
        assert np.abs(x[0, 0] - LIFT.center_at(t, scene.initial_position[0, 0])).max() < 1e-12
        assert np.abs(v[3, 3] - SWING.velocity_at(t)).max() < 1e-9
    convergence = cs.convergence(
        scene, 0.2, [2e-3, 1e-3, 5e-4], integrator="rk4"
    )  # steps end where a velocity jumps
    assert abs(convergence.order - 4) < 0.3


def test_members_have_driven_pins_of_their_own_and_runs_go_on(crumpled, same_bits, tmp_path):
    scene, dt = driven_sheet(crumpled)
    neighbour = scene.replace(
        cloth=scene.cloth.replace(pins={(0, 0): LIFT, (5, 5): None}), velocity=None
    )
    xs, vs = (
        np.stack([getattr(s, name) for s in (scene, neighbour)])
        for name in ("initial_position", "initial_velocity")
    )
    batch = cs.step([scene, neighbour], xs, vs, dt, 9, t=0.0)
    for k, member in enumerate((scene, neighbour)):
        assert same_bits([part[k] for part in batch], cs.step(member, xs[k], vs[k], dt, 9, t=0.0))
    run = cs.simulate(scene, 20 * dt, dt, every=4)
    part = cs.load_run(cs.simulate(scene, 8 * dt, dt).save(tmp_path / "run.npz")).resume(12 * dt)
    assert same_bits([part.x[-1]], [run.x[-1]])
    assert run.report["energy"]["reason"] == "driven pins do work on the cloth" and np.isnan(
        run.report["energy"]["gained"]
    )
    assert run.picture() is not None and run.export(tmp_path / "run.obj")


def test_scenes_with_driven_pins_are_plain_data(tmp_path, crumpled):
    side = {(r, -1): LIFT for r in range(6)} | {(0, 0): None, (3, 0): SWING}
    scene, _ = driven_sheet(crumpled, motions=side)
    path = cs.save_scene(scene, tmp_path / "scene.toml")
    assert "[[cloth.pins]]" in path.read_text() and "[cloth.pins.motion]" in path.read_text()
    assert path.read_text().count("offsets") == 1  # a shared motion is written once
    for copy in (
        cs.load_scene(path),
        cs.Scene.from_dict(scene.to_dict()),
        pickle.loads(pickle.dumps(scene)),
    ):
        assert (
            copy == scene and hash(copy) == hash(scene) and copy.cloth.driven == scene.cloth.driven
        )
    assert scene.cloth.pinned.sum() == 8 and set(scene.cloth.driven) == {
        (3, 0),
        *((r, 6) for r in range(6)),
    }
    assert cs.Cloth(pins={(0, 0): None, (-1, 0): None}) == cs.Cloth()
    names = {"still": [(0, 0)], "moved": {(0, 0): cs.Linear((0, 0.1, 0))}}
    table = cs.sweep(
        cs.Scene(cs.Cloth((4, 5))),
        over={"pins": names},
        duration=0.01,
        metrics=("stable",),
        progress=False,
    )
    assert table["stable"].values.all()


PULLED = cs.Scene(cs.Cloth((4, 4), pins={(0, 0): cs.Linear((1, 0, 0)), (3, 0): None}))


def test_set_state_leaves_pins_where_they_are():
    stepper = cs.Stepper(PULLED)
    stepper.advance(10, 1e-3)
    x = stepper.positions.copy()
    v = stepper.velocities.copy()
    stepper.set_state(x, v)
    for array, pin in ((x, (0, 0)), (x, (3, 0)), (v, (0, 0)), (v, (3, 0))):
        shifted_array = array.copy()
        shifted_array[pin][1] += 0.01
        name = "x" if array is x else "v"
        with pytest.raises(
            ValueError,
            match=rf"{name} must be \[.*\] at the pin \({pin[0]}, 0\), got .*; driven pins move",
        ):
            stepper.set_state(**{name: shifted_array})
    x[1, 1, 1] += 0.01
    stepper.set_state(x)
    assert stepper.positions[1, 1, 1] == x[1, 1, 1] and stepper.velocities[0, 0].tolist() == [
        1.0,
        0.0,
        0.0,
    ]


def test_a_frozen_member_keeps_its_driven_pins(same_bits):
    scene = cs.Scene(
        cs.Cloth(
            (4, 4), mass=0.3, stiffness=60.0, damping=0.02, pins={(0, 0): cs.Linear((0.2, 0, 0))}
        )
    )
    batch = cs.Stepper([scene, scene])
    batch.advance(50, 1e-3)
    batch.freeze(1)
    positions = batch.positions[1]
    batch.advance(30, 1e-3)
    batch.set_state(v=batch.velocities)
    batch.set_scene([scene, scene])
    restored = cs.Stepper.restore(batch.snapshot())
    assert same_bits((batch.positions[1], restored.positions[1]), (positions, positions))
    for stepper in (batch, restored):
        assert stepper.velocities[1, 0, 0].tolist() == [0.2, 0.0, 0.0]
    for stepper in (batch, restored):
        stepper.advance(10, 1e-3)
    assert same_bits((batch.positions, batch.velocities), (restored.positions, restored.velocities))
