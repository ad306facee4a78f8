"""Every public name has an example, which runs as a doctest, and documents every argument."""

import inspect
import re

import clothsim as cs
import pytest
from clothsim import accuracy, gpu
from tables import each

pytest.importorskip("xarray")


def members():
    """Public functions, classes and their methods, by the name that a user writes."""
    for name in cs.__all__:
        value = getattr(cs, name)
        if name == "scenes":
            for function, method in inspect.getmembers(value, inspect.isfunction):
                if not function.startswith("_") and method.__module__ == value.__name__:
                    yield f"scenes.{function}", method
        else:
            yield name, value
            if inspect.isclass(value):
                yield from methods(name, value)
    for module in (accuracy, gpu):
        for name in module.__all__:
            value = getattr(module, name)
            if callable(value):
                yield f"{module.__name__.removeprefix('clothsim.')}.{name}", value


def methods(name, cls):
    for attribute, value in inspect.getmembers(
        cls, lambda member: inspect.isfunction(member) or inspect.ismethod(member)
    ):
        if not attribute.startswith("_") and value.__module__.startswith("clothsim"):
            yield f"{name}.{attribute}", value


MEMBERS = dict(members())


def test_help_of_the_package_lists_every_name():
    assert sorted(re.findall(r"^    (\w+) {2,}\S", cs.__doc__, re.M)) == sorted(cs.__all__)


# The example of a result that only a function gives is the function's.
GIVEN = {cs.Convergence: cs.convergence, cs.Fit: cs.fit, cs.Reference: cs.reference}


@each("name", MEMBERS)
def test_it_has_an_example(name):
    assert ">>> " in inspect.getdoc(GIVEN.get(MEMBERS[name], MEMBERS[name]))


def documented(text):
    """Names of the sections Parameters and Attributes."""
    names_of_entries = set()
    for section in re.findall(
        r"^(?:Parameters|Attributes)\n-+\n(.*?)(?=^\w[^\n]*\n---|\Z)", text, re.M | re.S
    ):
        for names in re.findall(r"^(\*{0,2}\w[^:\n]*?)(?: :|$)", section, re.M):
            names_of_entries |= {name.strip(" *`") for name in names.split(",")}
    return names_of_entries


@each("name", MEMBERS)
def test_its_arguments_are_documented(name):
    value = MEMBERS[name]
    if value in (cs.Snapshot, accuracy.Method) or (
        inspect.isclass(value) and issubclass(value, Warning)
    ):
        return  # users do not call these constructors
    parameters = inspect.signature(value).parameters.items()
    names = {name for name, parameter in parameters if parameter.annotation != "NoReturn"}
    arguments = names - {"self", "cls"}
    assert arguments <= documented(inspect.getdoc(value))
