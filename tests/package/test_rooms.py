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
    """Yield each module's name without "clothsim.", its text and its folder."""
    for path in PACKAGE.rglob("*.py"):
        folder = path.relative_to(PACKAGE).parent.parts
        name = ".".join(folder if path.stem == "__init__" else (*folder, path.stem))
        yield name, (path.read_text(encoding="utf-8"), ".".join(("clothsim", *folder)))


MODULES = dict(modules())


def imports(text, folder, late=True):
    """Yield (module, name or "") of every import of clothsim when the text runs, `late` ones in
    functions too; the module without "clothsim.".
    """
    tree = ast.parse(text)
    blocks = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
    ]
    blocks += [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and not late]
    skipped_nodes = {inner for block in blocks for inner in ast.walk(block)}
    for node in ast.walk(tree):
        if node in skipped_nodes or not isinstance(node, (ast.Import, ast.ImportFrom)):
            continue
        for alias in node.names:
            source = alias.name
            name = ""
            if isinstance(node, ast.ImportFrom):
                source = resolve_name("." * node.level + (node.module or ""), folder)
                name = alias.name
            room, _, module = source.partition(".")
            if room == "clothsim":
                full_name = f"{module}.{name}".strip(".")
                yield full_name if full_name in MODULES else module, name


def import_graph(late):
    """Return the modules that each module imports."""
    return {
        name: {origin for origin, _ in imports(*code, late) if origin}
        for name, code in MODULES.items()
        if name
    }


def test_no_circle_of_imports():
    order = list(
        TopologicalSorter(import_graph(late=False)).static_order()
    )  # this raises CycleError
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
        assert callable(services.find_service(name)), name


def test_only_evidence_and_command_line_import_the_front_door():
    """Earlier rooms take the core from the root package, nothing else."""
    for module, code in MODULES.items():
        if module.split(".")[0] not in ("", "__main__", *EVIDENCE, "cli"):
            names = {name for origin, name in imports(*code) if origin in ("", "scenes")}
            assert names <= {"_core"}, module


def public_names(module):
    """Return names of a public module; `dir(cs)` are those of the package."""
    namespace = import_module(f"clothsim.{module}") if module else cs
    return {
        *getattr(
            namespace, "__all__", [name for name in vars(namespace) if not name.startswith("_")]
        ),
        *(() if module else (*PUBLIC, "__version__")),
    }


def private_uses(text, folder, allowed=()):
    """Return what a text takes that is neither public nor of an allowed room."""
    uses = []
    for origin, name in imports(text, folder):
        if origin.split(".")[0] in allowed or (origin in PUBLIC and name == origin):
            continue
        if origin not in ("", *PUBLIC) or (name and name not in public_names(origin)):
            uses.append(f"{origin}.{name}".strip("."))
    for node in ast.walk(ast.parse(text)):
        if (
            isinstance(node, ast.Attribute)
            and ast.unparse(node.value) == "cs"
            and node.attr not in public_names("")
        ):
            uses.append(f"cs.{node.attr}")
    return uses


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
        "method_of_integrator\ncs._core.Cloth\n"
    )
    uses = private_uses(public + private, "clothsim.paper")
    assert uses == ["_core", "gpu.device.using", "accuracy.method_of_integrator", "cs._core"]


def test_benchmarks_use_public_names_alone():
    """And `clothsim.paper`, whose experiments they run at other sizes."""
    scripts = {path: path.read_text(encoding="utf-8") for path in BENCHMARKS.rglob("*.py")}
    scripts = {
        path: private_uses(text, "benchmarks.any", ("paper",)) for path, text in scripts.items()
    }
    assert len(scripts) > 10 and not any(scripts.values()), scripts


def test_dir_shows_public_names_only():
    listed_names = {name for name in dir(cs) if not name.startswith("__")}
    assert listed_names == {*cs.__all__, "errors", "typing"}
    assert not [
        name
        for name in ("TYPE_CHECKING", "growth", "carried", "make_late_importers")
        if hasattr(cs, name)
    ]
    assert all(hasattr(cs, name) for name in listed_names)
