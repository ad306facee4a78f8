"""Odd values for every argument of the public functions: each error names the argument."""

import contextlib
import decimal
import fractions
import re
import warnings
from functools import partial

import clothsim as cs
import numpy as np
import pytest

SCENE = cs.Scene(
    cs.Cloth((2, 3), mass=6.0, stiffness=100.0, damping=0.1), cs.Sphere((0.5, -9, 0.5), response="ray", offset="edge")
)
MOVING = cs.Scene(SCENE.cloth, cs.Sphere((0.5, -9, 0.5), motion=cs.Linear((0, 1, 0)), response="ray", offset="edge"))
X, V = SCENE.initial_position, SCENE.initial_velocity
RUN = cs.simulate(SCENE, 0.02, dt=0.01)
STEPPER = cs.Stepper(SCENE)
REFERENCE = cs.reference(cs.scenes.oscillator(), 0.1, cache=False)


class Number(fractions.Fraction):
    def __float__(self):
        raise ArithmeticError("of the caller")

    def __int__(self):
        raise ArithmeticError("of the caller")


class Index(int):
    def __int__(self):
        raise ArithmeticError("of the caller")

    __index__ = __float__ = __int__


class Path:
    def __fspath__(self):
        raise ArithmeticError("of the caller")


class Bytes:
    def __fspath__(self):
        return b"\xff"


ODD = [
    None,
    True,
    np.True_,
    0,
    -1,
    2**63,
    10**400,
    -(10**5000),
    0.5,
    -0.5,
    np.nan,
    np.inf,
    -np.inf,
    1e300,
    1e-320,
    np.float32(np.inf),
    np.int8(-3),
    np.longdouble("1e4000"),
    np.array(2.5),
    np.array(np.nan),
    np.array("a"),
    np.array([]),
    np.array([1, 2]),
    np.array([[1.0, np.nan]]),
    np.full((2, 3, 3), np.nan),
    np.array([None, 1], object),
    np.array(1j),
    np.array(["2020-01-01"], "M8[D]"),
    "",
    "12",
    "rk5",
    "a\0b",
    b"12",
    bytearray(b"1"),
    decimal.Decimal("1.5"),
    decimal.Decimal("NaN"),
    fractions.Fraction(1, 3),
    fractions.Fraction(10**400),
    1 + 2j,
    [],
    (),
    {},
    set(),
    [[]],
    [[1], [2, 3]],
    [[[0, 1], 2], 3],
    [None],
    ["a", 1],
    [10**400],
    [1.0, np.inf, 2.0],
    {"structural": None},
    {"a": 1},
    {1: 2},
    {("dt",): [(1,)]},
    range(3),
    iter([]),
    (one for one in [1, 2]),
    object(),
    object,
    len,
    Ellipsis,
    NotImplemented,
    Number(1, 2),
    Index(3),
    Path(),
    Bytes(),
    SCENE,
    SCENE.cloth,
    cs.Linear((1, 0, 0)),
    (10**9, 10**9),
    (2.0, 3.0),
    (2**40, 1),
    ("2", "3"),
    ((0, 0), (5, 5)),
    ((0.0, 0.0),),
    [[0, 1, 2]],
]

