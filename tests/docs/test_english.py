"""The checker of English finds the faults that it names, and passes plain sentences."""

import runpy
from pathlib import Path

import pytest

CHECKER = runpy.run_path(str(Path(__file__).parents[2] / "tools" / "check_english.py"))
LONG = "The core steps " + "very " * 21 + "fast."


@pytest.mark.parametrize(
    "block, said",
    [
        (LONG.replace("fast", "fast on one thread"), "28 words, at most 25"),
        ("`x` is read. What arrives is turned.", 'opens with "What": name the thing'),
        ("The mended rule is the default.", '"mended": write corrected'),
    ],
)
def test_faults_are_found(block, said):
    found = [fault for sentence in CHECKER["sentences"](block) for fault in CHECKER["faults"](sentence)]
    assert found == [said]


@pytest.mark.parametrize(
    "block",
    [
        LONG,
        LONG + " `step` is next. " + LONG,  # inline code begins a sentence
        "Kim et al. Method 1 reflects, e.g. eq. 13. 100 points follow. " + LONG,
        "What limits a step?",
    ],
)
def test_plain_sentences_pass(block):
    assert not [fault for sentence in CHECKER["sentences"](block) for fault in CHECKER["faults"](sentence)]


def test_code_tables_and_headings_are_left_out():
    page = f"# What\n\n```\n{LONG} on\n```\n\n| Those | who |\n\n    x = what\n\n- One line\n  goes on.\n- Another.\n"
    assert [block for _, block in CHECKER["blocks_of_page"](page)] == ["One line goes on.", "Another."]


def test_docstrings_are_read_without_names_and_sessions():
    module = '"""Title.\n\nNotes of the module.\n"""\ndef f(x):\n    """Return.\n\n    Parameters\n    ----------\n'
    module += '    x : float, What\n        Length [m].\n\n    Examples\n    --------\n    >>> What\n    3\n    """\n'
    blocks = [block for _, block in CHECKER["blocks_of_module"](module)]
    assert blocks == ["Title.", "Notes of the module.", "Return.", "Length [m]."]


@pytest.mark.parametrize(
    "source, mark, expected",
    [
        ("// One sentence\n// goes on.\nint x = 3;  // metres\n", "//", ["One sentence goes on.", "metres"]),
        ("// First.\n//\n// Second.\n//   x = a + b   (drawing)\n", "//", ["First.", "Second."]),
        ('const char* url = "http://host";\n', "//", []),
        ("set(x 1)  # a flag\n# One idea.\n", "#", ["a flag", "One idea."]),
    ],
)
def test_comments_are_read_by_paragraph(source, mark, expected):
    assert [block for _, block in CHECKER["blocks_of_source"](source, mark)] == expected


def test_a_sharp_in_a_string_is_no_comment():
    assert [b for _, b in CHECKER["comments_of_module"]('x = "# What"  # metres\n')] == ["metres"]


@pytest.mark.parametrize("name, fault", [("look_along", True), ("LookTable", True), ("outlook", False), ("Literal", False)])
def test_names_are_split_at_underscores_and_capitals(name, fault):
    assert bool(list(CHECKER["faults_of_name"](name))) == fault
