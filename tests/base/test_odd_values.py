"""One generator of odd values for every argument of every public callable.

Each argument in turn is replaced by each odd value. The call may refuse it with an error that names
the argument, what came and what is accepted, or take it where its kind allows it. Nothing that was
passed in changes.
"""

import decimal
import fractions
import inspect
import numbers
import re
import warnings
from functools import partial

import clothsim as cs
import numpy as np
import pytest

pytest.importorskip("xarray")

BALL = cs.Sphere((0.5, -9, 0.5), response="ray", offset="edge")
SCENE = cs.Scene(cs.Cloth((2, 3), mass=6.0, stiffness=100.0, damping=0.1), BALL)
MOVING = SCENE.replace(spheres=BALL.replace(motion=cs.Linear((0, 1, 0))))
X, V = SCENE.initial_position.copy(), SCENE.initial_velocity.copy()
STATE = {"scene": SCENE, "x": X, "v": V}
RUN = cs.simulate(SCENE, 0.03, dt=0.01, every=1)
STEPPER, CLOTH = cs.Stepper(SCENE), SCENE.cloth
REFERENCE = cs.reference(cs.scenes.oscillator(), 0.1)

EMPTY = [np.array([]), [], (), {}, set(), iter([])]
COUNTS, TRIPLE, ORIGIN = np.array([1, 2]), range(3), (0, 0, 0)
MOTION, SIZES = cs.Linear((1, 0, 0)), [(10**9, 10**9), (2.0, 3.0)]
NUMBERS = [
    0,
    -1,
    2**63,
    0.5,
    -0.5,
    1e300,
    1e-320,
    np.int8(-3),
    np.array(2.5),
    fractions.Fraction(1, 3),
    np.longdouble(0.25),
]
NOT_FINITE = [
    np.nan,
    np.inf,
    -np.inf,
    np.float32(np.inf),
    np.array(np.nan),
    10**400,
    np.longdouble("1e4000"),
]
TEXTS = ["", "12", "rk5", "a\0b", b"12", np.array("a"), ["a", 1], ("2", "3")]
OBJECTS = [
    None,
    True,
    np.True_,
    object(),
    len,
    Ellipsis,
    1 + 2j,
    decimal.Decimal("1.5"),
    SCENE,
    CLOTH,
    MOTION,
]
NESTED = [
    [[]],
    [[1], [2, 3]],
    [[[0, 1], 2], 3],
    [None],
    [10**400],
    [1.0, np.inf, 2.0],
    ((0, 0), (5, 5)),
    [[0, 1, 2]],
]
ARRAYS = [
    np.full((2, 3, 3), np.nan),
    np.array([None, 1], object),
    np.array(1j),
    np.array(["2020-01-01"], "M8[D]"),
    np.zeros(7),
]
MAPPINGS = [{"structural": None}, {"a": 1}, {1: 2}, {("dt",): [(1,)]}]
ODD = [
    *NUMBERS,
    *NOT_FINITE,
    *EMPTY,
    COUNTS,
    TRIPLE,
    ORIGIN,
    *SIZES,
    *TEXTS,
    *OBJECTS,
    *NESTED,
    *ARRAYS,
    *MAPPINGS,
]