# Arguments that are good, by function; one of them at a time is replaced by something odd.
CALLS = {
    cs.Cloth: {
        "shape": (2, 3),
        "size": (1, 1),
        "mass": 1.0,
        "stiffness": 1.0,
        "damping": 1.0,
        "drag": 1.0,
        "springs": ("shear",),
        "pins": (),
    },
    cs.Sphere: {
        "center": (0, 0, 0),
        "radius": 1.0,
        "motion": None,
        "response": "ray",
        "offset": "edge",
        "restitution": 1.0,
        "friction": 0.0,
        "as_printed": False,
        "push_out_speed": 1.0,
    },
    cs.Linear: {"velocity": (1, 0, 0)},
    cs.Reciprocate: {"direction": (1, 0, 0), "distance": 1.0, "period": 1.0, "deceleration": 1.0, "phase": 0.0},
    cs.Keyframes: {"times": [0, 1], "centers": np.zeros((2, 3))},
    cs.Scene: {"cloth": SCENE.cloth, "spheres": (), "gravity": (0, 0, 0), "position": X, "velocity": V},
    cs.Scene.from_dict: {"data": SCENE.to_dict()},
    cs.scenes.hanging: {
        "shape": (2, 2),
        "size": (1, 1),
        "mass": 1.0,
        "stiffness": 1.0,
        "damping": 1.0,
        "springs": ("structural",),
    },
    cs.scenes.oscillator: {"stiffness": 1.0, "mass": 1.0, "amplitude": 0.1, "length": 1.0, "damping": 0.0},
    cs.scenes.paper_moving: {
        "response": "ray",
        "bend": False,
        "offset": "edge",
        "as_printed": False,
        "period": 1.0,
        "phase": 0.0,
        "deceleration": 1.0,
    },
    cs.step: {
        "scene": SCENE,
        "x": X,
        "v": V,
        "dt": 0.01,
        "steps": 1,
        "t": 0.0,
        "integrator": "rk4",
        "precision": "double",
        "threads": 1,
        "out": None,
        "kernel": "auto",
        "strict": False,
        "backend": "cpu",
    },
    cs.acceleration: {
        "scene": SCENE,
        "x": X,
        "v": V,
        "t": 0.0,
        "precision": "double",
        "out": None,
        "threads": 1,
        "kernel": "auto",
        "strict": False,
    },
    cs.reference_step: {"scene": SCENE, "x": X, "v": V, "dt": 0.01, "steps": 1, "t": 0.0, "as_printed": False},
    cs.Stepper: {
        "scene": SCENE,
        "x": X,
        "v": V,
        "t": 0.0,
        "integrator": "rk4",
        "precision": "double",
        "threads": 1,
        "kernel": "auto",
        "strict": False,
        "backend": "cpu",
        "track_contact_energy": False,
    },
    STEPPER.advance: {"steps": 1, "dt": 0.01},
    STEPPER.freeze: {"member": 0},
    cs.Stepper.restore: {"snapshot": STEPPER.snapshot()},
    partial(cs.simulate, duration=0.02, dt=0.01): {
        "scene": SCENE,
        "integrator": "rk4",
        "precision": "double",
        "rtol": None,
        "atol": None,
        "threads": 1,
        "progress": False,
        "kernel": "auto",
        "strict": False,
        "estimate_error": None,
    },
    partial(cs.simulate, SCENE, 0.02, 0.01): {"t": 0.0, "every": 0.01, "sampling": 1},
    partial(cs.simulate, MOVING, 0.02, dt=0.01): {"times": [0.01]},
    partial(cs.simulate, MOVING, 0.02, dt=0.005): {"fps": 100},
    RUN.resume: {"duration": 0.02, "every": None, "progress": False},
    partial(RUN.resume, 0.02): {"times": [0.03]},
    RUN.penetration: {"sphere": 0},
    RUN.at: {"row": 0, "column": 0},
    RUN.to_trimesh: {"frame": 0},
    cs.difference: {"a": RUN, "b": RUN},
    RUN.save: {"path": "run"},
    cs.load_run: {"path": "/no/such/run"},
    RUN.snapshot.save: {"path": "snapshot"},
    cs.Snapshot.load: {"path": "/no/such/snapshot"},
    STEPPER.set_state: {"x": X, "v": V, "t": 0.0},
    STEPPER.set_scene: {"scene": SCENE},
    cs.energy: {"scene": SCENE, "x": X, "v": V},
    cs.penetration: {"x": X, "sphere": SCENE.spheres[0], "t": 0.0},
    partial(cs.penetration, np.stack([X, X])): {"sphere": MOVING.spheres[0], "t": [0.0, 0.1]},
    cs.largest_stretch: {"scene": SCENE, "x": X},
    cs.max_stable_dt: {"scene": SCENE, "integrator": "rk4", "x": None, "v": None},
    cs.thread_grid: {"shape": (2, 3), "group": (16, 16, 1)},
    cs.triangles: {"shape": (2, 3)},
    cs.load_scene: {"path": "no/such/file.toml"},
    cs.save_scene: {"scene": SCENE, "path": "/no/such/folder/file.toml"},
    cs.reference: {"scene": SCENE, "duration": 0.02, "every": None, "threads": 1, "cache": False},
    REFERENCE.error_of: {"x": REFERENCE.x[-1], "frame": -1},
    cs.convergence: {
        "scene": REFERENCE.scene,
        "duration": 0.1,
        "dts": [0.05],
        "integrator": "rk4",
        "precision": "double",
        "reference": REFERENCE,
    },
    cs.stability_map: {
        "scene": SCENE,
        "stiffness": [1.0],
        "dt": [0.01],
        "integrator": "rk4",
        "precision": "double",
        "steps": 1,
        "threads": 1,
        "progress": False,
    },
    cs.sweep: {
        "scene": SCENE,
        "over": {"stiffness": [1.0]},
        "duration": 0.02,
        "metrics": "stable",
        "dt": 0.01,
        "integrator": "rk4",
        "precision": "double",
        "rtol": None,
        "atol": None,
        "every": None,
        "frames": False,
        "store": None,
        "resume": True,
        "executor": None,
        "threads": 1,
        "progress": False,
        "kernel": "auto",
        "strict": False,
        "sampling": 1,
        "task_seconds": None,
    },
    partial(cs.simulate, SCENE, 0.02, 0.01): {"backend": "cpu"},
    cs.open_sweep: {"path": "/no/such/folder"},
    SCENE.explain: {"precision": "double", "kernel": "auto", "threads": 1, "strict": False},
    cs.Linear((0, 0, 1)).center_at: {"t": 0.0, "center0": (0, 0, 0)},
    SCENE.spheres[0].center_at: {"t": 0.0},
    SCENE.spheres[0].offset_length: {"cloth": SCENE.cloth},
    SCENE.cloth.spring_count: {"family": "shear"},
}

