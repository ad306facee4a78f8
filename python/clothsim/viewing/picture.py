"""Pictures of a state: `picture` of a scene, `picture_of_run` of a stored frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _core
from ..base import check, files
from ..base.extras import needed
from ..base.keywords import suggesting, suggests
from ..engine.arrays import start_time
from ..model.scene import Scene
from . import png
from .camera import Camera, camera_for
from .raster import CLOTH_FRONT, PIN, SPHERE, Ball, render

WIDTH = 640  # pixels; fits beside the text of a page or notebook
WIDEST = 8192  # pixels; a square picture of this width takes 200 MB
PIN_SIZE = 0.013  # radius of a drawn pin, as a part of the cloth's longer side


@suggesting
class Picture:
    """An RGB picture that a notebook shows, and that saves itself.

    Parameters
    ----------
    pixels : numpy.ndarray
        uint8, shape (height, width, 3).

    Attributes
    ----------
    pixels : numpy.ndarray
        The pixels, read-only. `numpy.asarray(picture)` gives them as well.

    Examples
    --------
    >>> import clothsim as cs
    >>> picture = cs.picture(cs.scenes.paper_static(), width=200)
    >>> picture
    <Picture of 200 x 141 pixels>
    >>> picture.pixels.dtype
    dtype('uint8')
    """

    def __init__(self, pixels: npt.NDArray[np.uint8]) -> None:
        given = np.asarray(pixels)
        if given.dtype != np.uint8 or given.ndim != 3 or given.shape[2] != 3 or not given.size:
            raise ValueError(
                f"pixels must be a uint8 array of shape (height, width, 3), got shape {given.shape} and dtype {given.dtype}"
            )
        self.pixels = np.array(given, order="C")
        self.pixels.flags.writeable = False

    def save(self, path: str | Path) -> Path:
        """Write the picture to a file.

        Parameters
        ----------
        path : path-like
            ".png" needs no package; other formats need Pillow (extra "plot").

        Returns
        -------
        pathlib.Path
            The file written.

        Raises
        ------
        ValueError
            If the folder is missing, or the suffix names no format.
        ImportError
            Without Pillow, for formats other than PNG.

        Examples
        --------
        >>> import tempfile, clothsim as cs
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     cs.picture(cs.scenes.paper_static(), width=64).save(folder + "/cloth.png").name
        'cloth.png'
        """
        path = file_path("path", path)
        if path.suffix.lower() == ".png":
            files.write_bytes(path, self._repr_png_())
        else:
            image = needed("PIL.Image", f"a picture as {path.suffix or 'no format'!r}", "plot")
            if path.suffix.lower() not in image.registered_extensions():
                raise ValueError(f"path must end in .png or in another suffix that Pillow knows, got {str(path)!r}")
            with files.replacing(path) as part:
                image.fromarray(self.pixels).save(part)
        return path

    def _repr_png_(self) -> bytes:
        return png.encode(self.pixels)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> npt.NDArray[Any]:
        pixels = self.pixels if dtype is None else self.pixels.astype(dtype)
        return pixels.copy() if copy else pixels

    def __repr__(self) -> str:
        height, width, _ = self.pixels.shape
        return f"<Picture of {width} x {height} pixels>"


def file_path(name: str, value: Any) -> Path:
    """`value` as the path of a file in a folder that is there."""
    try:
        path = Path(value)
    except TypeError:
        raise TypeError(f"{name} must be the path of a file, got {value!r}") from None
    if not path.parent.is_dir():
        raise ValueError(f"{name} must be in an existing folder, got {str(path)!r}")
    return path


@suggests
def picture(
    scene: Scene,
    x: npt.ArrayLike | None = None,
    t: float | None = None,
    *,
    camera: Any = None,
    width: int = WIDTH,
    path: str | Path | None = None,
) -> Picture:
    """Draw a cloth and its spheres, shaded and with exact depth. Cloth inside a sphere is red.

    The cloth's upper face, as it starts, is blue, its lower face sand, a sphere grey. Where cloth lies under the
    surface of a sphere, the surface is red, and stronger with depth up to 10 mm. Dark dots are pins. The view is
    orthographic.

    Parameters
    ----------
    scene : Scene
        Its spheres and pins are drawn.
    x : array_like, optional
        Positions [m], shape (rows, columns, 3). Default: the scene's initial positions.
    t : float, optional
        Time [s], which determines the places of moving spheres. Required where a sphere moves and `x` is given; else 0.
    camera : Camera, str or sequence of 3 floats, optional
        A view, or the direction from the scene to the eye: a vector, or one of "corner", "front",
        "back", "left", "right", "top" and "below". A direction gives a view of the whole cloth and all spheres.
        Default: "corner".
    width : int, default 640
        Pixels along the picture, 16 to 8192; its height follows from the view.
    path : path-like, optional
        File to write as well; see `Picture.save`.

    Returns
    -------
    Picture
        A notebook shows it; ``.pixels`` is its array, ``.save(path)`` writes it.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above; the message names it, what came and what is accepted.
    ImportError
        Without Pillow (extra "plot"), if `path` is no PNG file.

    Examples
    --------
    >>> import clothsim as cs
    >>> scene = cs.scenes.paper_static()
    >>> cs.picture(scene, scene.initial_position, camera="front", width=320).pixels.shape[1:]
    (320, 3)
    """
    if not isinstance(scene, Scene):
        raise TypeError(f"scene must be a Scene, got {check.shown(scene)}")
    t = 0.0 if t is None and x is None else start_time(t, [scene])
    x = scene.initial_position if x is None else check.points("x", x, scene.cloth.shape)
    width = check.integer("width", width, minimum=16, maximum=WIDEST)
    path = None if path is None else file_path("path", path)
    drawn = draw(scene, x, t, camera_for(camera, scene, x[None], [t]), width)
    if path is not None:
        drawn.save(path)
    return drawn


def draw(scene: Scene, x: npt.NDArray[np.float64], t: float, camera: Camera, width: int) -> Picture:
    """`picture` with a given camera; the arguments are checked."""
    size = PIN_SIZE * max(scene.cloth.size)
    balls = [Ball(s.center_at(t), s.radius, SPHERE) for s in scene.spheres]
    balls += [Ball(point, size, PIN, solid=False) for point in x[scene.cloth.pinned]]
    if min(scene.cloth.shape) < 2:  # a single row has no surface: its mass points are shown
        balls += [Ball(point, size, CLOTH_FRONT, solid=False) for point in x[~scene.cloth.pinned]]
    return Picture(render(x, balls, camera, width, threads=_core.available_threads()))


def frame_index(run: Any, frame: int | None, t: float | None) -> int:
    """The stored frame for `frame` or for the time `t`; by default the last frame."""
    count = len(run.t)
    if t is not None:
        if frame is not None:
            raise ValueError(f"frame must be None with t, got frame = {frame!r} and t = {t!r}")
        t = check.number("t", t, minimum=float(run.t[0]), maximum=float(run.t[-1]))
        return int(np.abs(run.t - t).argmin())
    if frame is None:
        return count - 1
    return check.integer("frame", frame, minimum=-count, maximum=count - 1) % count


def picture_of_run(
    run: Any, frame: int | None, t: float | None, path: str | Path | None, camera: Any, width: int
) -> Picture:
    """`Run.picture`. One camera contains all frames, so that pictures of a run can be compared."""
    k = frame_index(run, frame, t)
    camera = camera_for(camera, run.scene, run.x, run.t)
    return picture(run.scene, run.x[k], float(run.t[k]), camera=camera, width=width, path=path)
