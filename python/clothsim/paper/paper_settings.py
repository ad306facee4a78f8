"""Settings of a reproduction: steps, frames, repeats."""

from __future__ import annotations

from dataclasses import dataclass

from clothsim.scenes import PAPER_DT


@dataclass(frozen=True)
class Settings:
    """Sizes of the experiments.

    Parameters
    ----------
    static_dt, moving_dt : float
        Integration step of experiments 1 and 2 [s].
    frame_dt : float
        Time between two frames [s]. `docs/reproduction.md` says why it is 1.6 ms.
    static_frames, moving_frames : tuple of int
        Frames that are measured and drawn.
    study_dts : tuple of float
        Coarser steps for repeats of experiment 1, which show the effect of the step [s]. The last is one step per
        frame.
    timing_dt : float
        Integration step of experiments 3 and 4 [s]. The cost of a step does not depend on it.
    runs : int
        Repeats of every timed run.
    windows : int
        Windows of `window_frames` frames in a timed run of experiment 3.
    window_frames : int
        Frames that one measurement of experiment 3 averages over.
    speedup_steps : int
        Steps in one measurement of experiment 4.
    speedup_seconds : float
        Wall time after which such a measurement ends early [s].
    comparison_part : float
        Part of its scenes' durations that experiment 5 runs.
    picture_width : int
        Pixels along a picture.
    """

    static_dt: float = PAPER_DT
    moving_dt: float = PAPER_DT
    frame_dt: float = 1.6e-3
    static_frames: tuple[int, ...] = (150, 500, 800)
    moving_frames: tuple[int, ...] = (200, 1300, 3100)
    study_dts: tuple[float, ...] = (1e-4, 4e-4, 1.6e-3)
    timing_dt: float = PAPER_DT
    runs: int = 10
    windows: int = 4
    window_frames: int = 200
    speedup_steps: int = 20_000
    speedup_seconds: float = 5.0
    comparison_part: float = 1.0
    picture_width: int = 520

    def steps_per_frame(self, dt: float) -> int:
        """Steps of `dt` that one frame takes."""
        steps = round(self.frame_dt / dt)
        if steps < 1 or abs(steps * dt - self.frame_dt) > 1e-9 * self.frame_dt:
            raise ValueError(
                f"frame_dt must be a whole number of steps, got frame_dt = {self.frame_dt!r} s and dt = {dt!r} s"
            )
        return steps


FULL = Settings()
QUICK = Settings(
    static_dt=2e-5,
    moving_dt=5e-5,
    timing_dt=5e-5,
    runs=3,
    speedup_steps=1_000,
    speedup_seconds=1.0,
    comparison_part=0.4,
    picture_width=400,
)


def reductions(settings: Settings) -> list[str]:
    """The reductions of `settings` against the full reproduction, one line each; empty if there are none."""
    lines = []
    for experiment, dt in (("1", settings.static_dt), ("2", settings.moving_dt)):
        if dt != FULL.static_dt:
            lines.append(f"experiment {experiment} steps at {dt:g} s instead of the paper's {PAPER_DT:g} s")
    if settings.timing_dt != FULL.timing_dt:
        lines.append(
            f"experiments 3 and 4 time steps of {settings.timing_dt:g} s, so a window of frames "
            "holds fewer of them; frames/s are stated for the paper's step"
        )
    for name, what in (
        ("runs", "repeats of a timed run"),
        ("windows", "windows a run in experiment 3"),
        ("window_frames", "frames a window in experiment 3"),
        ("speedup_steps", "steps a run in experiment 4"),
        ("speedup_seconds", "seconds after which a run of experiment 4 ends early"),
        ("comparison_part", "part of its scenes' durations that experiment 5 runs"),
    ):
        if getattr(settings, name) < getattr(FULL, name):
            lines.append(f"{what}: {getattr(settings, name)} instead of {getattr(FULL, name)}")
    return lines
