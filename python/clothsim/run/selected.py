"""Parts of a run: some of its frames, one mass point, one frame as a mesh of another package."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ..base import Floats, check

if TYPE_CHECKING:
    from .result import Run


class SelectedRun:
    """Methods of `Run` that select frames and mass points."""

    t: Floats
    x: Floats
    v: Floats

    def __len__(self) -> int:
        """Number of stored frames."""
        return len(self.t)

    def __getitem__(self, frames: slice) -> Run:
        """A run of the frames in a slice, as ``run[10:20]`` or ``run[::2]``.

        The arrays are views of those of this run. The report stays that of the whole run. The part can be resumed if it
        has the last frame.
        """
        if not isinstance(frames, slice):
            raise TypeError(f"frames must be a slice, as in run[10:20], got {check.shown(frames)}")
        chosen = range(len(self))[frames]
        if not chosen or chosen.step < 0:
            raise ValueError(f"frames must be a rising slice of 0 to {len(self)} with a frame in it, got {frames}")
        run = cast("Run", self)
        final: dict[str, Any] = {} if chosen[-1] == len(self) - 1 else {"snapshot": None, "continuation": None}
        return replace(run, t=self.t[frames], x=self.x[frames], v=self.v[frames], **final)

    def at(self, row: int, column: int) -> dict[str, Floats]:
        """One mass point over the stored frames.

        Parameters
        ----------
        row, column : int
            Place of the mass point, negative from the end.

        Returns
        -------
        dict
            "t" [s], shape (frames,); "x" [m] and "v" [m/s], shape (frames, 3); "speed" `|v|` [m/s] and "stretch", shape
            (frames,). The stretch is l/L - 1 of the most stretched spring at the point, 0 where all are slack.

        Raises
        ------
        ValueError, TypeError
            If there is no such mass point.

        Examples
        --------
        >>> import clothsim as cs
        >>> run = cs.simulate(cs.scenes.paper_swing(), 0.1, dt=1e-3, fps=50)
        >>> corner = run.at(-1, -1)
        >>> corner["x"].shape, bool((corner["speed"][1:] > 0).all())
        ((6, 3), True)
        """
        run = cast("Run", self)
        rows, columns = run.scene.cloth.shape
        row = check.integer("row", row, minimum=-rows, maximum=rows - 1) % rows
        column = check.integer("column", column, minimum=-columns, maximum=columns - 1) % columns
        x, v = self.x[:, row, column], self.v[:, row, column]
        point, table = row * columns + column, run.scene.cloth.spring_table()
        here = table[(table["i"] == point) | (table["j"] == point)]
        other = np.where(here["i"] == point, here["j"], here["i"])
        lengths = np.linalg.norm(self.x.reshape(len(self), -1, 3)[:, other] - x[:, None], axis=-1)
        stretch = (lengths / here["rest_length"] - 1).max(axis=1, initial=0.0)
        return {"t": self.t, "x": x, "v": v, "speed": np.linalg.norm(v, axis=-1), "stretch": stretch}
