"""Bad input: the error names the argument, and nothing that was passed in has changed."""

import itertools
import math

import clothsim as cs
import numpy as np
import pytest
from tables import each

SCENE = cs.Scene(cs.Cloth((4, 5)))
X, V = SCENE.initial_position, SCENE.initial_velocity


@pytest.fixture(params=["first call", "later call"])
def ready(request):
    """`ready()`: the next call is a first one, or takes an engine that waits at the scene. An error leaves none behind."""

    def prepare():
        SCENE.engines.clear()
        for options in ({}, {"threads": 1}, {"strict": True}) if request.param == "later call" else ():
            cs.step(SCENE, X, V, 1e-3, **options)
            cs.acceleration(SCENE, X, V, **options)

    return prepare


def nan_at(array, value=math.nan):
    array = array.copy()
    array[2, 3, 1] = value
    return array


BAD_STATES = {
    "shape": (X[:3], ValueError),
    "flat": (X.reshape(-1, 3), ValueError),
    "transposed": (X.swapaxes(0, 1), ValueError),
    "two components": (X[..., :2], ValueError),
    "empty batch": (np.empty((0, 4, 5, 3)), ValueError),
    "five dimensions": (X[None, None], ValueError),
    "scalar": (1.0, ValueError),
    "ragged": ([[[0.0, 0.0, 0.0]], [[1.0, 1.0]]], ValueError),
    "nan": (nan_at(X), ValueError),
    "inf": (nan_at(X, -math.inf), ValueError),
    "complex": (X.astype(complex), TypeError),
    "bool": (X.astype(bool), TypeError),
    "text": (X.astype(str), TypeError),
    "object": (X.astype(object), TypeError),
    "a word": ("rest", TypeError),
    "a dict": ({}, TypeError),
}
STEPPING = {
    "step": lambda x, v, **k: cs.step(SCENE, x, v, 1e-3, **k),
    "acceleration": lambda x, v, **k: cs.acceleration(SCENE, x, v, **k),
    "Stepper": lambda x, v, **k: cs.Stepper(SCENE, x, v, **k),
    "energy": lambda x, v: cs.energy(SCENE, x, v),
    "reference_step": lambda x, v: cs.reference_step(SCENE, x, v, 1e-3),
    "max_stable_dt": lambda x, v: cs.max_stable_dt(SCENE, "rk4", x, v),
}


@each("value, error", BAD_STATES.values())
def test_states(value, error, ready):
    kept = value.copy() if isinstance(value, np.ndarray) else value
    for call, name in itertools.product(STEPPING, ("x", "v")):
        arguments = {"x": X, "v": V, name: value}
        ready()
        with pytest.raises(error, match=rf"^{name} must be an array of shape \(4, 5, 3\)") as raised:
            STEPPING[call](**arguments)
        assert "got" in str(raised.value), call
        if isinstance(value, np.ndarray):
            assert value.tobytes() == kept.tobytes() or value.dtype == object


def test_nan_is_named_by_its_index():
    with pytest.raises(ValueError, match=r"got nan at index \(2, 3, 1\)"):
        cs.step(SCENE, nan_at(X), V, 1e-3)


def test_x_and_v_of_one_shape():
    with pytest.raises(ValueError, match="x and v must have one shape"):
        cs.step(SCENE, X[None], V, 1e-3)


def test_one_state_for_the_reference_and_for_a_stable_step():
    for call in (lambda: cs.reference_step(SCENE, X[None], V[None], 1e-3), lambda: cs.max_stable_dt(SCENE, x=X[None])):
        with pytest.raises(ValueError, match="one state"):
            call()
    with pytest.raises(ValueError, match="v must be None"):
        cs.max_stable_dt(SCENE, v=V)


@each(
    "name, value, error",
    [
        ("dt", 0.0, ValueError),
        ("dt", "1", TypeError),
        ("dt", None, TypeError),
        ("dt", True, TypeError),
        ("steps", -1, ValueError),
        ("steps", 1.0, TypeError),
        ("steps", True, TypeError),
        ("steps", None, TypeError),
        ("steps", 2**63, ValueError),
        ("t", math.nan, ValueError),
        ("t", "0", TypeError),
    ],
)
def test_numbers(name, value, error, ready):
    arguments = {"dt": 1e-3, "steps": 1, "t": 0.0, name: value}
    ready()
    for call in (cs.step, cs.reference_step):
        with pytest.raises(error, match=f"^{name} must be"):
            call(SCENE, X, V, **arguments)


