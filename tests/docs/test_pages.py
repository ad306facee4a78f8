"""Pages of docs/ link to files and headings that exist, and the index lists every page."""

import json
import re
from pathlib import Path

from tables import each

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md")) + [ROOT / "README.md"]
LINK = re.compile(r"\]\(([^)\s]+)\)")


def without_code(page):
    return re.sub(r"```.*?```", "", page.read_text(encoding="utf8"), flags=re.DOTALL)


def anchors(page):
    """Return anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", without_code(page), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@each("page", PAGES)
def test_links_lead_somewhere(page):
    for link in LINK.findall(without_code(page)):
        if "://" in link:
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), f"{link} leads nowhere"
        if anchor:
            assert anchor in anchors(target), f"{link}: no such heading"


PLACE = re.compile(
    r"(?:cpp|python|tests|benchmarks|docs|examples|notebooks|tools|cmake)/[\w./*<>-]+$"
)


@each("page", [*PAGES, ROOT / "CONTRIBUTING.md"])
def test_files_of_the_repository_are_where_a_page_says(page):
    for code in re.findall(r"`([^`\n]+)`", without_code(page)):
        for word in code.split():
            if PLACE.match(word):
                assert list(ROOT.glob(word.rstrip("/"))), f"{word} is not there"


def test_the_index_lists_every_page():
    index = without_code(DOCS / "index.md")
    linked = {(DOCS / link.partition("#")[0]).resolve() for link in LINK.findall(index)}
    assert set(DOCS.rglob("*.md")) - {DOCS / "index.md"} <= linked


@each("page", sorted(DOCS.rglob("*.md")))
def test_a_page_opens_with_its_subject_and_its_readers(page):
    opening = " ".join(without_code(page).split("\n\n")[1].split())
    assert re.match(r"This .+\. It is for .+\.", opening), opening


NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


def cells(notebook, kind):
    content = json.loads(notebook.read_text(encoding="utf8"))
    return ["".join(cell["source"]) for cell in content["cells"] if cell["cell_type"] == kind]


@each("page", [*PAGES, ROOT / "CONTRIBUTING.md", *NOTEBOOKS])
def test_code_is_not_cut_on_the_site(page):
    if page in NOTEBOOKS:
        code = cells(page, "code")
    else:
        code = re.findall(r"```\w+\n(.*?)```", page.read_text(encoding="utf8"), re.DOTALL)
    assert [line for block in code for line in block.splitlines() if len(line) > 88] == []


@each("page", [*PAGES, *NOTEBOOKS])
def test_every_image_has_a_text_alternative(page):
    text = "\n".join(cells(page, "markdown")) if page in NOTEBOOKS else without_code(page)
    assert "<img" not in text
    for alternative, image in re.findall(r"!\[(.*?)\]\((\S+?)\)", text):
        assert len(alternative.split()) >= 3, f"{image} needs words that say what it shows"


def squeezed(text):
    return re.sub(r"\s+", "", text)


@each("page", [DOCS / "howto" / f"add-{thing}.md" for thing in ("a-force", "an-integrator")])
def test_worked_examples_are_the_code_of_the_package(page):
    text = page.read_text(encoding="utf8")
    files = {word for word in re.findall(r"`([^`\n]+)`", without_code(page)) if PLACE.match(word)}
    sources = [
        squeezed(path.read_text(encoding="utf8"))
        for path in map(ROOT.joinpath, files)
        if path.is_file()
    ]
    for block in re.findall(r"```\w+\n(.*?)```", text, flags=re.DOTALL):
        for part in map(squeezed, block.split("\n\n")):
            assert any(part in source for source in sources), part
