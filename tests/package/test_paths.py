"""Makefile, CI, settings and scripts name paths and commands that exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILES = [
    ROOT / name
    for name in (
        "CMakeLists.txt",
        "CITATION.cff",
        "Makefile",
        "NOTICE",
        "conftest.py",
        "pyproject.toml",
        "tests/conftest.py",
        "tools/sanitize.sh",
        ".ci/run",
        ".github/workflows/ci.yml",
        ".pre-commit-config.yaml",
    )
]
TOP = "benchmarks|cmake|cpp|docs|examples|notebooks|python|tests|tools"
# Words that begin with a folder of the repository; {project} is cibuildwheel's name of it.
PATH = re.compile(rf"(?:(?<![\w./~-])|(?<={{project}}/))(?:{TOP})/[\w./*-]+")
MADE = "python/clothsim/_core*.so"


def named_paths(text):
    return [path.rstrip("./") for path in PATH.findall(text)]


def missing_paths(text):
    return [path for path in named_paths(text) if path != MADE and not list(ROOT.glob(path))]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_paths_are_there(path):
    assert missing_paths(path.read_text(encoding="utf8")) == []


def test_a_path_that_is_gone_is_named():
    text = "tests/view/test_export.py tests/view/test_gone.py, build/docs/html {project}/tests/x"
    assert named_paths("see docs/index.md.") == ["docs/index.md"]
    assert missing_paths(text) == ["tests/view/test_gone.py", "tests/x"]


def targets():
    """Targets of the Makefile, stamps of extras included."""
    text = (ROOT / "Makefile").read_text(encoding="utf8")
    phony = re.search(r"^\.PHONY: (.+)$", text, re.M)[1].split()
    extras = re.search(
        r"^\[project\.optional-dependencies\]\n(.*?)\n\[",
        (ROOT / "pyproject.toml").read_text(encoding="utf8"),
        re.M | re.S,
    )[1]
    stamps = [f".venv/.built-{name}" for name in re.findall(r"^([\w-]+) = \[", extras, re.M)]
    assert set(phony) <= set(re.findall(r"^([\w-]+):", text, re.M))
    return {*phony, *stamps}


@pytest.mark.parametrize(
    "path",
    [
        *FILES[-3:],
        *(ROOT / name for name in ("CONTRIBUTING.md", "README.md", "docs/dev/release.md")),
    ],
    ids=lambda path: path.name,
)
def test_make_has_the_targets_that_are_called(path):
    text = path.read_text(encoding="utf8")
    called = re.findall(r"(?:`|run: |^|&& |\d+ )make ([\w./-]+)", text, re.M)
    assert {name for name in called if name.strip("./")} <= targets()
    stamps = re.findall(r"\.venv/\.built-[\w-]+", text)
    assert set(stamps) <= targets()


def test_the_address_of_the_repository_is_one():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf8")
    addresses = re.findall(r"https://(?:raw\.githubusercontent|github)\.com/(\w+/\w+)", text)
    assert len(addresses) >= 6 and len(set(addresses)) == 1