@each(
    "name, value, error",
    [
        ("integrator", "eular", ValueError),
        ("precision", "half", ValueError),
        ("kernel", "gahter", ValueError),
        ("strict", 1, TypeError),
        ("threads", True, TypeError),
        ("threads", 1.0, TypeError),
    ],
)
def test_options(name, value, error, ready):
    calls = [
        lambda **k: cs.step(SCENE, X, V, 1e-3, **k),
        lambda **k: cs.Stepper(SCENE, **k),
        lambda **k: cs.simulate(SCENE, 0.01, 1e-3, **k),
    ]
    ready()
    for call in calls:
        with pytest.raises(error, match=f"^{name} must be"):
            call(**{name: value})


def test_a_misspelt_option_gets_an_error_with_the_nearest_name():
    with pytest.raises(ValueError, match="did you mean 'gather'"):
        cs.step(SCENE, X, V, 1e-3, kernel="gahter")


@each(
    "scene, error",
    [
        (None, TypeError),
        ("paper", TypeError),
        (SCENE.cloth, TypeError),
        ([], ValueError),
        ([SCENE, SCENE.cloth], TypeError),
        ([SCENE, cs.Scene(cs.Cloth((5, 4)))], ValueError),
    ],
)
def test_scenes(scene, error):
    with pytest.raises(error, match="scene must be"):
        cs.step(scene, X, V, 1e-3)


def test_as_many_scenes_as_states():
    for batch in (X, X[None], np.stack([X] * 3)):
        with pytest.raises(ValueError, match=r"x must be an array of shape \(2, 4, 5, 3\)"):
            cs.step([SCENE, SCENE], batch, batch, 1e-3)


def read_only(array):
    array.flags.writeable = False
    return array


def unaligned(shape, dtype=np.float64):
    raw = np.zeros(math.prod(shape) * 8 + 1, np.uint8)
    return raw[1:].view(dtype).reshape(shape)


OUTS = {
    "shape": (np.empty((5, 4, 3)), ValueError),
    "batch": (np.empty((1, 4, 5, 3)), ValueError),
    "float32": (np.empty((4, 5, 3), np.float32), ValueError),
    "integer": (np.empty((4, 5, 3), np.int64), ValueError),
    "big-endian": (np.empty((4, 5, 3), ">f8"), ValueError),
    "read-only": (read_only(np.empty((4, 5, 3))), ValueError),
    "Fortran": (np.empty((4, 5, 3), order="F"), ValueError),
    "strided": (np.empty((4, 5, 6))[..., ::2], ValueError),
    "unaligned": (unaligned((4, 5, 3)), ValueError),
    "flat": (np.empty(60), ValueError),
    "masked": (np.ma.masked_array(np.empty((4, 5, 3))), TypeError),
    "list": ([[0.0]], TypeError),
    "None": (None, TypeError),
}


@each("out, error", OUTS.values())
def test_out(out, error, ready):
    for k in (0, 1):
        ready()
        check_out(out, error, k)


def check_out(out, error, k):
    good = np.full((4, 5, 3), 5.0)
    pair = [good, good.copy()]
    pair[k] = out
    kept = out.tobytes() if isinstance(out, np.ndarray) else None
    with pytest.raises(error, match=rf"^out\[{k}\] must be a writeable"):
        cs.step(SCENE, X, V, 1e-3, out=tuple(pair))
    assert (pair[1 - k] == 5.0).all()
    if kept is not None:
        assert out.tobytes() == kept
    if k == 0 and out is not None:
        with pytest.raises(error, match="^out must be a writeable"):
            cs.acceleration(SCENE, X, V, out=out)


