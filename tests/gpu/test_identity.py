"""The shader has the results of the gather kernel, bit for bit where the adapter rounds right."""

import clothsim as cs
import numpy as np
import pytest
from gpu_probe import thread_ids

DT = 4e-4
# A point of the paper's swing may be so far from the core's after 0.04 s [m]. WGSL lets a root be
# wrong by 4.5 units in the last place; every spring longer by as much moves a point by 4.9e-7 m.
WGSL_BOUND = 2e-6


def pair(scene, precision="single", x=None, v=None, steps=0):
    """Make a stepper of the core and one of the adapter, with the core's state after some steps."""
    options = {"precision": precision, "kernel": "gather"}
    core = cs.Stepper(scene, x, v, t=0.0, threads=1, **options)
    # The adapter, which may be a CPU, need not take these steps too.
    core.advance(steps, DT)
    state = core.positions, core.velocities
    return [
        cs.Stepper(scene, *state, t=core.time, backend=backend, **options)
        for backend in ("cpu", "gpu")
    ]


def assert_same_bits(cpu, gpu):
    """Compare positions and velocities, with their compensation, and the clock."""
    gpu, cpu = gpu.snapshot().core, cpu.snapshot().core
    # The adapter does not sum these.
    assert cpu.keys() - gpu.keys() == {"impulses", "contacts"}
    for name, value in gpu.items():
        assert np.asarray(value).tobytes() == np.asarray(cpu[name]).tobytes(), name


def test_lavapipe_rounds_correctly_and_contracts_nothing(device, rounding, exact):
    if "llvmpipe" not in device.adapter.name:
        pytest.skip(f"{device.adapter.name} is not lavapipe")
    assert exact
    for errors in rounding.values():
        assert errors["product and sum"] == 0
        # It does carry (a + b) - a = b through; `keep` is there for that.
        assert errors["compensation"] > 1 and errors["compensation, kept"] == 0


def ball(height=-0.29, **changes):
    return cs.Sphere((0.5, height, 0.5), 0.25, **{"response": "ray", **changes})


def draped(*spheres, shape=(20, 20), **cloth):
    return cs.Scene(cs.Cloth(shape, **cloth), spheres)


RISING = cs.Linear((0.1, 0.5, 0.0))
LOOSE = {"stiffness": 0, "damping": 0, "pins": ()}
RAIN = np.random.default_rng(3).uniform((-30, -70, -30), (30, -10, 30), (20, 20, 3))
GRAZE = np.random.default_rng(4).uniform((-3, -0.02, -3), (3, 0.02, 3), (20, 20, 3))
RESPONSES = {
    "reflect": draped(ball(response="reflect", offset="edge")),
    "ray": draped(ball(offset="edge")),
    "reflect as_printed": draped(ball(response="reflect", as_printed=True, offset="none")),
    "ray as_printed, moving": draped(ball(as_printed=True, offset=0.01, motion=RISING)),
    "two, rough, moving": draped(
        ball(restitution=0.4, friction=0.3, motion=RISING),
        cs.Sphere(
            (0.4, -0.4, 0.2), 0.15, cs.Linear((0, 0.1, 0)), "reflect", friction=0.2, offset="edge"
        ),
    ),
    "cell, mass per point": draped(
        ball(restitution=0.0), shape=(10, 12), mass=np.linspace(0.5, 2.0, 120).reshape(10, 12)
    ),
    "begins inside": draped(ball(-0.2, restitution=0.5), shape=(33, 17)),
    "chain": draped(
        ball(restitution=0.0).replace(center=(0.5, -0.29, 0.0)),
        shape=(1, 20),
        pins=((0, 0), (0, 19)),
    ),
    "floor and ball": draped(
        ball(0.35, restitution=0.0, motion=cs.Linear((0.0, -0.5, 0.0))),
        cs.Plane((0.0, -0.05, 0.0), response="ray", restitution=0.2, friction=0.3),
        pins=(),
    ),
    "slope that reflects": draped(
        cs.Plane((0.0, -0.1, 0.0), (0.1, 1.0, 0.05), response="reflect", friction=0.2), pins=()
    ),
    "overlapping, rain": draped(
        *(cs.Sphere((x, -0.12, 0.5), 0.15, None, "ray", "none") for x in (0.37, 0.63)), **LOOSE
    ).replace(velocity=RAIN),
    # Points begin below it, and their rays are longer than their ways in a step.
    "floor, grazed": draped(
        cs.Plane((0.0, 1e-3, 0.0), response="ray", restitution=0.5), **LOOSE
    ).replace(velocity=GRAZE),
}
DOUBLE = ("two, rough, moving", "floor and ball", "overlapping, rain", "floor, grazed")


def layered(height=-0.29, **changes):
    return ball(height, response="penalty", **changes)


