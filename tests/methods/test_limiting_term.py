"""Which term limits the step, in messages and in `explain`; orders with damping."""

import warnings

import clothsim as cs
import pytest
from clothsim.methods.bound import limiting_term


def given(category, run):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run()
    return [str(warning.message) for warning in caught if warning.category is category]


@pytest.mark.parametrize("method", ["rk4", "velocity_verlet", "dop853"])
@pytest.mark.parametrize(
    "features, kind, families",
    [
        ({"mass": 0.2}, "damping", None),
        ({"damping": 0.0}, "stiffness", None),
        ({"damping": {"structural": 1.0, "shear": 900.0, "bend": 0.0}}, "damping", ("shear",)),
        (
            {"stiffness": {"structural": 1.0, "shear": 9.0, "bend": 1e5}, "damping": 1.0},
            "stiffness",
            ("bend",),
        ),
        ({"damping": 0.0, "drag": 9000.0}, "damping", ("points",)),
        ({"damping": 1.0, "drag": 9000.0}, "damping", ("points",)),
    ],
)
def test_the_term_that_limits_is_the_one_that_moves_the_limit(method, features, kind, families):
    scene = cs.Scene(cs.Cloth((6, 7), **{"mass": 21.0, **features}))
    term = limiting_term(scene, method)
    assert term.kind == kind and term.max_stable_dt == cs.max_stable_dt(scene, method)
    assert families is None or term.families == families
    # Half of that kind lengthens the step by more than half of the other does.
    cloth = scene.cloth

    def halved(name):
        value = getattr(cloth, name)
        value = {f: v / 2 for f, v in value.items()} if hasattr(value, "items") else value / 2
        drag = cloth.drag / 2 if name == "damping" else cloth.drag
        return cs.max_stable_dt(cs.Scene(cloth.replace(**{name: value}, drag=drag)), method)

    counterpart = {"damping": "stiffness", "stiffness": "damping"}[kind]
    assert halved(kind) > 1.2 * term.max_stable_dt and halved(kind) > halved(counterpart)


def test_below_the_value_the_other_kind_limits():
    scene = cs.Scene(cs.Cloth(mass=0.2))
    (value, *_) = limiting_term(scene, "rk4").below
    for factor, kind in ((1.01, "damping"), (0.99, "stiffness")):
        cloth = scene.cloth.replace(damping=factor * value)
        assert limiting_term(cs.Scene(cloth), "rk4").kind == kind


def test_warning_error_and_explain_name_it():
    scene = cs.Scene(cs.Cloth((5, 5), mass=0.01))
    term = str(limiting_term(scene, "rk4"))
    assert scene.explain()["limited_by"] == term and "damping" in term and "below" in term
    stepper = cs.Stepper(scene)
    with pytest.raises(cs.UnstableError) as error, pytest.warns(cs.StabilityWarning) as warned:
        stepper.advance(10_000, 1e-3)
    assert term in str(error.value) and error.value.term == term
    assert term in str(warned[0].message)


def test_pefrl_with_damping_is_announced():
    damped, free = cs.scenes.oscillator(damping=0.1), cs.scenes.oscillator()
    state = damped.initial_position, damped.initial_velocity

    def calls(scene):
        return (
            lambda: cs.step(scene, *state, 1e-3, integrator="pefrl"),
            lambda: cs.Stepper(scene, integrator="pefrl").advance(3, 1e-3),
            lambda: cs.simulate(scene, 0.01, 1e-3, integrator="pefrl"),
            lambda: cs.sweep(
                scene, {"integrator": ["rk4", "pefrl"]}, duration=0.01, dt=1e-3, progress=False
            ),
        )

    for call in calls(damped):
        (message,) = given(cs.OrderWarning, call)
        assert "order 1" in message and "order 4" in message and "rk4" in message
    for call in calls(free):
        assert not given(cs.OrderWarning, call)
