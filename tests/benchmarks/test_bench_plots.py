"""What the bench's plots show, on made-up figures."""

import itertools

import pytest
from bench.plots import ALL

pytest.importorskip("matplotlib")

from colors import check_lines, look

COUNTS = (1, 2, 8)


def figure(work, by, precision, threads, points, seconds, **changes):
    return {
        "work": work,
        "by": by,
        "precision": precision,
        "threads": threads,
        "points": points,
        "minimum": seconds,
        "springs": 6 * points,
        "flops": 500 * points,
        "instruction_set": "avx512",
        **changes,
    }


def made_up():
    """Steps of 20 ns a point for the edge kernel on one thread, 40 ns for gather."""
    kernels = (("edge", 20e-9), ("gather", 40e-9))
    cases = list(itertools.product(kernels, ("single", "double"), COUNTS))
    grids = [
        figure(
            f"grid {rows}",
            by,
            precision,
            threads,
            rows**2,
            rows**2 * seconds / threads,
            flops=rows**2 * (500 if by == "edge" else 800),
        )
        for rows in (8, 32)
        for (by, seconds), precision, threads in cases
    ]
    steps = [
        figure(work, by, precision, threads, 1024, 1024 * seconds / threads, springs=springs)
        for work, springs in (("static", 3906), ("static+bend", 5826))
        for (by, seconds), precision, threads in cases
    ]
    peak = [
        {"instruction_set": isa, "precision": precision, "threads": threads, "flops_per_second": threads * rate}
        for isa, slower in (("sse2", 4), ("avx512", 1))
        for precision, rate in (("single", 100e9 / slower), ("double", 50e9 / slower))
        for threads in COUNTS
    ]
    return {
        "figures": grids + steps,
        "settings": {"sizes": (8, 32)},
        "limits": {"peak": peak, "bandwidth": {1: 12e9, 2: 24e9, 8: 48e9}},
        "machine": {"build": {"instruction_set": "avx512"}},
    }


def test_grids_have_their_times_and_a_style_for_each_thread_count():
    single, double = ALL["grids"](made_up()).axes
    for panel in (single, double):
        lines = {line.get_label(): line for line in panel.get_lines()}
        for by, time in (("edge", 20), ("gather", 40)):
            of_kernel = [lines[f"{by}, {n} thread{'s' * (n > 1)}"] for n in COUNTS]
            for line, threads in zip(of_kernel, COUNTS, strict=True):
                assert line.get_ydata() == pytest.approx(2 * [time / threads])
                assert tuple(line.get_xdata()) == (64, 1024)
            assert len({look(line) for line in of_kernel}) == 3
            assert len({line.get_color() for line in of_kernel}) == 1


def test_grids_have_the_limits_of_one_thread_and_of_the_most():
    single, double = ALL["grids"](made_up()).axes
    for panel, flops in ((single, 5.0), (double, 10.0)):
        lines = {line.get_label(): line for line in panel.get_lines()}
        for threads, memory in (("1 thread", 8.0), ("8 threads", 2.0)):
            peak = lines[f"flops at peak, {threads}"].get_ydata()
            assert peak == pytest.approx(2 * [flops / int(threads[0])])
            moved = lines[f"96 bytes from memory, {threads}"].get_ydata()
            assert moved == pytest.approx(2 * [memory])
        assert not any("at peak, 2" in label for label in lines)
        colors = {line.get_color() for label, line in lines.items() if "at peak" in label}
        assert len(colors) == 2


def test_figures_without_measurement_are_not_drawn():
    report = {**made_up(), "figures": []}
    assert [draw(report) for draw in ALL.values()] == [None, None, None]


def test_readers_of_any_colour_vision_can_distinguish_the_lines():
    drawn = [draw(made_up()) for draw in ALL.values()]
    assert sum(len(check_lines(axes)) for figure in drawn if figure for axes in figure.axes) > 10
