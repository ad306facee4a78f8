"""Distance of two runs, mass point by mass point, at the times that both have stored."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..base import Floats, check
from .frames import NEGLIGIBLE
from .result import Run


def difference(a: Run, b: Run) -> dict[str, Any]:
    """Distance of the mass points of two runs at equal times, as for one scene in two settings.

    Only times that both runs have stored are compared, because interpolation has an error of its own. Give `fps` or
    `times` to `simulate` for equal times. Times are equal if they differ by at most half a step of either run.

    Parameters
    ----------
    a, b : Run
        Runs of cloths of one shape.

    Returns
    -------
    dict
        "t" [s], the times of `a` with an equal time in `b`, shape (times,); "distance" \\|x_a - x_b\\| [m], shape (times,
        rows, columns); its root mean square "rms" and its largest "max" [m] over the mass points, shape (times,);
        "unmatched", the number of frames of both runs that have no partner.

    Raises
    ------
    ValueError, TypeError
        If the cloths differ in shape, or the runs have no stored time in common.

    Examples
    --------
    >>> a, b = (cs.simulate(cs.scenes.paper_swing(), 0.1, dt=dt, fps=50) for dt in (1e-3, 1e-4))
    >>> found = cs.difference(a, b)
    >>> found["distance"].shape, bool(0 < found["rms"][-1] < 1e-5)
    ((6, 32, 32), True)
    """
    for name, run in (("a", a), ("b", b)):
        check.instance(name, run, Run)
    if a.x.shape[1:] != b.x.shape[1:]:
        raise ValueError(f"b must be a run of a cloth of shape {a.scene.cloth.shape}, as a, got {b.scene.cloth.shape}")
    steps = [run.report["dt"] for run in (a, b) if "dt" in run.report]
    near = max(NEGLIGIBLE * max(a.t[-1] - a.t[0], b.t[-1] - b.t[0]), min(steps, default=0.0) / 2)
    nearest = _nearest(a.t, b.t)
    back = _nearest(b.t, a.t)[nearest]
    equal = (np.abs(b.t[nearest] - a.t) <= near) & (back == np.arange(len(a)))
    if not equal.any():
        raise ValueError(
            f"b must have a stored time of a, which are {a.t[0]:g} to {a.t[-1]:g} s, got {b.t[0]:g} to {b.t[-1]:g} s: "
            "give fps= or times= to simulate"
        )
    distance = np.array([np.linalg.norm(a.x[k] - b.x[nearest[k]], axis=-1) for k in np.flatnonzero(equal)])
    by_time = distance.reshape(len(distance), -1)
    rms, most = np.sqrt((by_time**2).mean(axis=1)), by_time.max(axis=1)
    unmatched = len(a) + len(b) - 2 * len(distance)
    return {"t": a.t[equal], "distance": distance, "rms": rms, "max": most, "unmatched": unmatched}


def _nearest(times: Floats, others: Floats) -> npt.NDArray[np.int64]:
    """The index of the nearest of the other times, for each."""
    after = np.searchsorted(others, times).clip(max=len(others) - 1)
    before = (after - 1).clip(min=0)
    return np.where(np.abs(others[before] - times) < np.abs(others[after] - times), before, after)
