"""Throughput of a batch and of a sweep: equal motions, and figures that belong together."""

import pytest
import throughput

pytest.importorskip("xarray")
pytest.importorskip("zarr")


def test_rows_of_batch_and_sweep():
    rows = throughput.measure(2, 20, 5e-4, 1, {"precision": "double", "threads": 1})
    assert [row[:5] for row in rows] == [("double", by, "2", "1024", "0.0005") for by in ("batch", "sweep")]
    assert 0 < float(rows[0][5]) < 1e-6 and rows[0][5] == rows[1][5]  # of RK4, over 0.01 s
    rate = float(rows[0][6].replace(",", ""))
    assert float(rows[0][8].replace(",", "")) == pytest.approx(5e-4 * rate, rel=1e-2) and rows[0][9] == "1.00"
    assert len(rows[0]) == len(throughput.HEAD)