FLOOR = cs.Plane((0.0, -0.1, 0.0), (0.1, 1.0, 0.05), friction=0.4)
LAYERS = {
    "sphere": draped(layered()),
    "plane, rough": draped(FLOOR, pins=()),
    "plane, moving": draped(FLOOR.replace(motion=cs.Sinusoid((0.0, 0.02, 0.0), 5.0))),
    "two, rough, mass per point": draped(
        layered(friction=0.3),
        FLOOR,
        shape=(10, 12),
        mass=np.linspace(200, 600, 120).reshape(10, 12) / 120,
        drag=0.1,
    ),
    "sphere, moving": draped(layered(friction=0.3, motion=RISING), shape=(33, 17)),
    "keyframes": draped(
        layered(
            motion=cs.Keyframes(
                [0.0, 0.1001, 0.1502], offsets=[(0, 0, 0), (0, 0.1, 0), (0.1, 0, 0)]
            )
        )
    ),
    "before ray": draped(
        layered(), cs.Sphere((0.9, -0.15, 0.6), 0.1, response="ray", motion=RISING)
    ),
    "before reflect": draped(
        layered(friction=0.1), cs.Sphere((0.2, -0.2, 0.2), 0.1, RISING, "reflect")
    ),
}


@pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")
@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("name", LAYERS)
def test_a_layer_has_the_bits_of_the_core(name, precision, needs_exact):
    """The force of response "penalty", at the places that obstacles have at the stages."""
    scene = LAYERS[name]
    cpu, gpu = pair(scene, precision, steps=150)
    free = cs.Stepper(
        scene.replace(spheres=()), cpu.positions, cpu.velocities, t=cpu.time, precision=precision
    )
    for stepper in (cpu, gpu, free):
        stepper.advance(200, DT)
    second = cs.Stepper.restore(gpu.snapshot())
    for stepper in (cpu, second, free):
        stepper.advance(100, DT)
    assert_same_bits(cpu, second)
    assert np.abs(free.positions - cpu.positions).max() > 1e-3


@pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")
@pytest.mark.parametrize(
    "name, precision",
    [*((name, "single") for name in RESPONSES), *((name, "double") for name in DOUBLE)],
)
def test_a_response_has_the_bits_of_the_core(name, precision, needs_exact):
    scene = RESPONSES[name]
    # A scene with velocities falls through everything within some steps.
    cpu, gpu = pair(scene, precision, steps=150 if scene.velocity is None else 0)
    free = cs.Stepper(
        scene.replace(spheres=()), cpu.positions, cpu.velocities, t=cpu.time, precision=precision
    )
    for stepper in (cpu, gpu, free):
        stepper.advance(300, DT)
    assert_same_bits(cpu, gpu)
    assert cpu._state.core.contacts[0] > 0 and cpu._state.core.contacts == gpu._state.core.contacts
    assert np.abs(free.positions - cpu.positions).max() > 1e-3


FEATURES = [
    {"mass": "uniform"},
    {"damped_by": "nothing", "shape": (33, 17)},
    {"damped_by": "both"},
    {"damped_by": "points", "mass": "uniform", "springs": ("structural", "bend")},
    {"springs": ("structural",), "pins": ()},
    {"springs": ("shear", "bend"), "shape": (16, 32)},
    {"shape": (1, 20), "pins": ((0, 0),)},
]


@pytest.mark.parametrize("features", FEATURES, ids=str)
def test_every_feature_has_the_bits_of_the_core(features, precision, crumpled, needs_exact):
    scene, x, v, dt = crumpled(**features)
    cpu, gpu = pair(scene, precision, x, v)
    for stepper in (cpu, gpu):
        stepper.advance(100, dt)
    assert_same_bits(cpu, gpu)


def test_the_swing_is_within_the_stated_bound_on_any_adapter(exact):
    cpu, gpu = pair(cs.scenes.paper_swing())
    for stepper in (cpu, gpu):
        stepper.advance(400, 1e-4)
    assert np.abs(gpu.positions - cpu.positions).max() <= (0 if exact else WGSL_BOUND)


def test_far_away_single_has_the_bits_of_the_core(crumpled, needs_exact):
    """Without an origin of its own, float32 would tell points apart by 2e-4 m there."""
    far = np.array([3000.0, -200.0, 0.0])
    center = tuple(np.array([0.6, -0.2, 0.4]) + far)
    scene, x, v, dt = crumpled(
        spheres=cs.Sphere(center, 0.25, cs.Linear((0, 0.5, 0.1)), "ray", offset="edge")
    )
    cpu, gpu = pair(scene, "single", x + far, v)
    for stepper in (cpu, gpu):
        stepper.advance(60, dt)
    assert_same_bits(cpu, gpu)
    assert gpu._state.core.contacts[0] > 50
    second = cs.Stepper.restore(gpu.snapshot())
    for stepper in (cpu, second):
        stepper.advance(40, dt)
    assert_same_bits(cpu, second)


@pytest.mark.parametrize("shape", [(32, 32), (16, 48), (1, 2), (17, 16), (20, 33)], ids=str)
def test_every_point_has_the_same_ids_on_the_adapter_and_in_the_core(shape):
    written = thread_ids(shape)
    expected = cs.thread_grid(shape)
    assert written.dtype == expected.dtype and written.shape == shape
    for name in expected.dtype.names:
        np.testing.assert_array_equal(written[name], expected[name], err_msg=name)
    assert sorted(written["index"].ravel()) == list(range(shape[0] * shape[1]))
