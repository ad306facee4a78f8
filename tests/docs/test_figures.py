"""A figure that a docstring and a page both name is one figure."""

import re
from pathlib import Path

import clothsim as cs
import pytest

DOCS = Path(__file__).parents[2] / "docs"

# What has a docstring, the page, and how each names the figures.
FIGURES = {
    "inspected steps": (
        cs.UnstableError,
        "stability.md",
        r"up to (\d+) steps late",
        r"at least every (\d+) steps",
    ),
    "sampled states": (
        cs.Run,
        "accuracy.md",
        r"n = (min\(.+?\))[;,].+? every (\d+)th, and where (\S+) of the duration",
        r"n = (min\(.+?\)) .+? every (\d+)th accepted step, and wherever (\S+) of the duration",
    ),
    "stiffness of a layer": (
        cs.Sphere.layer,
        "contact.md",
        r"larger of (\d+) times the largest spring stiffness and (\d+) m \(w/h\)\^2",
        r"(\d+) times the largest spring stiffness, or (\d+) m \(w/h\)\^2",
    ),
    "slip speed of a layer": (
        cs.Sphere.layer,
        "contact.md",
        r"slip speed (min\(.+?\))",
        r"`slip_speed` v_s \[m/s\] \| (min\(.+?\))",
    ),
    "slow wind": (cs.Wind, "model.md", r"w is (\S+ m/s)\b", r"w = (\S+ m/s)\b"),
    "points of a team": (
        cs.step,
        "dev/kernels.md",
        r"fewer than (\S+) mass points",
        r"a team is taken for (\S+) points",
    ),
}


@pytest.mark.parametrize("figure", FIGURES)
def test_docstring_and_page_agree(figure):
    subject, page, in_docstring, on_page = FIGURES[figure]
    text = (DOCS / page).read_text(encoding="utf8").replace("$", "")
    claims = [
        re.search(pattern, " ".join(source.split()))
        for pattern, source in ((in_docstring, subject.__doc__), (on_page, text))
    ]
    assert all(claims), claims
    assert claims[0].groups() == claims[1].groups()