# What an error may name beside the argument: the part of it, or the other one, that is wrong.
ALSO = {
    ("from_dict", "data"): "Scene|schema|cloth|spheres",
    ("sweep", "over"): "stiffness",
    ("Keyframes", "times"): "centers",
    ("convergence", "duration"): "reference",
}
# Good numbers for which a call takes long.
SLOW = {
    ("resume", "duration"),
    ("simulate", "rtol"),
    ("simulate", "atol"),
    ("sweep", "rtol"),
    ("sweep", "atol"),
    ("reference", "duration"),
}


def name_of(function):
    return getattr(function, "func", function).__name__


def is_slow(function, argument, odd):
    if (name_of(function), argument) not in SLOW:
        return False
    with contextlib.suppress(TypeError, ValueError, OverflowError, ArithmeticError):
        return 0.0 < float(odd) < float("inf")
    return False


def cases():
    for function, good in CALLS.items():
        yield pytest.param(function, good, id="-".join([name_of(function), *good][:3]))


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """What is written by a call that goes well."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(("function", "good"), list(cases()))
def test_every_error_names_its_argument(function, good):
    wrong = [line for argument in good for line in errors_without(argument, function, good)]
    assert not wrong, "\n".join(wrong)


def errors_without(argument, function, good):
    """Odd values of the argument for which the error does not name it."""
    names = rf"\b({argument}|{ALSO.get((name_of(function), argument), argument)})\b"
    wrong = []
    for odd in ODD:
        if is_slow(function, argument, odd):
            continue
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                function(**{**good, argument: odd})
        except (ValueError, TypeError) as error:
            if not re.search(names, str(error)) or "incompatible function arg" in str(error):
                wrong.append((odd, error))
        except (cs.UnstableError, cs.ContactError, OSError, MemoryError):
            pass
        except Exception as error:
            wrong.append((odd, error))
    return [f"{name_of(function)}({argument}={shown(odd)}): {type(e).__name__}: {e}" for odd, e in wrong]


def shown(value):
    try:
        return repr(value)[:60]
    except ValueError:
        return type(value).__name__
