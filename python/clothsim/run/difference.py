"""Distance of two runs, mass point by mass point, at the times that both have stored."""

from __future__ import annotations

import numpy as np

from ..base import Floats, check
from .frames import NEGLIGIBLE
from .result import Run


def difference(a: Run, b: Run) -> dict[str, Floats]:
    """Distance of the mass points of two runs at equal times, as for one scene in two settings.

    Only times that both runs have stored are compared, because interpolation has an error of its own. Give `fps` or
    `times` to `simulate` for equal times. Times are equal if they differ by less than 1e-9 of the longer run.

    Parameters
    ----------
    a, b : Run
        Runs of cloths of one shape.

    Returns
    -------
    dict
        "t" [s], the equal times, shape (times,); "distance" \\|x_a - x_b\\| [m], shape (times, rows, columns); its root
        mean square "rms" and its largest "max" [m] over the mass points, shape (times,).

    Raises
    ------
    ValueError, TypeError
        If the cloths differ in shape, or the runs have no equal time.

    Examples
    --------
    >>> import clothsim as cs
    >>> a, b = (cs.simulate(cs.scenes.paper_swing(), 0.1, dt=dt, fps=50) for dt in (1e-3, 1e-4))
    >>> found = cs.difference(a, b)
    >>> found["distance"].shape, bool(0 < found["rms"][-1] < 1e-5)
    ((6, 32, 32), True)
    """
    for name, run in (("a", a), ("b", b)):
        check.instance(name, run, Run)
    if a.x.shape[1:] != b.x.shape[1:]:
        raise ValueError(f"b must be a run of a cloth of shape {a.scene.cloth.shape}, as a, got {b.scene.cloth.shape}")
    near = NEGLIGIBLE * max(a.t[-1] - a.t[0], b.t[-1] - b.t[0])
    after = np.searchsorted(b.t, a.t).clip(max=len(b) - 1)
    before = (after - 1).clip(min=0)
    nearest = np.where(np.abs(b.t[before] - a.t) < np.abs(b.t[after] - a.t), before, after)
    equal = np.abs(b.t[nearest] - a.t) <= near
    if not equal.any():
        raise ValueError(
            f"b must have a stored time of a, which are {a.t[0]:g} to {a.t[-1]:g} s, got {b.t[0]:g} to {b.t[-1]:g} s: "
            "give fps= or times= to simulate"
        )
    distance = np.array([np.linalg.norm(a.x[k] - b.x[nearest[k]], axis=-1) for k in np.flatnonzero(equal)])
    by_time = distance.reshape(len(distance), -1)
    return {"t": a.t[equal], "distance": distance, "rms": np.sqrt((by_time**2).mean(axis=1)), "max": by_time.max(axis=1)}
