"""The bench: how fast this machine steps, beside its limits and other implementations.

`docs/benchmarks.md` says how the figures are taken; `clothsim bench` is the command.
"""

from __future__ import annotations

import os
from collections.abc import Collection
from dataclasses import asdict
from functools import partial
from typing import Any

from clothsim.base import check
from clothsim.base.progress import ProgressBar

from . import candidates, efficiency, machine_facts, measured_run
from . import saved as files
from . import sections as parts
from .bench_settings import FULL, NORMAL, QUICK, SECTIONS, Settings
from .figures import Figures, attempt
from .ratios import ratios

__all__ = ["FULL", "NORMAL", "QUICK", "SECTIONS", "Settings", "bench"]


def bench(
    out: str | os.PathLike[str] | None = "benchmarks/results",
    *,
    settings: Settings = NORMAL,
    sections: Collection[str] = SECTIONS,
    progress: bool = False,
) -> dict[str, Any]:
    """Measure, compare with the run saved before, and write the figures as CSV and plots.

    Parameters
    ----------
    out : path or None, default "benchmarks/results"
        Folder of the files, made if missing. Earlier files of equal names are replaced. File names begin with the name
        of the machine. Other settings than `NORMAL` and `FULL` add "-quick" or "-custom", and a run of some sections
        adds their names. So these files never replace the files of a whole run. None writes nothing.
    settings : Settings
        Sizes of the measurement: `QUICK`, `NORMAL`, `FULL` or your own.
    sections : collection of str, default all
        Parts of the bench to run, of `SECTIONS`.
    progress : bool, default False
        Show on stderr what is being measured (needs tqdm).

    Returns
    -------
    dict
        "schema"; "machine": processor, cores, load average, build; "settings"; "sections";
        "limits": peak arithmetic [flop/s], bandwidth [B/s] and the cores' round trip [s];
        "figures": one entry a measured time (see `clothsim.lab.bench.figures.Figure`) with how
        many times faster it is than each peer (`clothsim.lab.bench.ratios.ratios`); "accuracy";
        "before": the comparison with the run that was saved before, or None; "efficiency";
        "skipped": measurements left out or failed, and why; "files": the files written.

    Raises
    ------
    TypeError
        If `sections` is no collection, such as one name by itself, or `out` no path.
    ValueError
        For an unknown section, for none, or an `out` that is no folder.

    Examples
    --------
    >>> from clothsim.lab.bench import Settings, bench
    >>> report = bench(None, settings=Settings(windows=1, seconds=1e-4), sections=["calls"])
    >>> {figure["work"] for figure in report["figures"]} >= {"2 x 2", "32 x 32, a step a call"}
    True
    """
    chosen = check.choices("sections", sections, SECTIONS)
    folder = None if out is None else check.folder("out", out)
    about = machine_facts.describe()
    figures = Figures()
    counts = tuple(sorted({1, min(2, about["cores"]), about["cores"]}))
    numba_threads = candidates.numba_threads(settings, counts, figures)
    supported = tuple(about["build"]["instruction_sets_supported"])
    best = about["build"]["instruction_set"]
    instruction_sets = (best, *(name for name in supported if name != best))
    kernels = parts.kernels()

    limits: dict[str, Any] = {}
    accuracy = None
    with ProgressBar(progress, unit=" windows") as bar:

        def begin(section: str) -> None:
            bar.say(f"{section} ({chosen.index(section) + 1} of {len(chosen)})")

        if "limits" in chosen:
            begin("limits")
            limits = machine_facts.limits(instruction_sets, counts)
        plan = candidates.Bench(settings, figures, kernels, instruction_sets, counts, numba_threads, bar.advance)
        for name, measure in parts.ALL.items():
            if name in chosen:
                begin(name)
                measure(plan)
        if "accuracy" in chosen:
            begin("accuracy")
            accuracy = parts.accuracy(plan)

    measured = measured_run.Measured(figures, kernels, instruction_sets, counts, limits, accuracy)
    skipped = figures.skipped
    result: dict[str, Any] = {
        "schema": 1,
        "machine": about,
        "settings": asdict(settings),
        "sections": chosen,
        "limits": machine_facts.as_plain(limits),
        "figures": [{**figure.as_dict(), **ratios(figure, figures)} for figure in figures],
        "accuracy": accuracy,
        "efficiency": attempt(partial(efficiency.efficiency, measured), [], skipped, table="efficiency"),
        "skipped": skipped,
        "before": None,
        "files": [],
    }
    if folder is not None:
        files.write(result, folder)
    return result
