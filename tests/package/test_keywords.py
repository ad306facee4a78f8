"""Unknown keyword arguments: each public function and class suggests a known one."""

import inspect
import re

import clothsim as cs
import pytest
from tables import each

SCENES = [
    name
    for name, function in inspect.getmembers(cs.scenes, inspect.isfunction)
    if name[0] != "_" and function.__module__ == cs.scenes.__name__
]
# The package makes these itself; `convergence` passes what it does not know to `simulate`.
MADE_BY_OTHERS = {"Convergence", "Reference", "Run", "Snapshot", "convergence"}


def is_asked(name):
    value = getattr(cs, name)
    error = inspect.isclass(value) and issubclass(value, BaseException)
    return callable(value) and not error and name not in MADE_BY_OTHERS


PUBLIC = [name for name in cs.__all__ if is_asked(name)]


def message_of(function, *args, **keywords):
    with pytest.raises(TypeError) as caught:
        function(*args, **keywords)
    return str(caught.value)


@each("name", [*PUBLIC, *(f"scenes.{name}" for name in SCENES)])
def test_every_public_name_documents_its_arguments(name):
    function = cs
    for part in name.split("."):
        function = getattr(function, part)
    own = name.rsplit(".", 1)[-1]
    assert message_of(function, qwertz=1).startswith(f"{own}() got an unknown argument 'qwertz'; it takes")


@each(
    ("function", "unknown", "ours"),
    [
        (cs.simulate, "method", "; clothsim calls it 'integrator'"),
        (cs.step, "method", "; clothsim calls it 'integrator'"),
        (cs.simulate, "max_step", "; clothsim calls it 'dt'"),
        (cs.step, "max_step", "; clothsim calls it 'dt'"),
        (cs.simulate, "t_span", "; clothsim calls it 'duration'"),
        (cs.step, "y0", "; clothsim calls it 'x'"),
        (cs.Stepper, "y0", "; clothsim calls it 'x'"),
        (cs.Scene, "y0", "; clothsim calls it 'position'"),
        (cs.Sphere, "centre", "; clothsim calls it 'center'"),
        (cs.Keyframes, "centres", "; clothsim calls it 'centers'"),
        (cs.Cloth, "stifness", " (did you mean 'stiffness'?)"),
        (cs.Cloth, "Damping", " (did you mean 'damping'?)"),
        (cs.scenes.hanging, "k", "; clothsim calls it 'stiffness'"),
        (cs.sweep, "workers", "; clothsim calls it 'threads'"),
    ],
)
def test_the_nearest_name_is_suggested(function, unknown, ours):
    assert f"got an unknown argument {unknown!r}{ours}; it takes" in message_of(function, **{unknown: 1})


def test_frames_at_given_times_are_found_under_scipys_name():
    assert re.search("; clothsim calls it '(times|every)'", message_of(cs.simulate, t_eval=[0.1]))


def test_replace_suggests_as_the_constructor_does():
    assert "did you mean 'stiffness'?" in message_of(cs.Cloth().replace, stifness=1)


def test_options_for_simulate_are_checked_by_simulate():
    scene = cs.scenes.oscillator()
    assert "simulate() got an unknown argument 'device'; clothsim calls it 'backend'" in message_of(
        cs.convergence, scene, 0.1, [0.01], device="cpu"
    )


def test_other_errors_pass_as_they_are():
    assert message_of(cs.Cloth, 1, shape=(2, 2)).endswith("got multiple values for argument 'shape'")

    # An unknown keyword inside of a call is not one of the call.
    def broken(outcome):
        return cs.Cloth(stifness=1)

    with pytest.warns(RuntimeWarning, match=r"Cloth\(\) got an unknown argument 'stifness'"):
        cs.sweep(cs.scenes.oscillator(), {"stiffness": [1.0]}, duration=0.01, dt=0.01, metrics=broken, progress=False)


def test_signature_and_documentation_stay():
    assert list(inspect.signature(cs.Sphere).parameters)[:2] == ["center", "radius"]
    assert list(inspect.signature(cs.triangles).parameters) == ["shape"]
    assert cs.triangles.__doc__.startswith("The triangles of the sheet")
    assert inspect.unwrap(cs.step).__name__ == "step" and cs.step.__module__ == "clothsim.engine.stepping"


def test_methods_that_take_many_arguments_say_theirs():
    stepper = cs.Stepper(cs.scenes.oscillator())
    run = cs.simulate(cs.scenes.oscillator(), 0.01, dt=1e-3)
    assert "clothsim calls it 'x'" in message_of(stepper.set_state, positions=1)
    assert "clothsim calls it 'duration'" in message_of(run.resume, t_end=1)
