"""The bench's files: their names, and what is written when something fails."""

from dataclasses import asdict, replace

import pytest
from bench import FULL, NORMAL, QUICK, SECTIONS, bench, machine_facts, plots, works
from bench import saved as files
from bench.report import text

BRIEF = replace(QUICK, windows=1, seconds=1e-5, sizes=(8,))


@pytest.mark.parametrize(
    "settings, sections, lacks",
    [
        (NORMAL, SECTIONS, ""),
        (FULL, SECTIONS, ""),
        (QUICK, SECTIONS, "-quick"),
        (FULL, ("frames", "calls"), "-frames-calls"),
        (QUICK, ("limits",), "-quick-limits"),
        (replace(FULL, windows=3), SECTIONS, "-custom"),
    ],
)
def test_files_say_what_a_run_lacks(settings, sections, lacks):
    about = machine_facts.describe()
    run = {"machine": about, "settings": asdict(settings), "sections": list(sections)}
    assert files.name(run) == machine_facts.slug(about) + lacks


def test_sections_are_named_in_one_order_and_a_table_of_nothing_is_not_written(tmp_path, monkeypatch):
    monkeypatch.setattr(machine_facts, "limits", lambda *arguments: {})
    start = files.slug(machine_facts.describe())
    bench(tmp_path, settings=BRIEF, sections=["limits"])
    bench(tmp_path, settings=BRIEF, sections=["calls", "limits"])
    expected = {f"{start}-custom-limits-calls.csv"}
    assert {path.name for path in tmp_path.iterdir()} == expected


def test_a_table_or_a_plot_that_fails_loses_nothing_else(tmp_path, monkeypatch):
    """Nor does a grid of the size that the frames have."""

    def broken(*arguments):
        raise ZeroDivisionError("by hand")

    monkeypatch.setattr("bench.efficiency", broken)
    monkeypatch.setitem(plots.ALL, "grids", broken)
    grid = works.grid
    monkeypatch.setattr(works, "grid", lambda rows: replace(grid(8), name=f"grid {rows}"))
    settings = replace(BRIEF, sizes=(8, 800))
    result = bench(tmp_path, settings=settings, sections=["features", "grids", "frames", "calls"])
    reason = "ZeroDivisionError: by hand"
    for label in ({"plot": "grids"}, {"table": "efficiency"}):
        assert {**label, "reason": reason} in result["skipped"]
    assert [p.stem.rsplit("-")[-1] for p in tmp_path.glob("*.png")] == ["features"]
    assert f"Left out (plot grids): {reason}" in text(result)
