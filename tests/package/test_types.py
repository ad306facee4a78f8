"""Annotations say what the code does: stub and core, names of choices, the report."""

import ast
from pathlib import Path
from typing import get_args

import clothsim as cs
import clothsim.typing
import pytest
from clothsim import _core

PACKAGE = Path(cs.__file__).parent
STUB = ast.parse((PACKAGE / "_core.pyi").read_text())


def declared(body):
    return {node.name for node in body if isinstance(node, (ast.ClassDef, ast.FunctionDef))} | {
        node.target.id for node in body if isinstance(node, ast.AnnAssign)
    }


def public(names):
    return {name for name in names if not name.startswith("_")}


def test_the_stub_has_the_names_of_the_core():
    assert public(declared(STUB.body)) == public(dir(_core))


@pytest.mark.parametrize(
    "stub",
    [node for node in STUB.body if isinstance(node, ast.ClassDef)],
    ids=lambda node: node.name,
)
def test_the_stub_has_the_members_of_a_class_of_the_core(stub):
    assert public(declared(stub.body)) == public(vars(getattr(_core, stub.name)))


def test_editors_are_offered_the_names_of_the_integrators():
    names, text = get_args(clothsim.typing.Integrator)
    assert set(get_args(names)) == {*cs.integrators(), "auto"}
    assert text is str
