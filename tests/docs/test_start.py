"""The tutorial docs/start.md does what it says, and start.ipynb is that page with its outputs."""

import contextlib
import io
import json
import re
import runpy
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("xarray")

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "start.md").read_text(encoding="utf8")
BLOCK = re.compile(r"```python\n(.*?)```\n(?:\n```output\n(.*?)```)?", re.DOTALL)


def test_the_page_prints_the_stated_output(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    for code, expected in BLOCK.findall(PAGE):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(code, names)  # of this repository
        assert printed.getvalue() == expected, code
    assert {path.name for path in tmp_path.iterdir()} == {"cloth.png", "cloth.html", "cloth.npz"}


def test_the_readme_prints_the_stated_output(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "README.md").read_text(encoding="utf8")
    code, expected = re.search(r"```python\n(.*?)```\n\n```\n(.*?)```", page, re.DOTALL).groups()
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(code, {})  # of this repository
    lines = printed.getvalue().splitlines()
    assert "s of computing on" in lines.pop(-2)  # which has times of a machine
    # Rounding, and with it the number of steps, depends on the instruction set.
    number = re.compile(r"(?<![\w.])-?[\d.,]+(?:e[-+]\d+)?(?= |\)|$)")
    for line, stated in zip(lines, expected.splitlines(), strict=True):
        if "steps of" not in line and "error at" not in line:
            assert line == stated
            continue
        assert number.sub("", line) == number.sub("", stated)
        values = [float(value.replace(",", "")) for value in number.findall(line)]
        expected_values = [float(value.replace(",", "")) for value in number.findall(stated)]
        np.testing.assert_allclose(values, expected_values, rtol=0.05)
    assert (tmp_path / "run.html").exists()
    assert len(page.splitlines()) <= 110


def test_the_notebook_is_the_page():
    pytest.importorskip("nbclient")
    path = ROOT / "notebooks" / "start.ipynb"
    cells = json.loads(path.read_text(encoding="utf8"))["cells"]
    cells_of_page = runpy.run_path(str(path.with_name("make.py")))["cells"]()
    sources = [cell["source"] for cell in cells_of_page]
    assert ["".join(cell["source"]) for cell in cells] == sources
    outputs = [
        "".join(
            "".join(output["text"])
            for output in cell["outputs"]
            if output["output_type"] == "stream"
        )
        for cell in cells
        if cell["cell_type"] == "code"
    ]
    assert outputs == [expected for _, expected in BLOCK.findall(PAGE)]
    assert path.stat().st_size < 200_000
