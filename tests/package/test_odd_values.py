"""Odd values for every argument of the public functions: each is taken only where its kind allows it, and each error names
the argument, what came and what is accepted.
"""

import contextlib
import decimal
import fractions
import functools
import inspect
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
STATE = {"scene": SCENE, "x": X, "v": V}
RUN = cs.simulate(SCENE, 0.02, dt=0.01)
FILM = cs.simulate(SCENE, 0.03, dt=0.01, every="step")
STEPPER = cs.Stepper(SCENE)
REFERENCE = cs.reference(cs.scenes.oscillator(), 0.1)


NUMBERS = [0, -1, 2**63, 0.5, -0.5, 1e300, 1e-320, np.int8(-3), np.array(2.5), fractions.Fraction(1, 3)]
EMPTY = [np.array([]), [], (), {}, set(), iter([]), (one for one in ())]
COUNTS, SIZES, TRIPLE, MOTION = [np.array([1, 2])], [(10**9, 10**9), (2.0, 3.0), (2**40, 1)], range(3), cs.Linear((1, 0, 0))
ODD = [
    *NUMBERS,
    *EMPTY,
    *COUNTS,
    *SIZES,
    TRIPLE,
    MOTION,
    None,
    True,
    np.True_,
    10**400,
    np.nan,
    np.inf,
    -np.inf,
    np.float32(np.inf),
    np.longdouble("1e4000"),
    np.array(np.nan),
    np.array("a"),
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
    fractions.Fraction(10**400),
    1 + 2j,
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
    object(),
    object,
    len,
    Ellipsis,
    NotImplemented,
    SCENE,
    SCENE.cloth,
    ("2", "3"),
    ((0, 0), (5, 5)),
    ((0.0, 0.0),),
    [[0, 1, 2]],
]

# Arguments that must be given, or whose default is no good value here, by function. Each argument at a time is replaced by
# something odd; all others have their defaults.
CALLS = {
    cs.Cloth: {"shape": (2, 3), "pins": ()},
    cs.Sphere: {"response": "ray"},
    cs.Linear: {"velocity": (1, 0, 0)},
    cs.Reciprocate: {"direction": (1, 0, 0)},
    cs.Keyframes: {"times": [0, 1], "centers": np.zeros((2, 3))},
    cs.Sinusoid: {"amplitude": (1, 0, 0), "frequency": 1.0},
    cs.Scene: {"cloth": SCENE.cloth, "position": X, "velocity": V},
    cs.Scene.from_dict: {"data": SCENE.to_dict()},
    cs.scenes.hanging: {"shape": (2, 2)},
    cs.scenes.oscillator: {},
    cs.scenes.paper_moving: {},
    cs.step: {**STATE, "dt": 0.01, "t": 0.0},
    cs.acceleration: STATE,
    cs.reference_step: {**STATE, "dt": 0.01, "t": 0.0},
    cs.Stepper: {**STATE, "t": 0.0},
    STEPPER.advance: {"steps": 1, "dt": 0.01},
    STEPPER.freeze: {"member": 0},
    cs.Stepper.restore: {"snapshot": STEPPER.snapshot()},
    cs.simulate: {"scene": SCENE, "duration": 0.02, "dt": 0.01},
    cs.settle: {"scene": SCENE},
    cs.picture: {"scene": SCENE, "width": 32},
    functools.partial(RUN.picture, width=32): {},
    RUN.plot: {},
    RUN.export: {"path": "run.ply"},
    functools.partial(FILM.animate, width=32): {"path": "run.gif"},
    RUN.to_html: {"path": "run.html"},
    SCENE.to_live_html: {"path": "live.html"},
    cs.compare: {"runs": {"a": RUN}},
    cs.Camera: {"direction": (0, 1, 0), "target": (0, 0, 0), "width": 1.0, "height": 1.0},
    partial(cs.simulate, MOVING, 0.02): {"dt": 0.01},
    RUN.resume: {"duration": 0.02},
    RUN.penetration: {"sphere": 0},
    RUN.at: {"row": 0, "column": 0},
    cs.difference: {"a": RUN, "b": RUN},
    RUN.save: {"path": "run"},
    cs.load_run: {"path": "/no/such/run"},
    RUN.snapshot.save: {"path": "snapshot"},
    cs.Snapshot.load: {"path": "/no/such/snapshot"},
    STEPPER.set_state: {"x": X, "v": V, "t": 0.0},
    STEPPER.set_scene: {"scene": SCENE},
    cs.energy: STATE,
    cs.penetration: {"x": X, "sphere": SCENE.spheres[0]},
    partial(cs.penetration, np.stack([X, X])): {"sphere": MOVING.spheres[0], "t": [0.0, 0.1]},
    cs.largest_stretch: {"scene": SCENE, "x": X},
    cs.max_stable_dt: {"scene": SCENE},
    cs.thread_grid: {"shape": (2, 3)},
    cs.triangles: {"shape": (2, 3)},
    cs.load_scene: {"path": "no/such/file.toml"},
    cs.save_scene: {"scene": SCENE, "path": "/no/such/folder/file.toml"},
    cs.reference: {"scene": SCENE, "duration": 0.02},
    REFERENCE.error_of: {"x": REFERENCE.x[-1]},
    cs.convergence: {"scene": REFERENCE.scene, "duration": 0.1, "dts": [0.05], "reference": REFERENCE},
    cs.stability_map: {"scene": SCENE, "stiffness": [1.0], "dt": [0.01], "steps": 1},
    cs.sweep: {"scene": SCENE, "over": {"stiffness": [1.0]}, "duration": 0.02, "metrics": "stable", "dt": 0.01},
    cs.open_sweep: {"path": "/no/such/folder"},
    SCENE.explain: {},
    cs.Linear((0, 0, 1)).center_at: {"t": 0.0, "center0": (0, 0, 0)},
    SCENE.spheres[0].center_at: {"t": 0.0},
    SCENE.spheres[0].offset_length: {"cloth": SCENE.cloth},
    SCENE.cloth.spring_count: {},
}
# Good values of arguments that many functions have.
COMMON = {"threads": 1, "progress": False}

