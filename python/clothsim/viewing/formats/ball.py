"""A unit sphere as a mesh, for formats without a sphere of their own."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from ..clip import Clip, Frame

_AROUND, _FROM_POLE_TO_POLE = 48, 24  # cells; off the true sphere by at most 0.5 % of the radius


def linear(color: npt.NDArray[np.float64]) -> tuple[float, float, float]:
    """An sRGB colour in linear light, as materials have it."""
    red, green, blue = np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4).tolist()
    return red, green, blue


@cache
def unit_ball() -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Vertices, which are also the normals, and triangles whose normals point outwards."""
    polar, around = np.meshgrid(
        np.linspace(0, np.pi, _FROM_POLE_TO_POLE + 1), np.linspace(0, 2 * np.pi, _AROUND + 1), indexing="ij"
    )
    vertices = np.stack([np.sin(polar) * np.sin(around), np.cos(polar), np.sin(polar) * np.cos(around)], -1)
    r, c = np.meshgrid(np.arange(_FROM_POLE_TO_POLE), np.arange(_AROUND), indexing="ij")
    corner = (r * (_AROUND + 1) + c).ravel()
    below, right = corner + _AROUND + 1, corner + 1
    upper = np.stack([corner, below, right], -1)[r.ravel() > 0]  # at a pole a cell is one triangle
    lower = np.stack([right, below, below + 1], -1)[r.ravel() < _FROM_POLE_TO_POLE - 1]
    return vertices.reshape(-1, 3), np.concatenate([upper, lower])


@dataclass(frozen=True)
class Body:
    """A mesh of one frame: the cloth, or a sphere."""

    name: str
    positions: npt.NDArray[np.float64]  # (points, 3) [m]
    corners: npt.NDArray[np.int64]  # (triangles, 3)
    normals: npt.NDArray[np.float64]
    uv: npt.NDArray[np.float64]  # texture coordinates, (points, 2)


def bodies(clip: Clip, frame: Frame) -> list[Body]:
    """The cloth, then the spheres at their places in that frame."""
    cloth = Body("cloth", frame.positions, clip.triangles, clip.normals(frame.positions), clip.uv)
    vertices, corners = unit_ball()
    return [
        cloth,
        *(
            Body(f"sphere_{k}", center + sphere.radius * vertices, corners, vertices, _ball_uv())
            for k, (sphere, center) in enumerate(zip(clip.spheres, frame.centers))
        ),
    ]


def _ball_uv() -> npt.NDArray[np.float64]:
    """Longitude and latitude, 0 to 1; v is 1 at the pole +y."""
    v, u = np.meshgrid(np.linspace(1, 0, _FROM_POLE_TO_POLE + 1), np.linspace(0, 1, _AROUND + 1), indexing="ij")
    return np.stack([u.ravel(), v.ravel()], -1)