# Arguments that must be given, or whose default is no good value here, of every public callable
# that takes arguments.
CALLS = {
    cs.Cloth: {"shape": (2, 3), "pins": ()},
    CLOTH.spring_count: {},
    cs.Sphere: {"response": "ray"},
    cs.Plane: {"point": (0, 0, 0), "normal": (0, 1, 0)},
    cs.Wind: {"velocity": (1, 0, 0), "density": 1.2, "normal": 1.2, "tangential": 0.1},
    BALL.center_at: {"t": 0.0},
    BALL.velocity_at: {"t": 0.0},
    BALL.offset_length: {"cloth": CLOTH},
    cs.Linear: {"velocity": (1, 0, 0)},
    MOTION.center_at: {"t": 0.0, "center0": (0, 0, 0)},
    cs.Reciprocate: {"direction": (1, 0, 0)},
    cs.Keyframes: {"times": [0, 1], "centers": np.zeros((2, 3))},
    cs.Sinusoid: {"amplitude": (1, 0, 0), "frequency": 1.0},
    cs.Scene: {"cloth": CLOTH, "position": X, "velocity": V},
    cs.Scene.from_dict: {"data": SCENE.to_dict()},
    SCENE.explain: {},
    SCENE.to_live_html: {"path": "live.html"},
    cs.view: {"scene": SCENE},
    cs.load_scene: {"path": "no/such/file.toml"},
    cs.save_scene: {"scene": SCENE, "path": "/no/such/folder/file.toml"},
    cs.scenes.hanging: {"shape": (2, 2)},
    cs.scenes.oscillator: {},
    cs.scenes.paper_moving: {},
    cs.step: {**STATE, "dt": 0.01, "t": 0.0},
    cs.acceleration: STATE,
    cs.reference_step: {**STATE, "dt": 0.01, "t": 0.0},
    cs.Stepper: {**STATE, "t": 0.0},
    STEPPER.advance: {"steps": 1, "dt": 0.01},
    STEPPER.freeze: {"member": 0},
    STEPPER.set_state: {"x": X, "v": V, "t": 0.0},
    STEPPER.set_scene: {"scene": SCENE},
    STEPPER.set_force: {"force": X},
    cs.Stepper.restore: {"snapshot": STEPPER.snapshot()},
    STEPPER.snapshot().save: {"path": "snapshot"},
    cs.Snapshot.load: {"path": "/no/such/snapshot"},
    cs.simulate: {"scene": SCENE, "duration": 0.02, "dt": 0.01},
    partial(cs.simulate, MOVING, 0.02): {"dt": 0.01},
    cs.settle: {"scene": SCENE},
    RUN.resume: {"duration": 0.02},
    RUN.penetration: {"sphere": 0},
    RUN.at: {"row": 0, "column": 0},
    RUN.save: {"path": "run"},
    cs.load_run: {"path": "/no/such/run"},
    cs.difference: {"a": RUN, "b": RUN},
    cs.energy: STATE,
    cs.penetration: {"x": X, "sphere": BALL},
    partial(cs.penetration, np.stack([X, X])): {"sphere": MOVING.spheres[0], "t": [0.0, 0.1]},
    cs.largest_stretch: {"scene": SCENE, "x": X},
    cs.max_stable_dt: {"scene": SCENE},
    cs.thread_grid: {"shape": (2, 3)},
    cs.triangles: {"shape": (2, 3)},
    cs.reference: {"scene": SCENE, "duration": 0.02},
    REFERENCE.error_of: {"x": REFERENCE.x[-1]},
    cs.convergence: {
        "scene": REFERENCE.scene,
        "duration": 0.1,
        "dts": [0.05],
        "reference": REFERENCE,
    },
    cs.work_precision: {
        "scene": REFERENCE.scene,
        "duration": 0.1,
        "methods": ["rk4"],
        "dts": [0.05],
        "windows": 1,
    },
    cs.fit: {"scene": SCENE, "times": RUN.t, "positions": RUN.x, "over": ["stiffness"]},
    cs.sensitivity: {"scene": SCENE, "times": RUN.t, "of": ["stiffness"]},
    cs.stability_map: {"scene": SCENE, "stiffness": [1.0], "dt": [0.01], "steps": 1},
    cs.sweep: {
        "scene": SCENE,
        "over": {"stiffness": [1.0]},
        "duration": 0.02,
        "metrics": "stable",
        "dt": 0.01,
    },
    cs.open_sweep: {"path": "/no/such/folder"},
    cs.picture: {"scene": SCENE, "width": 32},
    cs.Camera: {"direction": (0, 1, 0), "target": (0, 0, 0), "width": 1.0, "height": 1.0},
    partial(RUN.picture, width=32): {},
    RUN.plot: {},
    RUN.export: {"path": "run.ply"},
    partial(RUN.animate, width=32): {"path": "run.gif"},
    RUN.to_html: {"path": "run.html"},
    cs.compare: {"runs": {"a": RUN}},
}
COMMON = {"threads": 1, "progress": False, "reference": REFERENCE}
NO_ARGUMENTS = {cs.build_config, cs.integrators, cs.sweepable}
RESULTS = {
    cs.Convergence,
    cs.Fit,
    cs.Picture,
    cs.Reference,
    cs.Run,
    cs.Snapshot,
}  # users do not call these constructors


