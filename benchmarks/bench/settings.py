"""Sizes of the measurement."""

from __future__ import annotations

from dataclasses import dataclass

STATE_TIME = 0.25  # s that the paper's cloth has fallen where it is timed; it touches no sphere yet
CONTACT_TIME = 0.6  # s, where it lies on the sphere
STATE_DT = 1e-4  # s
BATCH = 64
BATCH_OF_FEW = 3
BATCH_LONGER = 8
"""A window of the batch is so many times longer than others, and there are as many times fewer."""
IN_TURN = 1024
"""Rows of the largest grid whose works take turns: a state for each of them fits into memory."""
SECTIONS = ("limits", "steps", "features", "batch", "grids", "frames", "calls", "accuracy")


@dataclass(frozen=True)
class Settings:
    """Sizes of a run of the bench.

    Parameters
    ----------
    windows : int
        Windows per figure.
    seconds : float
        Length of a window [s]; a window has a step at least.
    large_windows : int
        Windows per figure on grids larger than `IN_TURN`, which are timed one after the other.
    error_steps : int
        Steps of 5 us after which the error of the paper's cloth in free fall is taken. For grids up
        to 256 x 256 it is taken after 20 steps.
    sizes : tuple of int
        Rows (= columns) of the grids.
    numba_sizes : tuple of int
        Grids at which the strong numba kernel is timed too (each is a compilation).
    numba_parallel : bool
        Whether the strong numba kernel is timed on several threads and on the batch too (each is a
        compilation).
    reference_dt : float
        Time step [s] of the solution against which the accuracy of dt = 1e-4 s is taken.
    """

    windows: int = 40
    seconds: float = 4e-3
    large_windows: int = 7
    error_steps: int = 1000
    sizes: tuple[int, ...] = (8, 16, 32, 64, 100, 128, 256, 512, 1024, 2048)
    numba_sizes: tuple[int, ...] = (1024,)
    numba_parallel: bool = True
    reference_dt: float = 1e-5


NORMAL = Settings()
QUICK = Settings(
    windows=8,
    seconds=2e-3,
    large_windows=3,
    error_steps=200,
    sizes=(8, 32, 64, 256, 1024),
    numba_sizes=(),
    numba_parallel=False,
    reference_dt=2e-5,
)
FULL = Settings(windows=100, large_windows=11, sizes=(*NORMAL.sizes, 4096))
