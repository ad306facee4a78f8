"""Extrapolation in double-double, the independent half of the trusted solution."""

import math

import clothsim as cs
import numpy as np
import pytest
from clothsim import _core
from clothsim.model.as_core import core_pins

TIGHT = {"columns": 8, "tolerance": 1e-16, "threads": 1}


def extrapolate(scene, times, **settings):
    cloth, table = scene.cloth, scene.cloth.spring_table()
    fields = ("i", "j", "rest_length", "stiffness", "damping")
    result = _core.extrapolate(
        **{name: np.ascontiguousarray(table[name]) for name in fields},
        mass=np.ascontiguousarray(cloth.mass_per_point),
        pinned=np.ascontiguousarray(cloth.pinned),
        gravity=scene.gravity,
        drag=cloth.drag,
        force=np.zeros_like(cloth.rest_positions) if scene.force is None else scene.force,
        **core_pins(scene),
        x=np.ascontiguousarray(scene.initial_position),
        v=np.ascontiguousarray(scene.initial_velocity),
        times=times,
        **{**TIGHT, **settings},
    )
    for name in ("x", "v"):
        result[name] = result[name].reshape(-1, *cloth.shape, 3)
    return result


def oscillation(t, damping):
    """Position and velocity of the moving point of `oscillator()`, in long double."""
    t, w, g = np.longdouble(t), np.longdouble(10), np.longdouble(damping) / 2
    u = np.sqrt(w * w - g * g)
    e, c, s = np.exp(-g * t), np.cos(u * t), np.sin(u * t)
    # The amplitude is what the rounding of 1 + 0.1 leaves of it.
    amplitude = np.longdouble(1.0 + 0.1) - 1
    return 1 + amplitude * e * (c + g / u * s), -amplitude * w * w / u * e * s


@pytest.mark.parametrize("damping", [0.0, 3.0])
def test_rounds_the_exact_solution_of_the_oscillator(damping):
    scene = cs.scenes.oscillator(damping=damping)
    times = [0.3, 1.0, 7.0]
    result = extrapolate(scene, times)
    assert result["reached"] and result["time"] == 7.0
    for k, t in enumerate(times):
        x, v = oscillation(t, damping)
        assert abs(result["x"][k, 0, 1, 0] - float(x)) <= np.spacing(1.0)
        assert abs(result["v"][k, 0, 1, 0] - float(v)) < 1e-14
        assert (result["x"][k, 0, 0] == 0).all() and (result["x"][k, 0, 1, 1:] == 0).all()


def test_accelerations_are_those_of_the_model(crumpled, oracle):
    """A step so short that v' - v is the acceleration: every feature of a cloth, against NumPy."""
    for features in ({}, {"damped_by": "both"}, {"springs": ("shear", "bend")}):
        scene, x, v, _ = crumpled(**features)
        scene = scene.replace(position=x, velocity=v)
        dt = 1e-7
        result = extrapolate(scene, [dt])
        middle = x + dt / 2 * v
        a = oracle.acceleration(scene, middle, v + dt / 2 * oracle.acceleration(scene, x, v))
        assert abs((result["v"][0] - v) / dt - a).max() < 1e-7 * abs(a).max()


def test_threads_do_not_change_the_bits(crumpled, same_bits):
    scene, x, v, _ = crumpled()
    scene = scene.replace(position=x, velocity=v)
    one, two, many = (extrapolate(scene, [0.05], threads=n) for n in (1, 2, 5))
    for other in (two, many):
        assert same_bits((one["x"], one["v"]), (other["x"], other["v"]))


def test_says_where_the_forces_are_not_smooth():
    """A point that falls through another: the spring turns round at once."""
    cloth = cs.Cloth((1, 2), (1.0, 1.0), mass=2.0, stiffness=100.0, damping=0.0, pins=[(0, 0)])
    position = np.zeros((1, 2, 3))
    position[0, 1, 0] = 2.5  # 1 + 1.5 cos(10 t)
    meets = math.acos(-1 / 1.5) / 10
    result = extrapolate(cs.Scene(cloth, gravity=(0, 0, 0), position=position), [2 * meets])
    assert not result["reached"]
    assert result["time"] == pytest.approx(meets, rel=1e-6, abs=0)
