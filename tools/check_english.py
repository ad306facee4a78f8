"""Check the English of the documentation: length of sentences, refused terms, pronouns as openings.

Usage: python tools/check_english.py [FILE...]

Reads README.md, the other pages of the root, docs/, and the docstrings of the package. Code, tables and headings are left
out. A sentence has at most 25 words; inline code counts as one word.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
MODULES = sorted((ROOT / "python" / "clothsim").rglob("*.py"))

WORDS = 25  # shorter limits refuse plain sentences with a list in them, longer limits pass sentences with two ideas

# Refused term: term to write. Words with a second, plain meaning are left to the reader.
TERMS = {
    r"mended": "corrected",
    r"row-lifted|lifted rows?": "lane-transposed",
    r"mailbox(?:es)?": "halo exchange",
    r"companions?|twins?": "step doubling, or a better run",
    r"carried errors?": "global error estimate",
    r"shut (?:it )?in": "trapped between spheres",
    r"stiffest": "largest eigenvalue",
    r"looked for": "checked, sampled",
    r"answers? of (?:the|its) spheres?|answered (?:by|for)": "response",
    r"whoever|nobody": "the subject",
}
REFUSED = {re.compile(rf"\b(?:{term})\b", re.IGNORECASE): instead for term, instead in TERMS.items()}
OPENING = re.compile(r"(?:What|Who|Whose|Whoever|Those|Ones|That which|The same (?:as|for|is|holds|goes))\b")
ABBREVIATION = re.compile(r"\b(?:(?:e\.g|i\.e|etc|vs|cf|eqs?|Eqs?|Fig|No|approx|incl)\.|et al\.(?! [A-Z]))")
END = re.compile(r"(?<=[.!?])[)\"'*]*\s+(?=[\"'(*]*[A-Z0-9]|\"\w)")
ITEM = re.compile(r"^\s*(?:[-*+]|\d+\.)\s+")


def plain(text: str) -> str:
    """The words of a text: inline code, links and formulas become one word each."""
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"(?::\w+:)?(?:``[^`]+``|`[^`]*`)", "Code", text)  # may begin a sentence
    text = ABBREVIATION.sub(lambda found: found[0].replace(".", ""), text)
    return " ".join(text.replace("**", "").split())


def sentences(block: str) -> Iterator[str]:
    for sentence in END.split(plain(block)):
        if sentence:
            yield sentence


def blocks_of_page(text: str) -> Iterator[tuple[int, str]]:
    """Paragraphs and list items with the line at which they begin."""
    text = re.sub(r"^```.*?^```", lambda m: "\n" * m[0].count("\n"), text, flags=re.MULTILINE | re.DOTALL)
    yield from _blocks(text.splitlines(), 1, indent=4)


def _blocks(lines: list[str], first: int, indent: int) -> Iterator[tuple[int, str]]:
    found: list[str] = []
    start = first
    margin = 0
    in_list = False
    for number, line in enumerate([*lines, ""], first):
        item = bool(ITEM.match(line))
        code = line.startswith(" " * indent) and not in_list
        stops = not line.strip() or line.lstrip().startswith(("|", "#", ">>>", "...")) or code
        shift = len(line) - len(line.lstrip())
        if (stops or item or (shift != margin and not in_list)) and found:
            yield start, " ".join(found)
            found = []
        if item:
            in_list = True
        elif line.strip() and not line.startswith(" "):
            in_list = in_list and bool(found)
        if not stops:
            if not found:
                start = number
            margin = shift
            found.append(ITEM.sub("", line).strip())


SECTION = re.compile(r"^\s*-{3,}\s*$")


def blocks_of_module(text: str) -> Iterator[tuple[int, str]]:
    """Paragraphs of docstrings; signatures of parameters and sessions are left out."""
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        if not ast.get_docstring(node, clean=False):
            continue
        constant = node.body[0]
        lines = text.splitlines()[constant.lineno - 1 : constant.end_lineno]
        base = len(lines[0]) - len(lines[0].lstrip())
        lines = [line[base:] if not line[:base].strip() else line for line in lines]
        lines[0] = lines[0].lstrip("rf").lstrip('"')
        lines[-1] = lines[-1].removesuffix('"""')
        yield from _paragraphs(lines, constant.lineno)


def _paragraphs(lines: list[str], first: int) -> Iterator[tuple[int, str]]:
    kept: list[str] = []
    section, session = "", False
    for k, line in enumerate(lines):
        following = lines[k + 1] if k + 1 < len(lines) else ""
        if SECTION.match(following):
            section = line.strip()
        if not line.strip():
            session = False
        session = session or line.lstrip().startswith(">>>")
        heads = section and not line.startswith(" ")  # names, types, the rule below a section
        listed = section in {"Examples", "See Also", "References"}
        formula = not section and line.startswith("    ") or "====" in line or "  " in line.strip()
        code = session or (listed and line.startswith("  ")) or (section == "Examples" and session)
        kept.append("" if heads and section != "Notes" and section != "Examples" else "" if code or formula else line)
        if SECTION.match(line):
            kept[-1] = ""
            kept[-2] = ""
    yield from _blocks([line.strip() and line for line in kept], first, indent=99)


def faults(sentence: str) -> Iterator[str]:
    # A list of keys with their meanings is no sentence: each of its parts counts alone.
    parts = sentence.split(";") if sentence.startswith('"') or sentence.count(";") > 1 else [sentence]
    count = max(sum(1 for word in part.split() if re.search(r"\w", word)) for part in parts)
    if count > WORDS:
        yield f"{count} words, at most {WORDS}"
    for term, instead in REFUSED.items():
        if found := term.search(sentence):
            yield f'"{found[0]}": write {instead}'
    if OPENING.match(sentence) and not sentence.endswith("?"):
        yield f'opens with "{sentence.split()[0]}": name the thing'


def main(arguments: list[str]) -> int:
    files = [Path(name).resolve() for name in arguments] or [*PAGES, *MODULES]
    failed = 0
    for path in files:
        text = path.read_text(encoding="utf8")
        blocks = blocks_of_module(text) if path.suffix == ".py" else blocks_of_page(text)
        for line, block in blocks:
            for sentence in sentences(block):
                for fault in faults(sentence):
                    print(f"{path.relative_to(ROOT)}:{line}: {fault}\n    {sentence}")
                    failed += 1
    print(f"{failed} faults in {len(files)} files")
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
