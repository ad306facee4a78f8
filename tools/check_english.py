"""Check the English of pages, docstrings, comments and names: length of sentences, refused terms, pronouns as openings.

Usage: python tools/check_english.py [FILE...]

Reads README.md, the other pages of the root, docs/, docstrings and comments of the package, comments of the core, of the
shaders and of CMake, identifiers of both, and the names of the tests. Code, tables, drawings and headings are left out.
A sentence has at most 25 words; inline code counts as one word. Names are split at `_` and at capitals.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
PACKAGE = ROOT / "python" / "clothsim"
MODULES = sorted(PACKAGE.rglob("*.py"))
SOURCES = [
    *sorted((ROOT / "cpp").rglob("*.[ch]pp")),
    *sorted(PACKAGE.rglob("*.pyi")),
    *sorted(PACKAGE.rglob("*.wgsl")),
    ROOT / "CMakeLists.txt",
]
TESTS = sorted((ROOT / "tests").rglob("test_*.py"))

WORDS = 25  # shorter limits refuse plain sentences with a list in them, longer limits pass sentences with two ideas

# Refused term: term to write. Words with a second, plain meaning are left to the reader.
TERMS = {
    r"mended": "corrected",
    r"row-lifted|lifted rows?": "lane-transposed",
    r"mailbox(?:es)?|hands? (?:rows? )?on to": "halo exchange",
    r"companions?|twins?|of twice the step": "step doubling, or a better run",
    r"carried errors?": "global error estimate",
    r"shut(?:s|ting)? (?:it |them |a point )?in": "trapped between spheres",
    r"stiffest": "largest eigenvalue",
    r"magnif(?:y|ies|ied|ication)": "error amplification",
    r"look(?:s|ed|ing)? (?:for|along|at)|(?<!the )looks?(?= (?:whether|if|which))": "check, inspect, sample",
    r"answers? of (?:the|its) spheres?|answer(?:s|ed|ing)? (?:by|for|to (?:a|the) sphere)": "response",
    r"(?:is|are|be|was|were) (?:told|answered|met)|(?:cannot|to) (?:tell|be told)|tells|untold": "report, signal, respond",
    r"shares? (?:of a thread|of the work)|a thread's share": "block, part",
    r"lasting contacts?|contacts? that lasts?": "persistent contact",
    r"dear|dearer|dearest|worth": "cost, expensive",
    r"literal(?:ly)?": "as printed",
    r"whoever|nobody": "the subject",
}
# Refused parts of names: part to write.
PARTS = {
    r"look(?:s|ed|ing)?": "inspect, check, sample",
    r"(?:un)?answer(?:s|ed|ing)?|meets?|met|meeting": "response, respond, contact",
    r"(?:un)?told|tells?": "report, record, signal",
    r"shut|shutin": "trapped",
    r"mailbox": "halo",
    r"shares?": "block, part, member",
    r"lasting|recall|remember": "persistent contact, memory",
    r"dear(?:er)?|worth": "cost",
    r"literal": "as printed",
    r"mended": "corrected",
    r"stiffest": "largest eigenvalue",
    r"twins?|companions?": "better run, step doubling",
    r"carry|carried|carries": "global error, propagate",
    r"magnif(?:y|ied|ies)": "amplify",
    r"whoever|nobody": "the subject",
}
# Names of the standard library and of other packages.
OTHERS = {"Literal", "literal_eval", "look_at", "shares_memory", "may_share_memory", "show_share_button", "sharex", "sharey"}
REFUSED = {re.compile(rf"\b(?:{term})\b", re.IGNORECASE): instead for term, instead in TERMS.items()}
PART = {re.compile(part): instead for part, instead in PARTS.items()}
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


def blocks_of_source(text: str, mark: str) -> Iterator[tuple[int, str]]:
    """Paragraphs of comments. Lines with two spaces inside are drawings; a comment behind code is a paragraph of its own."""
    start, found, deeper = 0, [""], False
    for number, line in enumerate([*text.splitlines(), ""], 1):
        code, sign, comment = line.partition(mark)
        alone = not code.strip() and bool(sign)
        if sign and (_in_string(code) or comment.startswith(("!", ":"))):
            sign = comment = ""
            alone = False
        if not alone or not comment.strip() or ITEM.match(comment):
            if found[0]:
                yield start, " ".join(found)
            start, found = 0, [""]
        if alone and comment.strip():
            indented = comment.startswith("   ")
            drawing = "  " in comment.strip() or indented and re.search(r"[=<>]|\(\(", comment)
            if indented != deeper and found[0]:
                yield start, " ".join(found)
                start, found = 0, [""]
            deeper = indented
            if drawing or re.search(r"^ ?[-=+|/]{2,}|NOLINT|noqa|clang-format|type: ignore|mypy:", comment):
                if found[0]:
                    yield start, " ".join(found)
                start, found = 0, [""]
                continue
            start = start or number
            found = [*filter(None, found), ITEM.sub("", comment).strip()]
        elif sign and comment.strip() and not re.search(r"NOLINT|noqa|type: ignore|pragma", comment):
            yield number, comment.strip()


def _in_string(code: str) -> bool:
    code = re.sub(r"\\.|'\"'", "", code)
    return code.count('"') % 2 == 1 or code.rstrip().endswith(":") and "http" in code


def comments_of_module(text: str) -> Iterator[tuple[int, str]]:
    """Paragraphs of the `#` comments of a module: strings that hold a `#` are no comments."""
    lines = [""] * (text.count("\n") + 2)
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = ("" if not token.line[:column].strip() else "code ") + token.string
    yield from blocks_of_source("\n".join(lines), "#")


def names_of(path: Path, text: str) -> Iterator[tuple[int, str]]:
    """Identifiers with the line of their first use; of a test module the names of tests."""
    lines: dict[str, int] = {}
    if path.suffix in {".py", ".pyi"}:
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type == tokenize.NAME and (path not in TESTS or token.string.startswith("test_")):
                lines.setdefault(token.string, token.start[0])
    else:
        for number, line in enumerate(text.splitlines(), 1):
            for name in re.findall(r"[A-Za-z_]\w*", re.sub(r'//.*|"(?:\\.|[^"\\])*"', "", line)):
                lines.setdefault(name, number)
    yield from ((line, name) for name, line in lines.items())


def faults_of_name(name: str) -> Iterator[str]:
    if name in OTHERS:
        return
    for part in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name):
        for refused, instead in PART.items():
            if refused.fullmatch(part.lower()):
                yield f'"{part.lower()}" in a name: write {instead}'


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


def blocks_of(path: Path, text: str) -> Iterator[tuple[int, str]]:
    if path in TESTS:
        return
    if path.suffix == ".py":
        yield from blocks_of_module(text)
    if path.suffix in {".py", ".pyi"}:
        yield from comments_of_module(text)
    elif path.suffix in {".cpp", ".hpp", ".wgsl"}:
        yield from blocks_of_source(text, "//")
    elif path.name == "CMakeLists.txt":
        yield from blocks_of_source(text, "#")
    else:
        yield from blocks_of_page(text)


def main(arguments: list[str]) -> int:
    files = [Path(name).resolve() for name in arguments] or [*PAGES, *MODULES, *SOURCES, *TESTS]
    failed = 0
    for path in files:
        text = path.read_text(encoding="utf8")
        found = [
            (line, fault, sentence)
            for line, block in blocks_of(path, text)
            for sentence in sentences(block)
            for fault in faults(sentence)
        ]
        if path.suffix in {".py", ".pyi", ".cpp", ".hpp", ".wgsl"}:
            found += [(line, fault, name) for line, name in names_of(path, text) for fault in faults_of_name(name)]
        for line, fault, where in found:
            print(f"{path.relative_to(ROOT)}:{line}: {fault}\n    {where}")
        failed += len(found)
    print(f"{failed} faults in {len(files)} files")
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