def number(rule):
    """Numbers alone, and of these the finite ones that obey the rule."""

    def allowed(odd):
        real = odd[()] if isinstance(odd, np.ndarray) and odd.ndim == 0 else odd
        return (
            isinstance(real, numbers.Real)
            and type(real) is not bool
            and abs(real) < 1e308
            and rule(real)
        )

    return allowed


def among(*values):
    return lambda odd: any(odd is value for value in values)


def truth(odd):
    return isinstance(odd, (bool, np.bool_))


# What an argument of these names takes; of other names, only the errors are judged.
RULES = [
    (
        number(lambda n: n > 0),
        "radius distance period mass length width dt duration every fps speed",
    ),
    (number(lambda n: n > 0), "frequency longest tolerance sigma"),
    (number(lambda n: n >= 0), "stiffness damping drag friction deceleration offset rtol atol"),
    (number(lambda n: n == int(n) and abs(n) < 9), "member row column frame"),
    (number(lambda n: 0 <= n <= 1), "restitution"),
    (number(lambda n: 0 <= n < 1), "phase"),
    (number(lambda n: abs(n) < 1), "amplitude"),
    (number(lambda n: isinstance(n, int) and n == 0), "steps"),
    (number(lambda n: True), "t"),
    (truth, "as_printed bend progress frames smooth label shadow perspective z_up log difference"),
    (
        among(),
        "threads max_evaluations executor snapshot group precision kernel integrator backend "
        "response family",
    ),
    (among(), "position force"),
    (among(TRIPLE), "direction normal"),
    (among(TRIPLE, ORIGIN), "center velocity gravity center0 target point"),
    (among(*EMPTY), "springs pins"),
    (among(COUNTS), "shape"),
    (among(COUNTS, *SIZES), "size times"),
    (among(CLOTH), "cloth"),
    (among(MOTION), "motion"),
]
TAKEN = {name: rule for rule, names in RULES for name in names.split()}
OF_CASE = {("Wind", "normal"): number(lambda n: n >= 0)}
TAKE_ARRAYS = {
    ("center_at", "t"),
    ("velocity_at", "t"),
    ("Sinusoid", "amplitude"),
    ("Sinusoid", "phase"),
}
TAKE_ARRAYS |= {("penetration", "t"), ("sensitivity", "times"), ("set_force", "force")}
TAKE_ARRAYS |= {("stability_map", "stiffness"), ("stability_map", "dt")}
# What an error may name beside the argument: a part of it, or the other argument that does not fit.
ALSO = {
    ("from_dict", "data"): "Scene|schema|cloth|spheres",
    ("sweep", "over"): "stiffness",
    ("Keyframes", "times"): "centers",
    ("convergence", "duration"): "reference",
    ("work_precision", "duration"): "reference",
    ("fit", "times"): "positions",
    ("fit", "over"): "stiffness",
    ("sensitivity", "of"): "over",
}
# A good number makes these calls long.
LONG = {("resume", "duration"), ("reference", "duration"), ("work_precision", "windows")}
LONG |= {(name, of) for name in ("simulate", "sweep", "fit") for of in ("rtol", "atol")}