def test_out_is_two_arrays(ready):
    one, both = np.empty((4, 5, 3)), np.empty((5, 5, 3))
    shifted = [both.reshape(-1)[k : k + X.size].reshape(X.shape) for k in (0, 1)]
    length, shared = "^out must be a sequence of 2 arrays", "share no memory"
    for out, error, message in [
        ((one,), ValueError, length),
        ((one, one, one), ValueError, length),
        (7, TypeError, length),
        ((one, one), ValueError, shared),
        ((both[:4], both[1:]), ValueError, shared),
        (shifted, ValueError, shared),
    ]:
        ready()
        with pytest.raises(error, match=message):
            cs.step(SCENE, X, V, 1e-3, out=out)


def test_out_is_written_and_returned(variant, crumpled, same_bits):
    scene, x, v, dt = crumpled()
    expected = cs.step(scene, x, v, dt, 20, **variant.options)
    for one in (scene, scene.replace()):  # by an engine that waits, and by a new one
        out = np.empty_like(x), np.empty_like(v)
        result = cs.step(one, x, v, dt, 20, out=out, **variant.options)
        assert result[0] is out[0] and result[1] is out[1]
        assert same_bits(out, expected)
    x_in_place, v_in_place = x.copy(), v.copy()
    cs.step(scene, x_in_place, v_in_place, dt, 20, out=(x_in_place, v_in_place), **variant.options)
    assert same_bits((x_in_place, v_in_place), expected)
    x_swapped, v_swapped = x.copy(), v.copy()
    cs.step(scene, x_swapped, v_swapped, dt, 20, out=(v_swapped, x_swapped), **variant.options)
    assert same_bits((v_swapped, x_swapped), expected)
    over = x.copy()
    for given, a in ((x, np.empty_like(x)), (over, over)):
        assert cs.acceleration(scene, given, v, out=a, **variant.options) is a
        assert same_bits([a], [cs.acceleration(scene, x, v, **variant.options)])


def test_inputs_are_never_changed(variant, crumpled, same_bits):
    scene, x, v, dt = crumpled()
    for dtype in (np.float64, np.float32):
        given = x.astype(dtype), v.astype(dtype)
        kept = given[0].copy(), given[1].copy()
        cs.step(scene, *given, dt, 5, **variant.options)
        cs.acceleration(scene, *given, **variant.options)
        cs.Stepper(scene, *given, **variant.options).advance(5, dt)
        cs.energy(scene, *given)
        cs.reference_step(scene, *given, dt)
        cs.penetration(given[0], cs.Sphere())
        assert same_bits(given, kept)


def test_any_layout_and_number_type_is_taken_as_its_values(crumpled, same_bits):
    scene, x, v, dt = crumpled()
    expected = cs.step(scene, x, v, dt, 5)
    for change in (
        np.asfortranarray,
        lambda a: np.repeat(a, 2, axis=0)[::2],
        lambda a: a.tolist(),
        lambda a: a.astype(">f8"),
        read_only,
        lambda a: a[::-1][::-1],
    ):
        assert same_bits(cs.step(scene, change(x.copy()), change(v.copy()), dt, 5), expected)
    shifted = unaligned(x.shape)
    shifted[...] = x
    assert same_bits(cs.step(scene, shifted, v, dt, 5), expected)
    whole = np.arange(x.size).reshape(x.shape)
    assert same_bits(cs.step(scene, whole, 0 * whole, dt), cs.step(scene, whole * 1.0, 0.0 * whole, dt))


def test_the_result_has_the_dtype_of_the_input(variant, crumpled):
    scene, x, v, dt = crumpled()
    for x_dtype, v_dtype, result in [
        (np.float32, np.float32, np.float32),
        (np.float64, np.float64, np.float64),
        (np.float32, np.float64, np.float64),
        (np.float64, np.float32, np.float64),
        (np.float16, np.float16, np.float64),
        (np.int32, np.int32, np.float64),
    ]:
        xt, vt = cs.step(scene, x.astype(x_dtype), v.astype(v_dtype), dt / 10, **variant.options)
        assert xt.dtype == vt.dtype == result
        assert cs.acceleration(scene, xt, vt, **variant.options).dtype == np.float64


