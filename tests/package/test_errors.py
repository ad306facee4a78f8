"""Bad input: the error names the argument, and nothing that was passed in has changed."""

import math

import clothsim as cs
import numpy as np
import pytest

SCENE = cs.Scene(cs.Cloth((4, 5)))
X, V = SCENE.initial_position, SCENE.initial_velocity


def nan_at(array, value=math.nan):
    array = array.copy()
    array[2, 3, 1] = value
    return array


def test_nan_is_named_by_its_index():
    with pytest.raises(ValueError, match=r"got nan at index \(2, 3, 1\)"):
        cs.step(SCENE, nan_at(X), V, 1e-3)


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


def test_out_is_written_and_returned(variant, crumpled, same_bits):
    scene, x, v, dt = crumpled()
    expected = cs.step(scene, x, v, dt, 20, **variant.options)
    for same_scene in (scene, scene.replace()):  # a waiting engine steps it, then a new one
        out = np.empty_like(x), np.empty_like(v)
        result = cs.step(same_scene, x, v, dt, 20, out=out, **variant.options)
        assert result[0] is out[0] and result[1] is out[1]
        assert same_bits(out, expected)
    x_in_place = x.copy()
    v_in_place = v.copy()
    cs.step(scene, x_in_place, v_in_place, dt, 20, out=(x_in_place, v_in_place), **variant.options)
    assert same_bits((x_in_place, v_in_place), expected)
    x_swapped = x.copy()
    v_swapped = v.copy()
    cs.step(scene, x_swapped, v_swapped, dt, 20, out=(v_swapped, x_swapped), **variant.options)
    assert same_bits((v_swapped, x_swapped), expected)
    over = x.copy()
    for start, a in ((x, np.empty_like(x)), (over, over)):
        assert cs.acceleration(scene, start, v, out=a, **variant.options) is a
        assert same_bits([a], [cs.acceleration(scene, x, v, **variant.options)])


def test_inputs_are_never_changed(variant, crumpled, same_bits):
    scene, x, v, dt = crumpled()
    for dtype in (np.float64, np.float32):
        arrays = x.astype(dtype), v.astype(dtype)
        copies = arrays[0].copy(), arrays[1].copy()
        cs.step(scene, *arrays, dt, 5, **variant.options)
        cs.acceleration(scene, *arrays, **variant.options)
        cs.Stepper(scene, *arrays, **variant.options).advance(5, dt)
        cs.energy(scene, *arrays)
        cs.reference_step(scene, *arrays, dt)
        cs.penetration(arrays[0], cs.Sphere())
        assert same_bits(arrays, copies)


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
    numbers = np.arange(x.size).reshape(x.shape)
    assert same_bits(
        cs.step(scene, numbers, 0 * numbers, dt), cs.step(scene, numbers * 1.0, 0.0 * numbers, dt)
    )


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


def test_attributes_of_a_stepper_are_not_set_in_silence():
    stepper = cs.Stepper(SCENE)
    for name in ("dt", "time", "positions"):
        with pytest.raises(AttributeError, match=name):
            setattr(stepper, name, 1.0)


def test_masked_entries_are_no_numbers():
    hidden = np.ma.array(X, mask=np.zeros(X.shape, bool))
    assert np.array_equal(cs.step(SCENE, hidden, V, 1e-3)[0], cs.step(SCENE, X, V, 1e-3)[0])
    hidden[2, 3] = np.ma.masked
    for name, call in {
        "x": lambda: cs.step(SCENE, hidden, V, 1e-3),
        "position": lambda: SCENE.replace(position=hidden),
        "x ": lambda: cs.picture(SCENE, hidden),
        "mass": lambda: cs.Cloth((4, 5), mass=1.0 + hidden[..., 0] ** 2),
    }.items():
        with pytest.raises(ValueError, match=f"{name.strip()} must be .* masked"):
            call()
    with pytest.raises(TypeError, match=r"center\[1\] must be a finite number"):
        cs.Sphere(np.ma.array([0.0, 1.0, 2.0], mask=[0, 1, 0]))
