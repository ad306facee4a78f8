"""Build the site: `python docs/site/stage.py [FOLDER]`, by default into build/docs.

Stages a copy of the pages in FOLDER/source, in the repository's layout, so that their links hold.
Adds what is generated: the menu (from docs/index.md), the reference, the commands, the gallery's
titles, and the paper's scenes as live pages. A warning fails the build.
"""

from __future__ import annotations

import ast
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
from clothsim.paper import LIVE_PAGES, write_gallery
from sphinx.cmd.build import main as sphinx

ROOT = Path(__file__).resolve().parents[2]
COPIED = [
    "docs",
    "notebooks",
    "README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "SECURITY.md",
    "CITATION.cff",
    "LICENSE",
]
GALLERY = {
    "First steps": "drape moving_sphere driven_pins flag ball_by_hand settle resume blender",
    "Error and speed": "order speed_against_error stability_map gather_bits hard_case",
    "Many cloths": "batch ensemble sweep_stiffness_and_step custom_metric fit",
    "Contact": "opening fast_sphere",
    "The paper's experiments": "paper_static paper_cpu paper_frame_rate",
}


def by_use() -> dict[str, list[str]]:
    """Return full names of the groups of `help(clothsim)`, the most used first.

    A module stands for its further names.
    """
    groups = re.findall(r"^(\w[^\n]*)\n((?:    \w+ {2,}[^\n]+\n)+)", cs.__doc__, re.M)
    listed = {title: re.findall(r"^    (\w+)", names, re.M) for title, names in groups}
    listed = {"Simulate": listed["Simulate"], **listed}
    listed["Know the error"].append("accuracy")
    listed["Look up"].append("gpu")
    return {
        title: [full for name in names for full in full_names(name)]
        for title, names in listed.items()
    }


def full_names(name: str) -> list[str]:
    """Return the full name, or those of a module that are not in `cs.__all__`."""
    value = getattr(cs, name, None) or __import__(f"clothsim.{name}", fromlist=["__all__"])
    if not inspect.ismodule(value):
        return [f"clothsim.{name}"]
    return [f"clothsim.{name}.{member}" for member in value.__all__ if member not in cs.__all__]


def is_called(full: str) -> bool:
    """Return whether a name is a function or a class: a constant has no first sentence."""
    module, _, name = full.rpartition(".")
    return callable(getattr(sys.modules[module], name))


def directive(full: str) -> str:
    """Return the lines that document one name."""
    module, _, name = full.rpartition(".")
    value = getattr(sys.modules[module], name)
    if not inspect.isclass(value):
        kind, options = ("autofunction", "") if callable(value) else ("autodata", "")
    else:
        inherited = (
            ""
            if issubclass(value, BaseException)
            else "   :inherited-members: object, tuple, dict\n"
        )
        kind = "autoclass"
        options = f"   :members:\n{inherited}"
    return f".. {kind}:: {full}\n{options}\n"


def reference(folder: Path) -> None:
    """Write a page for each group, and their list: every name in one line."""
    folder.mkdir()
    index = "Reference\n=========\n\n"
    tree = ".. toctree::\n   :hidden:\n\n"
    for title, names in by_use().items():
        file = title.lower().replace(" ", "-")
        (folder / f"{file}.rst").write_text(
            f"{title}\n{'=' * len(title)}\n\n" + "".join(map(directive, names))
        )
        table = "".join(f"   {name}\n" for name in names if is_called(name))
        index += f"{title}\n{'-' * len(title)}\n\n.. autosummary::\n   :nosignatures:\n\n{table}\n"
        tree += f"   {file}\n"
    (folder / "index.rst").write_text(f"{index}{tree}   commands\n")


def commands(path: Path) -> None:
    """Write the page of the command line: what each `--help` prints."""
    page = (
        "# Command line\n\nThis page lists every command with its `--help`. It is for users of "
        "the shell.\n"
    )
    for name in ("", *COMMANDS):
        output = io.StringIO()
        with contextlib.redirect_stdout(output), contextlib.suppress(SystemExit):
            command([*name.split(), "--help"])
        page += f"\n## clothsim {name}\n\n```text\n{output.getvalue()}```\n"
    path.write_text(page)


def add_title(path: Path) -> str:
    """Return an example titled by its first sentence; the last picture stands in the gallery."""
    text = path.read_text(encoding="utf8")
    title, _, more = ast.get_docstring(ast.parse(text)).partition("\n\n")
    title = title.replace("\n", " ").rstrip(".")
    code = text.partition('"""')[2].partition('"""')[2]
    return (
        f'"""\n{title}\n{"=" * len(title)}\n\n{more}\n"""\n# sphinx_gallery_thumbnail_number = '
        f"-1\n{code}"
    )


