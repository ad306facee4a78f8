"""The site's sources hold every public name, command and example; `make docs` builds the site."""

import importlib.util
import re
from pathlib import Path

import clothsim as cs
import pytest

pytest.importorskip("sphinx")

ROOT = Path(__file__).parents[2]
SPEC = importlib.util.spec_from_file_location("stage", ROOT / "docs" / "site" / "stage.py")
STAGE = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(STAGE)


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site") / "source"
    STAGE.stage(folder)
    return folder


def test_the_reference_has_every_public_name_once(source):
    pages = "".join(
        page.read_text(encoding="utf8") for page in (source / "reference").glob("*.rst")
    )
    names = re.findall(r"^\.\. auto\w+:: clothsim\.(\w+)$", pages, re.M)
    assert sorted([*names, "scenes"]) == sorted(cs.__all__)  # ready scenes have a page of their own


def test_every_command_shows_its_help(source):
    page = (source / "reference" / "commands.md").read_text(encoding="utf8")
    for name in STAGE.COMMANDS:
        assert f"usage: clothsim {name} [-h]" in page


def test_every_example_has_a_title(source):
    staged = {path.name: path.read_text(encoding="utf8") for path in source.glob("examples/*/*.py")}
    assert sorted(staged) == sorted(path.name for path in (ROOT / "examples").glob("*.py"))
    assert all(re.match(r'"""\n(.+)\n(=+)\n\n', text) for text in staged.values())


def test_links_to_examples_lead_to_the_gallery(source):
    links = re.findall(
        r"\]\((/gallery/[^)]+)\.rst\)", (source / "docs" / "runs.md").read_text(encoding="utf8")
    )
    assert "/gallery/0/flag" in links


def test_the_live_pages_stand_on_the_front_page_and_in_the_menu(source):
    front = (source / "index.md").read_text(encoding="utf8")
    assert "[Try it live](live.md)" in front and "\n/live\n" in front
    page = (source / "live.md").read_text(encoding="utf8")
    for name, (title, *_) in STAGE.LIVE_PAGES.items():
        assert f'<a href="live/{name}"><img alt="{title}, ' in page
