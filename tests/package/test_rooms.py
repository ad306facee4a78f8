"""Rooms of the package: what imports what, and the public names. import-linter checks the order."""

import ast
from graphlib import TopologicalSorter
from importlib import import_module
from importlib.util import resolve_name
from pathlib import Path

import clothsim as cs
from clothsim.base import services

PACKAGE = Path(cs.__file__).parent
BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
PUBLIC = ("accuracy", "errors", "gpu", "scenes", "typing")
"""Modules that users import beside `clothsim` itself."""
EVIDENCE = ("paper", "hard_cases")


def modules():
    """Return the text of each module of the package and its folder, by name without "clothsim."."""
    for path in PACKAGE.rglob("*.py"):
        folder = path.relative_to(PACKAGE).parent.parts
        name = ".".join(folder if path.stem == "__init__" else (*folder, path.stem))
        yield name, (path.read_text(encoding="utf-8"), ".".join(("clothsim", *folder)))


MODULES = dict(modules())


def imports(text, folder, late=True):
    """Return (module, name or "") of every import of clothsim when the text runs, with `late` those
    in functions too; the module without "clothsim.".
    """
    tree = ast.parse(text)
    blocks = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
    ]
    blocks += [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and not late]
    skipped = {inner for block in blocks for inner in ast.walk(block)}
    for node in ast.walk(tree):
        if node in skipped or not isinstance(node, (ast.Import, ast.ImportFrom)):
            continue
        for alias in node.names:
            source, name = alias.name, ""
            if isinstance(node, ast.ImportFrom):
                source, name = (
                    resolve_name("." * node.level + (node.module or ""), folder),
                    alias.name,
                )
            room, _, module = source.partition(".")
            if room == "clothsim":
                whole = f"{module}.{name}".strip(".")
                yield whole if whole in MODULES else module, name


def import_graph(late):
    """Return the modules that each module imports."""
    return {
        name: {other for other, _ in imports(*code, late) if other}
        for name, code in MODULES.items()
        if name
    }


def test_no_circle_of_imports():
    order = list(TopologicalSorter(import_graph(late=False)).static_order())  # raises CycleError
    assert order.index("model.cloth") < order.index("model.scene") < order.index("run.simulate")


def reachable(graph, start):
    """Return the modules that `start` imports in the end, late imports included."""
    reached = set()
    waiting = [start]
    while waiting:
        new = graph[waiting.pop()] - reached
        reached |= new
        waiting += new
    return reached


def test_late_imports_put_few_modules_into_a_circle():
    graph = import_graph(late=True)
    circle = [name for name in graph if name in reachable(graph, name)]
    assert len(circle) <= 4, circle


def test_functions_of_later_rooms_exist():
    assert {"explain", "picture_of_run"} <= services._MODULES.keys()
    for name in services._MODULES:
        assert callable(services.service(name)), name


def test_only_evidence_and_command_line_import_the_front_door():
    """Earlier rooms take the core from the root package, nothing else."""
    for module, code in MODULES.items():
        if module.split(".")[0] not in ("", "__main__", *EVIDENCE, "cli"):
            taken = {name for other, name in imports(*code) if other in ("", "scenes")}
            assert taken <= {"_core"}, module


def public_names(module):
    """Names of a public module; `dir(cs)` are those of the package."""
    found = import_module(f"clothsim.{module}") if module else cs
    return {
        *getattr(found, "__all__", [name for name in vars(found) if not name.startswith("_")]),
        *(() if module else (*PUBLIC, "__version__")),
    }


def private_uses(text, folder, allowed=()):
    """Return imports and attributes of `cs` that are neither public nor of allowed rooms."""
    found = []
    for other, name in imports(text, folder):
        if other.split(".")[0] in allowed or (other in PUBLIC and name == other):
            continue
        if other not in ("", *PUBLIC) or (name and name not in public_names(other)):
            found.append(f"{other}.{name}".strip("."))
    for node in ast.walk(ast.parse(text)):
        if (
            isinstance(node, ast.Attribute)
            and ast.unparse(node.value) == "cs"
            and node.attr not in public_names("")
        ):
            found.append(f"cs.{node.attr}")
    return found


def test_rooms_of_evidence_use_public_names_alone():
    """And the tools of `base`, which know nothing of cloth."""
    rooms = {module: code for module, code in MODULES.items() if module.split(".")[0] in EVIDENCE}
    for module, code in rooms.items():
        assert private_uses(*code, (module.split(".")[0], "base")) == [], module
    assert {"hard_cases", "paper"} < rooms.keys()
    public = (
        "import clothsim\nfrom clothsim import accuracy\nfrom clothsim.accuracy import "
        "Method\ncs.typing.Precision\n"
    )
    private = (
        "from .. import _core\nfrom ..gpu.device import using\nfrom ..accuracy import "
        "own_method\ncs._core.Cloth\n"
    )
    found = private_uses(public + private, "clothsim.paper")
    assert found == ["_core", "gpu.device.using", "accuracy.own_method", "cs._core"]


def test_benchmarks_use_public_names_alone():
    """And `clothsim.paper`, whose experiments they run at other sizes."""
    scripts = {path: path.read_text(encoding="utf-8") for path in BENCHMARKS.rglob("*.py")}
    scripts = {
        path: private_uses(text, "benchmarks.any", ("paper",)) for path, text in scripts.items()
    }
    assert len(scripts) > 10 and not any(scripts.values()), scripts


def test_dir_shows_public_names_only():
    shown = {name for name in dir(cs) if not name.startswith("__")}
    assert shown == {*cs.__all__, "errors", "typing"}
    assert not [
        name for name in ("TYPE_CHECKING", "growth", "carried", "on_demand") if hasattr(cs, name)
    ]
    assert all(hasattr(cs, name) for name in shown)