# The odd values that an argument may take: numbers by a rule, truth values (bool), or a list. All others must be refused.
TAKEN = {
    **dict.fromkeys(("radius", "push_out_speed", "distance", "period", "mass", "length", "width"), lambda n: n > 0),
    **dict.fromkeys(("dt", "duration", "every", "fps", "speed", "frequency", "task_seconds"), lambda n: n > 0),
    **dict.fromkeys(("stiffness", "damping", "drag", "friction", "deceleration", "offset"), lambda n: n >= 0),
    **dict.fromkeys(("rtol", "atol"), lambda n: n >= 0),
    **dict.fromkeys(("member", "row", "column", "frame"), lambda n: isinstance(n, (int, np.integer)) and abs(n) < 9),
    "restitution": lambda n: 0 <= n <= 1,
    "phase": lambda n: 0 <= n < 1,
    "amplitude": lambda n: abs(n) < 1,
    "steps": lambda n: isinstance(n, int) and n == 0,
    "t": lambda n: True,
    **dict.fromkeys(("as_printed", "bend", "progress", "frames", "smooth"), bool),
    **dict.fromkeys(("threads", "max_evaluations", "executor", "snapshot", "group"), []),
    **dict.fromkeys(("precision", "kernel", "integrator", "backend", "response", "family"), []),
    **dict.fromkeys(("position", "force", "offsets"), []),
    **dict.fromkeys(("center", "direction", "velocity", "gravity", "center0", "target"), [TRIPLE]),
    **dict.fromkeys(("springs", "pins"), EMPTY),
    "shape": COUNTS,
    **dict.fromkeys(("size", "times"), [*COUNTS, *SIZES]),
    "cloth": [SCENE.cloth],
    "motion": [MOTION],
    **dict.fromkeys(("label", "shadow", "perspective", "z_up", "log", "difference"), bool),
}
WITH_ARRAYS = {
    ("center_at", "t"),
    ("Sinusoid", "amplitude"),
    ("penetration", "t"),
    ("stability_map", "stiffness"),
    ("stability_map", "dt"),
}

# What an error may name beside the argument: the part of it, or the other one, that is wrong.
ALSO = {
    ("from_dict", "data"): "Scene|schema|cloth|spheres",
    ("sweep", "over"): "stiffness",
    ("Keyframes", "times"): "centers",
    ("convergence", "duration"): "reference",
}
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


def is_passed_over(function, argument, odd):
    """A good number for which a call takes long, or a callable, whose errors are its own."""
    if argument in ("callback", "force") and callable(odd):
        return True
    if (name_of(function), argument) not in SLOW:
        return False
    with contextlib.suppress(TypeError, ValueError, OverflowError, ArithmeticError):
        return 0.0 < float(odd) < float("inf")
    return False


def arguments(function, given):
    """Good values of all arguments that a user gives by name."""
    parameters = inspect.signature(function).parameters.values()
    defaults = {one.name: one.default for one in parameters if one.kind is not one.VAR_KEYWORD}
    good = {**defaults, **{name: value for name, value in COMMON.items() if name in defaults}, **given}
    assert not any(value is inspect.Parameter.empty for value in good.values()) and good.keys() == defaults.keys()
    return good


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """What is written by a call that goes well."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(("function", "given"), CALLS.items(), ids=lambda one: name_of(one) if callable(one) else "")
def test_every_error_names_its_argument(function, given):
    good = arguments(function, given)
    wrong = [line for argument in good for line in errors_without(argument, function, good)]
    assert not wrong, "\n".join(wrong)


def is_allowed(odd, rule):
    if rule is bool:
        return isinstance(odd, (bool, np.bool_))
    if callable(rule):
        return any(odd is number for number in NUMBERS) and rule(odd)
    return any(odd is value for value in rule)


def errors_without(argument, function, good):
    """Odd values of the argument that are taken, or for which the error does not name it."""
    checked = argument in TAKEN and (name_of(function), argument) not in WITH_ARRAYS
    names = rf"\b({argument}|{ALSO.get((name_of(function), argument), argument)})\b"
    wrong = []
    for odd in ODD:
        if is_passed_over(function, argument, odd):
            continue
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                function(**{**good, argument: odd})
        except (ValueError, TypeError) as error:
            says = re.search(r"must .*got|(accepted|needed):|must be (given|False)", str(error), re.DOTALL)
            if not (re.search(names, str(error)) and says) or "incompatible function arg" in str(error):
                wrong.append((odd, error))
            continue
        except (cs.UnstableError, cs.ContactError, OSError, MemoryError):
            pass
        except Exception as error:
            wrong.append((odd, error))
        if checked and odd is not None and not is_allowed(odd, TAKEN[argument]):
            wrong.append((odd, "is taken"))
    return [f"{name_of(function)}({argument}={shown(odd)}): {type(e).__name__}: {e}" for odd, e in wrong]


def shown(value):
    try:
        return repr(value)[:60]
    except ValueError:
        return type(value).__name__
