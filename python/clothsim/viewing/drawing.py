"""States of a scene as pictures of one view, one ground and one colour scale."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .. import _core
from ..base import check
from .camera import Camera, camera_for, extremes
from .lettering import LEAST_WIDTH, labelled
from .palette import scale_of, values_of
from .raster import CLOTH_FRONT, PIN, SPHERE, Ball, Ground, render

WIDEST = 8192  # pixels; a square picture of this width takes 200 MB
PIN_SIZE = 0.013  # radius of a drawn pin, as a part of the cloth's longer side
GROUND_REACH = 1.5  # radius of the ground, as a part of the diagonal of all that is drawn

Floats = npt.NDArray[np.float64]


class Style(NamedTuple):
    """The arguments of `clothsim.picture` that say how a state is drawn."""

    camera: Any = None
    width: int = 640
    color: Any = "faces"
    limits: Any = None
    label: bool = False
    shadow: bool = False
    ground: bool | float = False
    perspective: bool = False


class Drawing:
    """Pictures of the states x, v at times t, arrays of shape (frames, rows, columns, 3) and (frames,); `v` may be None."""

    def __init__(self, scene: Any, x: Floats, v: Floats | None, t: Floats, style: Style) -> None:
        self.scene, self.x, self.t = scene, x, t
        self.width = check.integer("width", style.width, minimum=16, maximum=WIDEST)
        self.label, self.shadow = check.boolean("label", style.label), check.boolean("shadow", style.shadow)
        if self.label and self.width < LEAST_WIDTH:
            raise ValueError(f"width must be at least {LEAST_WIDTH} with label=True, got {style.width}")
        self.ground: Ground | None = None
        if style.ground is not False:
            low, high = extremes(scene, x, t, np.eye(3))
            height = float(low[1]) if style.ground is True else check.number("ground", style.ground)
            middle = (low[0] + high[0]) / 2, height, (low[2] + high[2]) / 2
            self.ground = Ground(height, middle, GROUND_REACH * float(np.linalg.norm(high - low)))
        perspective = check.boolean("perspective", style.perspective)
        self.camera: Camera = camera_for(style.camera, scene, x, t, perspective=perspective)
        self.values = values_of(style.color, scene, x, v, t)
        if self.values is None and style.limits is not None:
            raise ValueError(f'limits must be None with color="faces", got {style.limits!r}')
        self.scale = None if self.values is None else scale_of(style.color, self.values, style.limits)

    def pixels(self, k: int) -> npt.NDArray[np.uint8]:
        """The picture of frame `k`, shape (height, width, 3)."""
        x, t, cloth = self.x[k], float(self.t[k]), self.scene.cloth
        size = PIN_SIZE * max(cloth.size)
        balls = [Ball(s.center_at(t), s.radius, SPHERE) for s in self.scene.spheres]
        balls += [Ball(point, size, PIN, solid=False) for point in x[cloth.pinned]]
        colors = None if self.scale is None or self.values is None else self.scale.colors(self.values[k])
        if min(cloth.shape) < 2:  # a single row has no surface: its mass points are shown
            shades = np.broadcast_to(CLOTH_FRONT, x.shape) if colors is None else colors
            free = ~cloth.pinned
            balls += [Ball(point, size, shade, solid=False) for point, shade in zip(x[free], shades[free])]
        threads = _core.available_threads()
        drawn = render(
            x, balls, self.camera, self.width, colors=colors, ground=self.ground, shadow=self.shadow, threads=threads
        )
        return labelled(drawn, t, self.width / self.camera.width, self.scale) if self.label else drawn
