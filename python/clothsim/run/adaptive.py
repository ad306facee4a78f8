"""Error control: from the error that is asked for to a run that has it, and the estimate of it.

The request is for the rms error over the mass points at the end of the run: ``atol + rtol * size``.
The size is the longer side of the cloth.

The estimate is the distance of the run from a better run of the same scene. The better run takes
other steps, so it rounds otherwise, and the distance holds what rounding adds.

`refined` is the algorithm for dop853 in double, which "auto" takes. `named` is the algorithm for all
other methods.

After a contact no error is estimated.
"""

from __future__ import annotations

from ..base.interrupts import Interrupts
from ..model.scene import Scene
from .attempts import Attempts, Controlled
from .fixed_steps import RunOptions
from .frames import Schedule
from .named import compared, estimated
from .recording import Solution, Watch
from .refined import refined


def solve(
    scene: Scene,
    duration: float,
    asked: float,
    options: RunOptions,
    frames: Schedule,
    watch: Watch,
    plain: RunOptions | None = None,
) -> Controlled:
    """The run whose error is at most `asked` [m], rms, or the best one found; see `refined` for `plain`."""
    runs = Attempts(scene, duration, options, watch)
    try:
        if options.integrator == "dop853" and options.precision == "double":
            return refined(runs, asked, frames, plain)
        return compared(runs, asked, frames)
    except KeyboardInterrupt:
        with Interrupts():
            runs.hand_over()
        raise


def estimate_of(scene: Scene, duration: float, run: Solution) -> Controlled:
    """The error of a run that is done."""
    return estimated(Attempts(scene, duration, run.options, Watch()), run)
