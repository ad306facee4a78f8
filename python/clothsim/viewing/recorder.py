"""Recorded states of the live viewer, which become a `Run`."""

from __future__ import annotations

import math
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, cast

import numpy as np

from ..base import Floats
from ..measure.measures import energy, penetration
from ..model.motion import Keyframes
from ..model.scene import Scene
from ..run.result import Run
from ..typing import Report

MOST_BYTES = 500_000_000  # of a recording; it stops there


class Frame(NamedTuple):
    """A recorded state."""

    t: float  # [s]
    x: Floats
    v: Floats
    centers: Floats
    steps: int  # since the last reset


class Recorder:
    """The states of a recording, in `frames`; `on` while it goes on."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.on = False

    def add(self, frame: Frame) -> None:
        self.frames.append(frame)
        self.on = len(self.frames) * 2 * frame.x.nbytes <= MOST_BYTES

    def run(self, scene: Scene, options: dict[str, Any]) -> Run:
        """The recording with the present cloth of `scene`, and spheres along their recorded paths."""
        if len(self.frames) < 2:
            raise ValueError(f"a run needs 2 recorded frames, got {len(self.frames)}: switch on record first")
        t, x, v, centers, steps = (np.array(part) for part in zip(*self.frames))
        spheres = [
            sphere.replace(center=tuple(centers[0, k]), motion=Keyframes(t, centers[:, k]))
            for k, sphere in enumerate(scene.spheres)
        ]
        scene = scene.replace(spheres=spheres)
        depths: dict[str, Any] = {"points": 0.0, "triangles": 0.0, "reason": ""}
        for sphere in scene.spheres:
            for name, depth in penetration(x, sphere, t).items():
                depths[name] = max(depths[name], float(np.max(depth)))
        ends = {moment: energy(scene, x[k], v[k]) for moment, k in (("start", 0), ("end", -1))}
        gained = {"gained": math.nan, "reason": "the scene was changed while it was recorded"}
        report = {
            **options,
            "steps": int(steps[-1] - steps[0]),
            "stopped": "",
            "energy": {**ends, **gained},
            "penetration": depths,
            "recorded": True,
        }
        return Run(scene, t, x, v, cast(Report, report))


def file_of(run: Run, kind: str) -> bytes:
    """The content of a page ("html") or a file ("npz") of `run`."""
    with TemporaryDirectory() as folder:
        path = Path(folder, f"run.{kind}")
        (run.to_html if kind == "html" else run.save)(path)
        return path.read_bytes()
