"""The distance of two runs, frame by frame."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..base import Floats, check
from ..base.services import find_service
from ..base.text import format_count
from .frames import NEGLIGIBLE
from .result import Run


class Difference(dict[str, Any]):
    """The distance of two runs, as `difference` returns it: a mapping that draws itself."""

    def __repr__(self) -> str:
        frames = format_count(len(self["t"]), "time")
        return (
            f"<Difference at {frames} to {self['t'][-1]:g} s, at the end rms "
            f"{self['rms'][-1]:.2g} m, largest {self['max'][-1]:.2g} m>"
        )

    def plot(self, ax: Any = None) -> Any:
        """Draw the largest and the root mean square distance over time, and return the axes.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Default: those of a new figure.

        Examples
        --------
        >>> a, b = (cs.simulate(cs.scenes.hanging(), 0.1, dt=dt, fps=50) for dt in (1e-3, 5e-4))
        >>> cs.difference(a, b).plot().get_ylabel()
        'distance of the mass points [m]'
        """
        return find_service("draw_difference")(self, ax)


@check.check_names
def difference(a: Run, b: Run) -> Difference:
    """Return the distance of the mass points of two runs at equal times.

    Only times that both runs have stored are compared, because interpolation has an error of its
    own. Give `fps` or `times` to `simulate` for equal times. Times are equal if they differ by at
    most half a step of either run.

    Parameters
    ----------
    a, b : Run
        Runs of cloths of one shape, as of one scene in two settings.

    Returns
    -------
    dict
        "t" [s], the times of `a` with an equal time in `b`, shape (times,); "distance" \\|x_a -
        x_b\\| [m], shape (times, rows, columns); its root mean square "rms" and its largest "max"
        [m] over the mass points, shape (times,); "unmatched", the number of frames of both runs
        that have no partner. Its method `plot` draws "rms" and "max".

    Raises
    ------
    ValueError, TypeError
        If the cloths differ in shape, or the runs have no stored time in common.

    Examples
    --------
    >>> a = cs.simulate(cs.scenes.paper_swing(), 0.1, dt=1e-3, fps=50)
    >>> b = cs.simulate(cs.scenes.paper_swing(), 0.1, dt=1e-4, fps=50)
    >>> apart = cs.difference(a, b)
    >>> apart["distance"].shape, bool(0 < apart["rms"][-1] < 1e-5)
    ((6, 32, 32), True)
    """
    for name, run in (("a", a), ("b", b)):
        check.instance(name, run, Run)
    if a.x.shape[1:] != b.x.shape[1:]:
        raise ValueError(
            f"b must be a run of a cloth of shape {a.scene.cloth.shape}, as a, got "
            f"{b.scene.cloth.shape}"
        )
    steps = [run.report["dt"] for run in (a, b) if "dt" in run.report]
    duration = max(a.t[-1] - a.t[0], b.t[-1] - b.t[0])
    tolerance = max(NEGLIGIBLE * duration, min(steps, default=0.0) / 2)
    nearest = _nearest_indices(a.t, b.t)
    partner = _nearest_indices(b.t, a.t)[nearest]
    equal = (np.abs(b.t[nearest] - a.t) <= tolerance) & (partner == np.arange(len(a)))
    if not equal.any():
        raise ValueError(
            f"b must have a stored time of a, which are {a.t[0]:g} to {a.t[-1]:g} s, got "
            f"{b.t[0]:g} to {b.t[-1]:g} s: give fps= or times= to simulate"
        )
    distance = np.array(
        [np.linalg.norm(a.x[k] - b.x[nearest[k]], axis=-1) for k in np.flatnonzero(equal)]
    )
    by_time = distance.reshape(len(distance), -1)
    return Difference(
        t=a.t[equal],
        distance=distance,
        rms=np.sqrt((by_time**2).mean(axis=1)),
        max=by_time.max(axis=1),
        unmatched=len(a) + len(b) - 2 * len(distance),
    )


def _nearest_indices(times: Floats, others: Floats) -> npt.NDArray[np.int64]:
    """Return the index of the nearest of the other times, for each time."""
    right = np.searchsorted(others, times).clip(max=len(others) - 1)
    left = (right - 1).clip(min=0)
    return np.where(np.abs(others[left] - times) < np.abs(others[right] - times), left, right)