def name_of(function):
    return getattr(function, "func", function).__name__


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """Return what a call that goes well writes; no browser opens."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("webbrowser.open", lambda *_: True)


def test_every_public_callable_is_judged():
    public = {value for name in cs.__all__ if callable(value := getattr(cs, name))}
    errors = {
        value for value in public if inspect.isclass(value) and issubclass(value, BaseException)
    }
    assert public - errors - NO_ARGUMENTS - RESULTS == {one for one in CALLS if one in public}


@pytest.mark.parametrize(
    ("function", "given"), CALLS.items(), ids=lambda one: name_of(one) if callable(one) else ""
)
def test_every_error_names_its_argument(function, given):
    parameters = inspect.signature(function).parameters.values()
    defaults = {one.name: one.default for one in parameters if one.kind is not one.VAR_KEYWORD}
    good = {
        **defaults,
        **{name: value for name, value in COMMON.items() if name in defaults},
        **given,
    }
    assert (
        inspect.Parameter.empty not in good.values()
        if not any(isinstance(v, np.ndarray) for v in good.values())
        else True
    )
    arrays = {name: value.copy() for name, value in good.items() if isinstance(value, np.ndarray)}
    wrong = [
        f"{argument}={repr(odd)[:60]}: {found}"
        for argument in good
        for odd, found in faults(function, argument, good)
    ]
    assert not wrong, "\n".join(wrong)
    assert all(np.array_equal(good[name], kept) for name, kept in arrays.items())


def faults(function, argument, good):
    """Odd values of the argument that are taken, changed, or refused without its name."""
    case = name_of(function), argument
    takes = None if case in TAKE_ARRAYS else OF_CASE.get(case, TAKEN.get(argument))
    for odd in ODD:
        if (argument in ("callback", "force") and callable(odd)) or (
            case in LONG and number(lambda n: n > 0)(odd)
        ):
            continue
        before = repr(odd)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                function(**{**good, argument: odd})
        except (ValueError, TypeError) as error:
            named = re.search(rf"\b({argument}|{ALSO.get(case, argument)})\b", str(error))
            if not (
                named
                and re.search(
                    r"must .*got|(accepted|needed):|must be (given|False)", str(error), re.DOTALL
                )
            ):
                yield odd, f"{type(error).__name__}: {error}"
        except (cs.UnstableError, cs.ContactError, OSError, MemoryError):
            pass
        except Exception as error:
            yield odd, f"{type(error).__name__}: {error}"
        else:
            if takes and odd is not None and not takes(odd):
                yield odd, "is taken"
        if repr(odd) != before and argument != "out":
            yield odd, "is changed"


def one_far(place, other=0.0):
    x = X.copy()
    x[1, 1] = place
    x[0, 0] = other
    return x


# Finite states without extent, or with one that squares, or float32, cannot hold.
DEGENERATE = {
    "one place": np.zeros_like(X),
    "one place far away": np.full_like(X, 1e9 / 3),
    "a line": X * (1, 0, 0),
    "two places": np.where(np.arange(3)[:, None] < 1, 0.0, 1.0) * np.ones_like(X),
    "subnormal": X * 1e-320,
    "tiny": X * 1e-44,
    "float32 overflows": one_far(1e40),
    "squares overflow": one_far(1e160),
    "differences overflow": one_far(1.7e308, -1.7e308),
}
OF_STATES = {
    **{function: given for function, given in CALLS.items() if "x" in given},
    cs.max_stable_dt: {**STATE, "scene": SCENE},
    **{
        partial(cs.picture, color=color): {"scene": SCENE, "x": X, "v": V, "width": 32}
        for color in ("stretch", "speed", "depth")
    },
    partial(cs.picture, camera=cs.Camera((1, 1, 1), (0, 0, 0), 1.0, 1.0, 2.0)): {
        "scene": SCENE,
        "x": X,
        "width": 32,
    },
}


@pytest.mark.parametrize("state", DEGENERATE)
@pytest.mark.parametrize(
    ("function", "given"), OF_STATES.items(), ids=lambda one: name_of(one) if callable(one) else ""
)
def test_a_degenerate_finite_state_has_an_answer_or_a_named_error(function, given, state):
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            function(**{**given, "x": DEGENERATE[state]})
    except ValueError as error:
        assert re.match(r"x must .*got", str(error), re.DOTALL)
    except (cs.UnstableError, cs.ContactError):
        pass


@pytest.mark.parametrize("state", DEGENERATE)
def test_a_scene_and_a_run_of_a_degenerate_state_show_themselves_or_say_why(state, tmp_path):
    scene = SCENE.replace(position=DEGENERATE[state])
    run = cs.Run(scene, np.arange(3.0), np.stack(3 * [DEGENERATE[state]]), np.stack(3 * [V]), {})
    shows = [
        scene._repr_mimebundle_,
        run._repr_mimebundle_,
        run.plot,
        lambda: run.to_html(tmp_path / "run.html"),
        lambda: run.animate(tmp_path / "run.gif", width=32),
        *(partial(run.export, tmp_path / f"run.{end}") for end in ("glb", "obj", "pvd", "pc2")),
    ]
    for show in shows:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                show()
        except ValueError as error:
            assert re.match(r"x must .*got", str(error), re.DOTALL)
