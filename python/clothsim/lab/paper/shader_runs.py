"""The GPU side of experiment 4, where wgpu and a graphics adapter are there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from clothsim.gpu import Adapter, adapters
from clothsim.typing import Precision

from ..shader import comparison, experiment
from ..shader import shader_report as report
from .paper_settings import Settings

PRECISION: Precision = "single"


def available() -> tuple[list[Adapter], str]:
    """The adapters, and the reason if there is none."""
    try:
        found = adapters()
    except ImportError as error:
        return [], str(error)
    return found, "" if found else "this machine has no graphics adapter that wgpu can use"


def settings_of(settings: Settings) -> experiment.Settings:
    """The sizes that a reproduction with `settings` compares."""
    return experiment.Settings(
        sizes=settings.gpu_sizes,
        batches=settings.gpu_batches,
        precisions=(PRECISION,),
        frame_steps=settings.steps_per_frame(settings.timing_dt),
        window_frames=settings.window_frames,
        runs=settings.runs,
        seconds=settings.gpu_seconds,
        paper_seconds=4 * settings.gpu_seconds,
        first_seconds=settings.gpu_seconds / 4,
    )


def over_sizes(
    settings: Settings, found: list[Adapter], folder: Path, *, advance: Callable[..., Any] = lambda runs: None
) -> dict[str, Any]:
    """CPU against GPU over cloth sizes and batches, in compensated single precision.

    Returns
    -------
    dict
        "rows" (one per scene, method and target), "crossovers" and "warnings" (sentences), "csv" and "plot" (file
        names).
    """
    measurements = experiment.run(settings_of(settings), found, advance=advance)
    files = report.write(measurements, folder, "figure10_sizes")
    return {
        "rows": report.rows(measurements),
        "crossovers": comparison.crossovers(measurements),
        "warnings": comparison.warnings(measurements),
        "csv": [file.name for file in files if file.suffix == ".csv"],
        "plot": "figure10_sizes.png",
    }
