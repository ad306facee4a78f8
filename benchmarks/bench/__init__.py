"""The bench: how fast this machine steps, beside its limits and other implementations.

`docs/benchmarks.md` says how the figures are taken; `python benchmarks/bench` is the command.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from common import Progress

from . import candidates, machine_facts, saved
from . import sections as sections_
from .figures import Figures, Measured, attempt, efficiency, ratios
from .settings import FULL, NORMAL, QUICK, SECTIONS, Settings

__all__ = ["FULL", "NORMAL", "QUICK", "SECTIONS", "Settings", "bench"]


def bench(
    out: str | Path | None = "benchmarks/results", *, settings: Settings = NORMAL, sections: Collection[str] = SECTIONS
) -> dict[str, Any]:
    """Measure, compare with the run saved before, and write the figures as CSV and plots.

    Parameters
    ----------
    out : path or None
        Folder of the files, made if missing. File names begin with the name of the machine. Other settings than
        `NORMAL` and `FULL` add "-quick" or "-custom", and a run of some sections adds their names. So these files
        never replace the files of a whole run. None writes nothing.
    settings : Settings
        Sizes of the measurement: `QUICK`, `NORMAL`, `FULL` or your own.
    sections : collection of str, default all
        Parts of the bench to run, of `SECTIONS`.

    Returns
    -------
    dict
        "machine": processor, cores, load average, build; "settings"; "sections"; "limits": peak arithmetic [flop/s],
        bandwidth [B/s] and the cores' round trip [s]; "figures": one entry a measured time (`Figure`) with its
        `ratios` to each peer; "accuracy"; "before": the comparison with the run that was saved before, or None;
        "efficiency"; "skipped": measurements left out or failed, and why; "files": the files written.
    """
    chosen = [section for section in SECTIONS if section in sections]
    if out is not None:
        Path(out).mkdir(parents=True, exist_ok=True)
    about = machine_facts.describe()
    figures = Figures()
    counts = tuple(sorted({1, min(2, about["cores"]), about["cores"]}))
    numba_threads = candidates.numba_threads(settings, counts, figures)
    supported = tuple(about["build"]["instruction_sets_supported"])
    best = about["build"]["instruction_set"]
    instruction_sets = (best, *(name for name in supported if name != best))
    kernels = sections_.kernels()

    limits: dict[str, Any] = {}
    accuracy = None
    bar = Progress("windows")
    plan = candidates.Bench(settings, figures, kernels, instruction_sets, counts, numba_threads, bar.advance)
    for k, section in enumerate(chosen, start=1):
        bar.say(f"{section} ({k} of {len(chosen)})")
        if section == "limits":
            limits = machine_facts.limits(instruction_sets, counts)
        elif section == "accuracy":
            accuracy = sections_.accuracy(plan)
        else:
            sections_.ALL[section](plan)
    bar.close()

    measured = Measured(figures, kernels, instruction_sets, counts, limits, accuracy)
    skipped = figures.skipped
    result: dict[str, Any] = {
        "machine": about,
        "settings": asdict(settings),
        "sections": chosen,
        "limits": machine_facts.as_plain(limits),
        "figures": [{**figure.as_dict(), **ratios(figure, figures)} for figure in figures],
        "accuracy": accuracy,
        "efficiency": attempt(partial(efficiency, measured), [], skipped, table="efficiency"),
        "skipped": skipped,
        "before": None,
        "files": [],
    }
    if out is not None:
        saved.write(result, Path(out))
    return result