def gallery(folder: Path) -> None:
    """Copy the examples, a folder for each group."""
    for number, (group, names) in enumerate(GALLERY.items()):
        (folder / str(number)).mkdir(parents=True)
        (folder / str(number) / "GALLERY_HEADER.rst").write_text(f"{group}\n{'-' * len(group)}\n")
        for name in names.split():
            example = add_title(ROOT / "examples" / f"{name}.py")
            (folder / str(number) / f"{name}.py").write_text(example, encoding="utf8")
    (folder / "GALLERY_HEADER.rst").write_text(
        "Gallery\n=======\n\nShort scripts, each with what it prints and draws.\n"
    )


def relink(page: Path) -> None:
    """Let links to scripts and folders of the repository lead to their pages."""
    group = {
        name: number for number, names in enumerate(GALLERY.values()) for name in names.split()
    }
    text = page.read_text(encoding="utf8")
    script = re.compile(r"\]\((?:\.\./)*examples/(\w+)\.py\)")
    text = script.sub(lambda match: f"](/gallery/{group[match[1]]}/{match[1]}.rst)", text)
    text = re.sub(r"\]\((?:\.\./)*examples\)", "](/gallery/index.rst)", text)
    page.write_text(text.replace("](docs/gpu.md#in-a-browser)", "](live.md)"), encoding="utf8")


def live_pages() -> str:
    """Return the page that leads to the live pages, each with its picture."""
    links = "\n".join(
        f'<a href="live/{name}"><img alt="{title}, after {moment:g} s" '
        f'src="live/{name.replace(".html", ".png")}">{title}</a>'
        for name, (title, _, moment) in LIVE_PAGES.items()
    )
    return (
        "# Live in this browser\n\nEach page simulates a scene by the compute shader, in a browser "
        "with WebGPU; in another it plays a stored run. Drag the sphere and the pins. "
        f'[How it works](docs/gpu.md#in-a-browser).\n\n<div class="live">\n{links}\n</div>\n'
    )


def menu(index: str) -> dict[str, list[str]]:
    """Return captions of the menu and their pages: headings of docs/index.md and their links."""
    groups: dict[str, list[str]] = {}
    listed_pages: set[str] = set()
    for part in index.split("\n## ")[1:]:
        links = re.findall(r"\]\((\.\./)?([\w/-]+)\.(?:md|ipynb)[)#]", part)
        pages = dict.fromkeys(path if prefix else f"docs/{path}" for prefix, path in links)
        groups[part.partition("\n")[0].partition(":")[0]] = [
            page for page in pages if page not in listed_pages
        ]
        listed_pages |= set(pages)
    learn, *_, look_up, maintain = groups.values()
    learn += ["gallery/index", "live"]
    look_up[:0] = ["reference/index"]
    maintain += ["docs/index", "SECURITY"]
    return groups


def stage(source: Path) -> None:
    """Write the sources that Sphinx reads."""
    shutil.rmtree(source, ignore_errors=True)
    source.mkdir(parents=True)
    for name in COPIED:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, source / name)
    shutil.rmtree(source / "docs" / "site")
    gallery(source / "examples")
    reference(source / "reference")
    commands(source / "reference" / "commands.md")
    (source / "live.md").write_text(live_pages(), encoding="utf8")
    for page in source.rglob("*.md"):
        relink(page)
    front = (source / "README.md").read_text(encoding="utf8")
    for caption, pages in menu((ROOT / "docs" / "index.md").read_text(encoding="utf8")).items():
        title = {page: f"Notebook: {Path(page).stem} " for page in pages if "notebooks/" in page}
        entries = "\n".join(
            f"{title[page]}</{page}>" if page in title else f"/{page}" for page in pages
        )
        front += f"\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n{entries}\n```\n"
    (source / "index.md").write_text(front, encoding="utf8")
    (source / "README.md").unlink()


def main() -> int:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "build" / "docs").resolve()
    os.environ["COLUMNS"] = "100"  # width of --help
    stage(folder / "source")
    live = folder / "extra" / "live"
    live.mkdir(parents=True, exist_ok=True)
    write_gallery(live)
    settings = ["-c", str(ROOT / "docs" / "site"), "-D", f"html_extra_path={live.parent}"]
    return sphinx(
        ["-W", "--keep-going", "-q", *settings, str(folder / "source"), str(folder / "html")]
    )


if __name__ == "__main__":
    sys.exit(main())