@each(
    "x, error",
    [
        (X[..., :2], ValueError),
        (X[0], ValueError),
        (nan_at(X), ValueError),
        (np.empty((0, 5, 3)), ValueError),
        ("x", TypeError),
        (X.astype(complex), TypeError),
    ],
)
def test_penetration(x, error):
    with pytest.raises(error, match="x must be"):
        cs.penetration(x, cs.Sphere())
    with pytest.raises(TypeError, match="sphere must be"):
        cs.penetration(X, None)
    with pytest.raises(ValueError, match="t must be"):
        cs.penetration(X, cs.Sphere(), t=math.inf)


def test_measures():
    with pytest.raises(TypeError, match="scene must be"):
        cs.max_stable_dt([SCENE])
    with pytest.raises(ValueError, match="integrator must be"):
        cs.max_stable_dt(SCENE, "rk5")
    with pytest.raises(TypeError, match="scene must be"):
        cs.energy(SCENE.cloth, X, V)


def test_a_stepper_stands_where_it_was_after_a_refused_advance(same_bits):
    stepper = cs.Stepper(SCENE)
    stepper.advance(3, 1e-3)
    kept, time = (stepper.positions, stepper.velocities), stepper.time
    bad_steps, bad_dt = (-1, 1.5, True, 2**63), (-1e-3, math.nan, None, True, "1")
    for arguments in [*((steps, 1e-3) for steps in bad_steps), *((1, dt) for dt in bad_dt)]:
        with pytest.raises((ValueError, TypeError), match="(steps|dt) must be"):
            stepper.advance(*arguments)
        assert stepper.time == time
        assert same_bits((stepper.positions, stepper.velocities), kept)
    stepper.advance(np.int64(2), np.float32(1e-3))
    assert stepper.time == time + 2 * float(np.float32(1e-3))


def test_a_state_of_none_is_refused():
    for x, v, name in [(None, None, "x"), (X, None, "v"), (None, V, "x")]:
        for call in (lambda x, v: cs.step(SCENE, x, v, 1e-3), lambda x, v: cs.acceleration(SCENE, x, v)):
            with pytest.raises(TypeError, match=f"^{name} must be an array, got None; the scene's own state is scene.init"):
                call(x, v)


def test_an_unfit_out_array_is_named_with_its_fault():
    for out, lacks in [(OUTS["read-only"][0], "writeable"), (OUTS["Fortran"][0], "C-contiguous")]:
        with pytest.raises(ValueError, match=f"got an array that is not {lacks}$"):
            cs.step(SCENE, X, V, 1e-3, out=(out, V.copy()))


def test_a_dtype_is_named_once():
    for value in (np.zeros((4, 5, 3), complex), "flat"):
        with pytest.raises(TypeError, match="^position must be") as caught:
            cs.Scene(SCENE.cloth, position=value)
        assert str(caught.value).count("dtype") == isinstance(value, np.ndarray)


def test_a_mass_whose_accelerations_overflow_is_refused():
    for mass in (5e-324, 1e-320, np.full((4, 5), 1e-305)):
        with pytest.raises(ValueError, match="^mass must be large enough.* kg for a mass point, and 35000"):
            cs.Cloth((4, 5), mass=mass)
    assert 0 < cs.max_stable_dt(cs.Scene(cs.Cloth((4, 5), mass=1e-295))) < np.inf


def test_attributes_of_a_stepper_are_not_set_in_silence():
    stepper = cs.Stepper(SCENE)
    for name in ("dt", "time", "positions"):
        with pytest.raises(AttributeError, match=f"^{name} of a Stepper cannot be set: set_state"):
            setattr(stepper, name, 1.0)


def test_spheres_have_an_order():
    sphere = cs.Sphere()
    for spheres in ({sphere, cs.Sphere(radius=0.1)}, {sphere: 1}):
        with pytest.raises(TypeError, match="^spheres must be a Sphere or a sequence"):
            cs.Scene(SCENE.cloth, spheres)
    assert cs.Scene(SCENE.cloth, (one for one in [sphere])).spheres == (sphere,)


def test_a_path_is_no_snapshot():
    with pytest.raises(TypeError, match=r"^snapshot must be a Snapshot, got 's.npz' \(str\); Snapshot.load reads it"):
        cs.Stepper.restore("s.npz")
