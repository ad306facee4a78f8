"""The shader's results are those of the core's gather kernel, bit for bit where the adapter rounds correctly."""

import clothsim as cs
import numpy as np
import pytest

# Furthest that a point of the paper's swing may be from the core's after 0.04 s [m]. WGSL lets a
# root be wrong by 4.5 units in the last place; every spring longer by as much moves a point by
# 4.9e-7 m.
WGSL_BOUND = 2e-6


def core(scene, precision, x=None, v=None, **options):
    return cs.Stepper(scene, x, v, precision=precision, kernel="gather", threads=1, **options)


def assert_same_bits(gpu, cpu):
    """Positions and velocities with their compensation, and the clock."""
    gpu, cpu = gpu.snapshot().core, cpu.snapshot().core
    assert cpu.keys() - gpu.keys() == {"impulses"}  # the adapter does not count them
    for name, value in gpu.items():
        assert np.asarray(value).tobytes() == np.asarray(cpu[name]).tobytes(), name


def test_lavapipe_rounds_correctly_and_contracts_nothing(device, rounding, exact):
    if "llvmpipe" not in device.adapter.name:
        pytest.skip(f"{device.adapter.name} is not lavapipe")
    assert exact
    for found in rounding.values():
        assert found["product and sum"] == 0
        # It does carry (a + b) - a = b through; `keep` is there for that.
        assert found["compensation"] > 1 and found["compensation, kept"] == 0


def swing():
    return cs.scenes.paper_swing(bend=True)


def rough_ball():
    scene = cs.scenes.paper_moving("ray", phase=0.15)
    ball = scene.spheres[0].replace(restitution=0.4, friction=0.3)
    other = cs.Sphere((0.4, -0.55, 0.2), 0.15, cs.Linear((0, 0.1, 0)), "reflect", friction=0.2, offset="edge")
    return scene.replace(spheres=(ball, other))


def literal_balls():
    """As printed, a response looks at the point's own velocity, not the relative one."""
    scene = cs.scenes.paper_moving("reflect", phase=0.15)
    ball = scene.spheres[0].replace(as_printed=True)
    return scene.replace(spheres=(ball, ball.replace(response="ray", offset="none")))


SCENES = {
    "swing": swing,
    "reflect": lambda: cs.scenes.paper_static("reflect"),
    "ray": lambda: cs.scenes.paper_static("ray"),
    "reflect as_printed": lambda: cs.scenes.paper_static("reflect", as_printed=True, offset="none"),
    "ray as_printed": lambda: cs.scenes.paper_static("ray", as_printed=True, offset=0.01),
    "moving, rough": rough_ball,
    "moving, as_printed": literal_balls,
}
CASES = [(name, "single") for name in SCENES] + [("ray", "double"), ("moving, rough", "double")]


@pytest.mark.parametrize("name, precision", CASES)
def test_the_same_bits_as_the_core_from_before_the_contact_on(name, precision, exact, device):
    if precision == "double" and not device.float64:
        pytest.skip(f"{device.adapter.name} has no float64")
    if not (exact and device.float64):
        pytest.skip(f"{device.adapter.name} does not round as the core does")
    scene, dt = SCENES[name](), 4e-4
    if name == "ray as_printed":
        dt = 2.5e-4
    fallen = core(scene, precision)
    fallen.advance(700 if scene.spheres else 0, dt)  # the adapter, which may be a CPU, need not do that too
    start = {"x": fallen.positions, "v": fallen.velocities, "t": fallen.time}
    cpu = core(scene, precision, **start)
    gpu = cs.Stepper(scene, precision=precision, backend="gpu", **start)
    cpu.advance(300, dt)
    gpu.advance(300, dt)
    assert_same_bits(gpu, cpu)
    if scene.spheres:  # it has met them
        free = core(scene.replace(spheres=()), precision, **start)
        free.advance(300, dt)
        assert np.abs(free.positions - cpu.positions).max() > 1e-3


FEATURES = [
    {"mass": "uniform"},
    {"damped_by": "nothing", "shape": (33, 17)},
    {"damped_by": "points"},
    {"damped_by": "both"},
    {"damped_by": "points", "mass": "uniform", "springs": ("structural", "bend")},
    {"springs": ("structural",), "pins": ()},
    {"springs": ("shear", "bend"), "shape": (16, 32)},
    {"shape": (1, 20), "pins": ((0, 0),)},
    {"shape": (2, 2)},
]


@pytest.mark.parametrize("features", FEATURES, ids=str)
def test_every_feature_has_the_bits_of_the_core(features, precision, crumpled, exact, device):
    if not (exact and device.float64):
        pytest.skip(f"{device.adapter.name} does not round as the core does")
    scene, x, v, dt = crumpled(**features)
    cpu = core(scene, precision, x, v)
    gpu = cs.Stepper(scene, x, v, precision=precision, backend="gpu")
    cpu.advance(100, dt)
    gpu.advance(100, dt)
    assert_same_bits(gpu, cpu)


def test_the_swing_is_within_the_stated_bound_on_any_adapter(exact):
    scene = cs.scenes.paper_swing()
    cpu = core(scene, "single")
    gpu = cs.Stepper(scene, precision="single", backend="gpu")
    cpu.advance(400, 1e-4)
    gpu.advance(400, 1e-4)
    bound = 0 if exact else WGSL_BOUND
    assert np.abs(gpu.positions - cpu.positions).max() <= bound
