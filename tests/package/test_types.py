"""Annotations say what the code does: stub and core, constructors as declared and as they are, names of choices."""

import ast
import inspect
from pathlib import Path
from typing import get_args, get_type_hints, is_typeddict

import clothsim as cs
import clothsim.typing
import pytest
from clothsim import _core
from clothsim.model.cloth import FAMILIES

PACKAGE = Path(cs.__file__).parent
STUB = ast.parse((PACKAGE / "_core.pyi").read_text())


def declared(body):
    return {one.name for one in body if isinstance(one, (ast.ClassDef, ast.FunctionDef))} | {
        one.target.id for one in body if isinstance(one, ast.AnnAssign)
    }


def public(names):
    return {name for name in names if not name.startswith("_")}


def test_the_stub_has_the_names_of_the_core():
    assert public(declared(STUB.body)) == public(dir(_core))


@pytest.mark.parametrize("stub", [one for one in STUB.body if isinstance(one, ast.ClassDef)], ids=lambda one: one.name)
def test_the_stub_has_the_members_of_a_class_of_the_core(stub):
    assert public(declared(stub.body)) == public(vars(getattr(_core, stub.name)))


def declared_constructor(cls):
    """The `__init__` of a class as it is written for type checkers."""
    tree = ast.parse(Path(inspect.getsourcefile(cls)).read_text())
    body = next(one.body for one in tree.body if isinstance(one, ast.ClassDef) and one.name == cls.__name__)
    block = next(one for one in body if isinstance(one, ast.If))
    return block.body[0].args


MODEL = (cs.Cloth, cs.Sphere, cs.Scene, cs.Linear, cs.Reciprocate, cs.Keyframes, cs.Sinusoid, cs.Camera)


@pytest.mark.parametrize("cls", MODEL)
def test_a_constructor_is_declared_as_it_is(cls):
    arguments = declared_constructor(cls)
    parameters = list(inspect.signature(cls).parameters.values())
    assert [one.arg for one in arguments.args[1:]] == [one.name for one in parameters]
    assert not arguments.kwonlyargs
    defaults = [one.default for one in parameters if one.default is not one.empty]
    names = {"FAMILIES": FAMILIES}
    written = [names[one.id] if isinstance(one, ast.Name) else ast.literal_eval(one) for one in arguments.defaults]
    assert written == defaults


def test_editors_are_offered_the_names_of_the_integrators():
    names, text = get_args(clothsim.typing.Integrator)
    assert set(get_args(names)) == {*cs.integrators(), "auto"}
    assert text is str


def check_typed(value, declared):
    """The keys and types of a mapping are those of a TypedDict, through all levels."""
    hints = get_type_hints(declared)
    assert value.keys() == hints.keys()
    for name, hint in hints.items():
        if is_typeddict(hint):
            check_typed(value[name], hint)
        elif hint in (bool, int, float, str):
            assert type(value[name]) is hint, name


@pytest.mark.parametrize("options", [{"dt": 1e-3}, {"rtol": 1e-6}, {"dt": 1e-3, "estimate_error": True}])
def test_the_report_has_the_type_it_declares(options):
    run = cs.simulate(cs.scenes.oscillator(), 0.05, **options)
    check_typed(run.report, clothsim.typing.Report)
    check_typed(run.resume(0.05).report, clothsim.typing.Report)
