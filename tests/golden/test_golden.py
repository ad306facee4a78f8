"""Bits and figures as they were when `python tests/golden/make.py` last ran."""

import pytest
from golden import rows
from variants import INSTRUCTION_SETS


@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning", "ignore::clothsim.OrderWarning")
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
