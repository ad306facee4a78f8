"""Build the site: `python docs/site/stage.py [FOLDER]`, by default into build/docs.

Stages a copy of the pages in FOLDER/source, in the repository's layout, so that their links hold. Adds what is
generated: a page for each room of public names, the commands, the gallery's titles, and the paper's scenes as live pages.
A warning fails the build.
"""

from __future__ import annotations

import contextlib
import inspect
import io
import os
import re
import shutil
import sys
from pathlib import Path

import clothsim as cs
from clothsim.cli import COMMANDS
from clothsim.cli import main as command
from clothsim.paper import write_gallery
from sphinx.cmd.build import main as sphinx

ROOT = Path(__file__).resolve().parents[2]
COPIED = ["docs", "notebooks", "README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md", "CITATION.cff", "LICENSE"]
# Rooms of public names, in the order of a reader's need.
ROOMS = {
    "model": "Cloths, spheres, scenes",
    "scenes": "Ready scenes",
    "engine": "Stepping",
    "run": "Runs",
    "measure": "Measures",
    "accuracy": "Accuracy",
    "stability": "Stability",
    "methods": "Integrators",
    "sweeps": "Sweeps",
    "viewing": "Pictures, films, pages",
    "machine": "Build and machine",
    "gpu": "Compute shader",
    "errors": "Errors and warnings",
}
MODULES = ("scenes", "accuracy", "machine", "gpu")  # public modules beside the names of `clothsim`


def rooms() -> dict[str, list[str]]:
    """The names of `cs.__all__` by the room that defines them."""
    found: dict[str, list[str]] = {room: [] for room in ROOMS}
    for name in cs.__all__:
        value = getattr(cs, name)
        if not inspect.ismodule(value):
            found[value.__module__.split(".")[1]].append(name)
    return found


def directive(module: str, name: str) -> str:
    """The lines that document one name."""
    value = getattr(sys.modules[module], name)
    if not inspect.isclass(value):
        kind, options = ("autofunction", "") if callable(value) else ("autodata", "")
    else:
        inherited = "" if issubclass(value, BaseException) else "   :inherited-members: object, tuple, dict\n"
        kind, options = "autoclass", f"   :members:\n{inherited}"
    return f".. {kind}:: {module}.{name}\n{options}\n"


def reference(folder: Path) -> None:
    """A page for each room, and their list."""
    folder.mkdir()
    for room, names in rooms().items():
        title = ROOMS[room]
        page = f"{title}\n{'=' * len(title)}\n\n" + "".join(directive("clothsim", name) for name in names)
        if room in MODULES:
            module = __import__(f"clothsim.{room}", fromlist=["__all__"])
            beside = [name for name in module.__all__ if name not in names]
            page += "".join(directive(module.__name__, name) for name in beside)
        (folder / f"{room}.rst").write_text(page)
    listed = "".join(f"   {room}\n" for room in ROOMS)
    (folder / "index.rst").write_text(f"Reference\n=========\n\n.. toctree::\n   :maxdepth: 2\n\n{listed}   commands\n")


def commands(path: Path) -> None:
    """The page of the command line: what each `--help` prints."""
    page = "# Command line\n\nThis page lists every command with its `--help`. It is for users of the shell.\n"
    for name in ("", *COMMANDS):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
            command([*name.split(), "--help"])
        page += f"\n## clothsim {name}\n\n```text\n{printed.getvalue()}```\n"
    path.write_text(page)


def gallery(source: Path) -> None:
    """Copy the examples; each gets a title, by its file's name."""
    folder = source / "examples"
    folder.mkdir()
    for path in sorted((ROOT / "examples").glob("*.py")):
        title = path.stem.replace("_", " ").capitalize()
        text = path.read_text(encoding="utf8")
        (folder / path.name).write_text(text.replace('"""', f'"""\n{title}\n{"=" * len(title)}\n\n', 1), encoding="utf8")
    (folder / "GALLERY_HEADER.rst").write_text("Gallery\n=======\n\nShort scripts, each with what it prints and draws.\n")


def relink(page: Path) -> None:
    """Let links to scripts and folders of the repository lead to their pages."""
    text = page.read_text(encoding="utf8")
    text = re.sub(r"\]\((?:\.\./)*examples/(\w+)\.py\)", r"](/gallery/\1.rst)", text)
    text = re.sub(r"\]\((?:\.\./)*examples\)", "](/gallery/index.rst)", text)
    page.write_text(text, encoding="utf8")


def live(folder: Path, page: Path) -> None:
    """Write the live pages, which Sphinx copies as they are, and a link to them below a heading of `page`."""
    folder.mkdir(parents=True, exist_ok=True)
    write_gallery(folder)
    link = '<p><a href="../live/live.html">Try the scenes of the paper, live in this browser</a></p>'
    text = page.read_text(encoding="utf8")
    page.write_text(text.replace("## In a browser\n", f"## In a browser\n\n{link}\n"), encoding="utf8")


def stage(source: Path) -> None:
    """Write the sources that Sphinx reads."""
    shutil.rmtree(source, ignore_errors=True)
    source.mkdir(parents=True)
    for name in COPIED:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, source / name)
    shutil.rmtree(source / "docs" / "site")
    gallery(source)
    reference(source / "reference")
    commands(source / "reference" / "commands.md")
    for page in source.rglob("*.md"):
        relink(page)
    pages = sorted(str(page.relative_to(source).with_suffix("")) for page in source.rglob("*.md"))
    notebooks = sorted(f"notebooks/{page.stem}" for page in (source / "notebooks").glob("*.ipynb"))
    first = ["docs/start", "docs/index", "gallery/index", "reference/index"]
    rest = [page for page in [*pages, *notebooks] if page not in ("README", "reference/commands", *first)]
    trees = (("First", first), ("Pages", rest))
    toctree = "".join(
        f"\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n" + "\n".join(f"/{page}" for page in listed) + "\n```\n"
        for caption, listed in trees
    )
    (source / "index.md").write_text((source / "README.md").read_text(encoding="utf8") + toctree, encoding="utf8")
    (source / "README.md").unlink()


def main() -> int:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "build" / "docs").resolve()
    os.environ["COLUMNS"] = "100"  # width of --help
    stage(folder / "source")
    live(folder / "extra" / "live", folder / "source" / "docs" / "gpu.md")
    settings = ["-c", str(ROOT / "docs" / "site"), "-D", f"html_extra_path={folder / 'extra'}"]
    return sphinx(["-W", "--keep-going", "-q", *settings, str(folder / "source"), str(folder / "html")])


if __name__ == "__main__":
    sys.exit(main())
