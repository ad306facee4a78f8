"""Annotations say what the code does: stub and core, names of choices, the report."""

import ast
from pathlib import Path
from typing import get_args, get_type_hints, is_typeddict

import clothsim as cs
import clothsim.typing
import pytest
from clothsim import _core

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
