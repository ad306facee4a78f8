"""Wide cloths that do not fit into cache are stepped strip by strip of their columns."""

import functools

import clothsim as cs
import numpy as np
import pytest
from clothsim import _core
from variants import INSTRUCTION_SETS, NAMED_KERNELS, PRECISIONS, cases, pairs

BOUND = {"double": 1e-12, "single": 5e-5}

# No state fits into the shared cache. The first is no multiple of a vector wide, and with the four
# doubles of AVX2 its strips overlap by 16 columns, so that a halo of 7 would do harm; each band of
# rows of the second fits into cache; the third has several strips whatever the size of the
# second-level cache.
SHAPES = [(61, 1521), (16, 5464), (40, 2600)]
BYTES_OF_POINT = 48
STEPS = 4

UNIFORM = {"mass": "uniform", "pins": ()}
FEATURES = {
    "per point": {},
    "uniform": UNIFORM,
    "no bend": {**UNIFORM, "springs": ("structural", "shear")},
}


@pytest.fixture(params=PRECISIONS)
def options(request):
    return {"precision": request.param, "kernel": "edge"}


@functools.cache
def reference(crumpled, shape, features):
    assert BYTES_OF_POINT * shape[0] * shape[1] > _core.heuristics["bytes_in_shared_cache"]
    state = scene, x, v, dt = crumpled(shape=shape, **FEATURES[features])
    return state, cs.reference_step(scene, x, v, dt, STEPS)


@pairs(precision=PRECISIONS, shape=SHAPES, features=FEATURES)
def test_they_agree_with_the_reference(crumpled, relative, same_bits, precision, shape, features):
    """However many threads and calls: the strips' borders outlast both."""
    (scene, x, v, dt), expected = reference(crumpled, shape, features)
    options = {"precision": precision, "kernel": "edge"}
    results = [cs.step(scene, x, v, dt, STEPS, **options, threads=threads) for threads in (1, 2)]
    for threads in (1, 3):
        stepper = cs.Stepper(scene, x, v, **options, threads=threads)
        for steps in (1, 2, 1):
            stepper.advance(steps, dt)
        results.append((stepper.positions, stepper.velocities))
    assert relative(results[0], expected, x) < BOUND[precision]
    assert all(same_bits(result, results[0]) for result in results[1:])


@cases(precision=["double"])
def test_instruction_sets_agree(variant, crumpled, relative):
    (scene, x, v, dt), expected = reference(crumpled, SHAPES[0], "per point")
    result = cs.step(scene, x, v, dt, STEPS, **variant.options)
    assert relative(result, expected, x) < BOUND["double"]


def test_accelerations_after_steps(options, crumpled, oracle):
    """They need the halos that a step leaves behind."""
    scene, x, v, dt = crumpled(shape=SHAPES[0])
    stepper = cs.Stepper(scene, x, v, **options, threads=2)
    stepper.advance(3, dt)
    expected = oracle.acceleration(scene, stepper.positions, stepper.velocities)
    result = np.empty((1, *SHAPES[0], 3))
    stepper._state.core.accelerations(result, 1)
    result = result[0]
    bound = {"double": 1e-12, "single": 5e-5}[options["precision"]]
    assert np.abs(result - expected).max() < bound * np.abs(expected).max()


@pytest.mark.parametrize("response", ["reflect", "ray"])
def test_points_in_halos_get_one_response(options, crumpled, relative, response):
    """A sphere that is wider than a strip."""
    ball = cs.Sphere((0.45, -0.2, 0.65), 0.25, response=response, offset="edge", restitution=1.0)
    scene, x, v, dt = crumpled(shape=SHAPES[0], **UNIFORM, spheres=(ball,))
    results = []
    for kernel, threads in (("gather", 1), ("edge", 1), ("edge", 2)):
        stepper = cs.Stepper(scene, x, v, **{**options, "kernel": kernel}, threads=threads)
        stepper.advance(STEPS, dt)
        results.append((stepper.positions, stepper.velocities, stepper._state.core.contacts[0]))
    assert results[0][2] > 1_000
    for end in results[1:]:
        assert end[2] == results[0][2]
        assert relative(end[:2], results[0][:2], x) < 10 * BOUND[options["precision"]]


@pairs(
    isa=INSTRUCTION_SETS,
    precision=PRECISIONS,
    shape=[(2, 2), (3, 33), (5, 16), (4, 100), *SHAPES[:2], (400, 64), (330, 320)],
    threads=[1, 2, 3],
    kernel=NAMED_KERNELS,
)
def test_one_number_that_is_not_finite_is_found(
    monkeypatch, overflowing, isa, precision, shape, threads, kernel
):
    """Each thread looks at its rows when the last step of a call is done with them."""
    monkeypatch.setenv("CLOTHSIM_ISA", isa)
    rows, columns = shape
    middle = rows // 2  # the row at which two threads meet
    inner = min(9, columns - 1)
    places = {(row, inner) for row in (middle - 1, middle, 2 * rows // 3, rows - 1)}
    for point in places | {(0, columns - 1), (1, columns // 3)}:
        scene, v = overflowing(shape, point, precision, mass=float(rows * columns))
        stepper = cs.Stepper(
            scene, scene.initial_position, v, kernel=kernel, precision=precision, threads=threads
        )
        with pytest.raises(cs.UnstableError) as raised:
            stepper.advance(5, 0.9)
        assert raised.value.point == point


@pytest.mark.parametrize("precision", PRECISIONS)
def test_driven_pins_move_in_the_halos_too(crumpled, relative, same_bits, precision):
    """A pin in every fourth column: some stand where strips overlap, and where bands meet."""
    shake = cs.Sinusoid((0.05, -0.02, 0.03), frequency=50.0)
    pins = {(row, column): shake for row in (0, 30) for column in range(0, SHAPES[0][1], 4)}
    scene, x, v, dt = crumpled(shape=SHAPES[0], pins=list(pins))
    scene = scene.replace(cloth=scene.cloth.replace(pins=pins), position=x)
    for pin in pins:
        v[pin] = shake.velocity_at(0.0)
    expected = cs.reference_step(scene, x, v, dt, STEPS, t=0.0)
    results = [
        cs.step(scene, x, v, dt, STEPS, t=0.0, precision=precision, threads=threads)
        for threads in (1, 2)
    ]
    assert relative(results[0], expected, x) < BOUND[precision]
    assert same_bits(*results)
