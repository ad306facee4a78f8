"""Bits, figures and pictures as they were when `python tests/golden/make.py` last ran."""

import numpy as np
import pytest
from golden import figures, rows
from variants import INSTRUCTION_SETS

pytestmark = [
    pytest.mark.filterwarnings(f"ignore::clothsim.{kind}Warning")
    for kind in ("Stability", "Order", "Contact")
]


@pytest.mark.parametrize("isa", ["avx512", "avx2", "sse2"])
@pytest.mark.parametrize("row", rows.golden())
def test_bits(row, isa, monkeypatch):
    if isa not in INSTRUCTION_SETS:
        pytest.skip(f"no {isa} on this processor")
    expected = rows.golden()[row].get(rows.key(row, isa))
    if not expected:
        pytest.skip(f"hashes.txt has none for {rows.key(row, isa)}")
    monkeypatch.setenv("CLOTHSIM_ISA", isa)
    for threads in (1, 2, 3) if row in rows.OF_THREADS else (1,):
        assert rows.digest(row, threads) == expected, f"{row} on {isa} by {threads} thread(s)"


@pytest.mark.parametrize("row", figures.golden())
def test_figures(row):
    if not row.startswith(("error_control", "max_stable_dt")):
        pytest.importorskip("xarray")
    values = figures.compute(row)
    for name, value in figures.golden()[row].items():
        rel = figures.TOLERANCES.get(name, figures.ROUNDING)
        least = figures.LEAST_ERROR if "error" in name else 1e-12
        np.testing.assert_allclose(values[name], value, rel, least, err_msg=f"{row}: {name}")
    if values.get("told"):
        assert values["error"] <= values["estimate"]


@pytest.mark.parametrize("name", figures.PICTURES)
def test_pictures(name):
    image = pytest.importorskip("PIL.Image")
    expected = np.asarray(image.open(figures.FOLDER / f"{name}.png").convert("RGB"), int)
    pixels = np.asarray(figures.picture(name).pixels, int)
    assert pixels.shape == expected.shape
    assert np.abs(pixels - expected).mean() <= 0.25, "mean difference of 0 ... 255"
