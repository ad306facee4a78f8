"""The bench: every section's rows, and the error beside a time; throughput of batch and sweep."""

import csv

import bench
import pytest
import throughput


def test_rows_have_times_and_errors_of_rounding(monkeypatch, tmp_path, capsys):
    def quick(group, windows, seconds, error_steps):
        return time_group(group[:1] + group[-1:], 1, 1e-4, 20)

    time_group = bench.time_group
    monkeypatch.setattr(bench, "time_group", quick)
    monkeypatch.setattr(bench, "numba", lambda *arguments: iter(()))
    bench.main(
        ["--quick", "--csv", str(tmp_path / "figures.csv"), "steps", "features", "batches", "calls"]
    )
    with (tmp_path / "figures.csv").open() as file:
        assert file.readline().startswith("# ")
        rows = list(csv.DictReader(file))
    assert {row["by"] for row in rows} == {"edge", "gather", "numpy"}
    assert all(
        0 < float(row["least_us"]) <= float(row["median_us"]) and float(row["spread_%"]) >= 0
        for row in rows
    )
    assert all(
        float(row["error_m"]) <= float(row["frames_error_m"]) for row in rows if row["error_m"]
    )
    errors = {row["by"]: float(row["error_m"]) for row in rows if row["error_m"]}
    assert errors["edge"] < 1e-15 < 1e-8 < errors["numpy"] < 1e-5  # double; float32
    out = capsys.readouterr().out
    assert (
        "swing, all springs" in out
        and f"clothsim {bench.cs.__version__} (" in out
        and "numpy " in out
    )


def test_a_wrong_kernel_shows_in_its_error(monkeypatch):
    monkeypatch.setattr(
        bench.Core, "run", lambda self, steps: self.stepper.advance(steps, 2 * bench.PAPER_DT)
    )
    start = bench.swing()
    (row,) = bench.time_group(
        [bench.core(start, kernel="edge", precision="double", threads=1)], 1, 1e-4, 20
    )
    assert row["error_m"] > 1e-6


def test_peers_that_cannot_run_are_left_out(capsys):
    def missing():
        raise ImportError("numba is not installed")

    assert bench.time_group([(bench.swing(), {"by": "numba"}, missing)], 1, 1e-4, 20) == []
    assert "left out: numba" in capsys.readouterr().out


@pytest.mark.peers
def test_numba_computes_the_motion():
    assert (
        bench.time_group([*bench.numba(bench.grid(8), (1,))][:1], 1, 1e-4, 20)[0]["error_m"] < 1e-12
    )


def test_throughput_has_rows_of_batch_and_sweep():
    pytest.importorskip("xarray")
    pytest.importorskip("zarr")
    rows = throughput.measure(2, 20, 5e-4, 1, {"precision": "double", "threads": 1})
    assert [row[:5] for row in rows] == [
        ("double", by, "2", "1024", "0.0005") for by in ("batch", "sweep")
    ]
    assert 0 < float(rows[0][5]) < 1e-6 and rows[0][5] == rows[1][5]  # error of RK4 over 0.01 s
    rate = float(rows[0][6].replace(",", ""))
    assert (
        float(rows[0][8].replace(",", "")) == pytest.approx(5e-4 * rate, rel=1e-2)
        and rows[0][9] == "1.00"
    )
    assert len(rows[0]) == len(throughput.HEAD)
