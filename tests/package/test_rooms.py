"""Rooms of the package: what imports what, names that occur once, and the public names. import-linter checks the order."""

import ast
from graphlib import TopologicalSorter
from importlib import import_module
from pathlib import Path

import clothsim as cs

PACKAGE = Path(cs.__file__).parent
TESTS = Path(__file__).parents[1]
MODULES = [path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py")]


def name_of(path):
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


NAMES = {name_of(path): path for path in MODULES}


def imports():
    """(module, imported module or "", name, is inside a function) of every import of the package by itself when it runs."""
    for module, path in NAMES.items():
        tree = ast.parse((PACKAGE / path).read_text(encoding="utf-8"))
        typing = {
            id(inner)
            for node in ast.walk(tree)
            if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
            for inner in ast.walk(node)
        }
        functions = [node for node in ast.walk(tree) if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))]
        inside = {id(inner) for node in functions for inner in ast.walk(node)}
        package = module.split(".") if path.name == "__init__.py" else module.split(".")[:-1]
        for node in ast.walk(tree):
            if id(node) in typing:
                continue
            if isinstance(node, ast.Import):
                for alias in node.names:
                    if alias.name.split(".")[0] == "clothsim":
                        yield module, alias.name[9:], "", id(node) in inside
            elif isinstance(node, ast.ImportFrom):
                if node.level:
                    base = [part for part in package if part][: len([part for part in package if part]) - node.level + 1]
                    source = ".".join([*base, *([node.module] if node.module else [])])
                elif (node.module or "").split(".")[0] == "clothsim":
                    source = node.module[9:]
                else:
                    continue
                for alias in node.names:
                    whole = f"{source}.{alias.name}".strip(".")
                    yield module, whole if whole in NAMES else source, alias.name, id(node) in inside


IMPORTS = list(imports())


def test_no_circle_of_imports():
    """Imports inside functions count."""
    graph = {}
    for module, other, _, _ in IMPORTS:
        if other and module:
            graph.setdefault(module, set()).add(other)
    order = list(TopologicalSorter(graph).static_order())  # raises CycleError
    assert order.index("model.cloth") < order.index("model.scene") < order.index("run.simulate")


EVIDENCE = ("paper", "hard_cases")


def test_only_evidence_and_command_line_import_the_front_door():
    """Earlier rooms take the core from the root package, nothing else."""
    for module, other, name, _ in IMPORTS:
        if module not in ("", "__main__") and module.split(".")[0] not in (*EVIDENCE, "cli") and other in ("", "scenes"):
            assert name == "_core", (module, other, name)


PUBLIC = ("accuracy", "errors", "gpu", "scenes", "typing")
"""Modules that users import beside `clothsim` itself."""


def public_names(module):
    """Names of a public module; `dir(cs)` are those of the package."""
    found = import_module(f"clothsim.{module}") if module else cs
    return {
        *getattr(found, "__all__", [name for name in vars(found) if not name.startswith("_")]),
        *(() if module else (*PUBLIC, "__version__")),
    }


def private_uses(module, text, listed):
    """What a module of evidence takes that is not public: imports, and attributes of `cs`."""
    found = []
    for _, other, name, _ in listed:
        if other.split(".")[0] in (module.split(".")[0], "base") or (other in PUBLIC and name == other):
            continue
        if other not in ("", *PUBLIC) or (name and name not in public_names(other)):
            found.append((module, f"{other}.{name}".strip(".")))
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "cs" and node.attr not in public_names(""):
            found.append((module, f"cs.{node.attr}"))
    return found


def test_rooms_of_evidence_use_public_names_alone():
    """And the tools of `base`, which know nothing of cloth."""
    checked = 0
    for module, path in NAMES.items():
        if module.split(".")[0] in EVIDENCE:
            listed = [one for one in IMPORTS if one[0] == module]
            checked += len(listed)
            assert private_uses(module, (PACKAGE / path).read_text(encoding="utf-8"), listed) == []
    assert checked > 50
    planted = [
        ("paper.x", "engine.plan", "KERNELS", False),
        ("paper.x", "", "_core", False),
        ("paper.x", "gpu.device", "using", False),
    ]
    planted += [
        ("paper.x", "accuracy", "own_method", False),
        ("paper.x", "accuracy", "Method", False),
        ("paper.x", "", "", False),
    ]
    found = private_uses("paper.x", "cs.Scene(cs._core.Cloth, cs.typing.Precision)", planted)
    wrong = ["engine.plan.KERNELS", "_core", "gpu.device.using", "accuracy.own_method", "cs._core"]
    assert [what for _, what in found] == wrong


def test_benchmarks_use_public_names_alone():
    """And `clothsim.paper`, whose experiments they run at other sizes."""
    scripts = sorted((TESTS.parent / "benchmarks").rglob("*.py"))
    for path in scripts:
        text = path.read_text(encoding="utf-8")
        listed = []
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "clothsim":
                listed += [("", node.module[9:], alias.name, False) for alias in node.names]
        name = path.relative_to(TESTS.parent / "benchmarks").as_posix()
        found = private_uses("paper", text, [one for one in listed if not one[1].startswith("base")])
        assert not any(one[1].startswith("base") for one in listed), name
        assert [what for _, what in found] == [], name
    assert len(scripts) > 10


def test_dir_shows_public_names_only():
    shown = {name for name in dir(cs) if not name.startswith("__")}
    assert shown == {*cs.__all__, "errors", "typing"}
    assert not [name for name in ("TYPE_CHECKING", "growth", "carried", "on_demand") if hasattr(cs, name)]
    assert all(hasattr(cs, name) for name in shown)
