"""Pictures of a state: `picture` of a scene, `picture_of_run` of a stored frame."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..base import Floats, check, files
from ..base.build import available_thread_count
from ..base.extras import import_from_extra
from ..engine.state import check_start_time
from ..model.scene import Scene
from ..run.result import greatest_depths
from .camera import (
    Camera,
    extremes_along_axes,
    eye_position,
    is_wide,
    make_camera,
    nearest_place_on_plane,
)
from .label import LEAST_WIDTH, Pixels, add_label
from .raster import CLOTH_FRONT, DARK_SPHERE, GROUND, PIN, SPHERE, Ball, Plane, render
from .scale import make_scale, point_values

WIDEST = 8192  # pixels; a square picture of this width takes 200 MB
PIN_SIZE = 0.013  # radius of a drawn pin, as a part of the cloth's longer side
GROUND_REACH = 1.5  # radius of the ground, as a part of the diagonal of all that is drawn
PLANE_REACH = 2.0  # radius of a plane of the scene, in widths of the view
GROUND_GAP = 0.02  # of that diagonal, below the lowest place; at 0 a flat sheet lies on its ground
WIDTH = 640  # pixels; fits beside the text of a page or notebook
BAND = 1 << 20  # bytes of a PNG that are packed between two checks for Ctrl-C: 30 ms


class Style(NamedTuple):
    """The arguments of `clothsim.picture` that say how a state is drawn."""

    camera: Any = None
    width: int = WIDTH
    color: Any = "faces"
    limits: Any = None
    label: bool = False
    ground: bool = True


class Drawing:
    """Pictures of the states x, v at times t, arrays of shape (frames, rows, columns, 3) and
    (frames,); `v` may be None.

    All share one view, one ground and one colour scale.
    """

    def __init__(self, scene: Any, x: Floats, v: Floats | None, t: Floats, style: Style) -> None:
        self.scene = scene
        self.x = x
        self.t = t
        self.width = check.integer("width", style.width, minimum=16, maximum=WIDEST)
        self.label = check.boolean("label", style.label)
        if self.label and self.width < LEAST_WIDTH:
            raise ValueError(
                f"width must be at least {LEAST_WIDTH} with label=True, got {style.width}"
            )
        self.shadow = check.boolean("ground", style.ground)
        self.planes = _make_ground(scene, x, t) if self.shadow else []
        self.camera: Camera = make_camera(style.camera, scene, x, t)
        height = self.width * self.camera.height / self.camera.width
        if not height <= WIDEST:
            raise ValueError(
                f"camera must be at most {WIDEST / self.width:.3g} times as tall as wide with "
                f"width={self.width}, which are {WIDEST} pixels, got height "
                f"{self.camera.height:g} m and width {self.camera.width:g} m"
            )
        self.values = point_values(style.color, scene, x, v)
        self.by_depth = isinstance(style.color, str) and style.color == "depth"
        shown = greatest_depths(scene.spheres, x, t)["triangles"] if self.by_depth else self.values
        if shown is None and style.limits is not None:
            raise ValueError(
                f'limits must be None with color="faces", got {check.value_text(style.limits)}'
            )
        self.scale = None if shown is None else make_scale(style.color, shown, style.limits)

    def pixels(self, k: int) -> Pixels:
        """Return the picture of frame `k`, shape (height, width, 3)."""
        x = self.x[k]
        t = float(self.t[k])
        cloth = self.scene.cloth
        size = PIN_SIZE * max(cloth.size)
        centers = [s.center_at(t) for s in self.scene.spheres]
        eye = eye_position(self.camera, self.scene)
        balls = [
            Ball(center, s.radius, DARK_SPHERE if self.by_depth else SPHERE)
            for s, center in zip(self.scene.spheres, centers)
            if np.linalg.norm(eye - center) >= s.radius  # else the eye is inside
        ]
        balls += [Ball(point, size, PIN, solid=False) for point in x[cloth.pinned]]
        shade = DARK_SPHERE if self.by_depth else GROUND
        walls = [
            Plane(
                nearest_place_on_plane(s, self.camera.target, t),
                PLANE_REACH * self.camera.width,
                s.unit_normal,
                shade,
                solid=True,
                node=center,
            )
            for s, center in zip(self.scene.spheres, centers, strict=True)
            if np.isinf(s.radius)
        ]
        colors = (
            None if self.scale is None or self.values is None else self.scale.colors(self.values[k])
        )
        if min(cloth.shape) < 2:  # a single row has no surface: its mass points are shown
            shades = np.broadcast_to(CLOTH_FRONT, x.shape) if colors is None else colors
            free = ~cloth.pinned
            balls += [
                Ball(point, size, shade, solid=False) for point, shade in zip(x[free], shades[free])
            ]
        drawn = render(
            x,
            balls,
            self.camera,
            self.width,
            colors=colors,
            depth=self.scale if self.by_depth else None,
            planes=[*self.planes, *walls],
            shadow=self.shadow,
            threads=available_thread_count(),
        )
        if not self.label:
            return drawn
        note = "as printed" if any(sphere.as_printed for sphere in self.scene.spheres) else ""
        return add_label(drawn, t, self.width / self.camera.width, self.scale, note)


def _make_ground(scene: Any, x: Floats, t: Floats) -> list[Plane]:
    """Return a ground below all that is framed; none where a wide sphere is ground or wall."""
    if any(is_wide(sphere, scene) for sphere in scene.spheres):
        return []
    low, high = extremes_along_axes(scene, x, t, np.eye(3))
    size = float(np.linalg.norm(high - low))
    return [
        Plane(
            ((low[0] + high[0]) / 2, low[1] - GROUND_GAP * size, (low[2] + high[2]) / 2),
            GROUND_REACH * size,
        )
    ]


class Picture:
    """An RGB picture that a notebook shows, and that saves itself.

    Attributes
    ----------
    pixels : numpy.ndarray
        uint8, shape (height, width, 3), read-only. `numpy.asarray(picture)` gives them as well.

    Examples
    --------
    >>> cs.picture(cs.scenes.paper_static(), width=200).pixels.dtype
    dtype('uint8')
    """

    def __init__(self, pixels: Pixels) -> None:
        self.pixels = np.array(pixels, order="C")
        self.pixels.flags.writeable = False

    def save(self, path: str | Path) -> Path:
        """Write the picture to a file and return its path.

        Parameters
        ----------
        path : path-like
            ".png" needs no package; other formats need Pillow (extra "plot").

        Examples
        --------
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     cs.picture(cs.scenes.paper_static(), width=64).save(folder + "/cloth.png").name
        'cloth.png'
        """
        path = check_file_path("path", path)
        if path.suffix.lower() == ".png":
            files.write_bytes(path, self._repr_png_())
        else:
            image = import_from_extra(
                "PIL.Image", f"a picture as {path.suffix or 'no format'!r}", "plot"
            )
            if path.suffix.lower() not in image.registered_extensions():
                raise ValueError(
                    "path must end in .png or in another suffix that Pillow knows, got "
                    f"{str(path)!r}"
                )
            with files.replace_when_complete(path) as part:
                image.fromarray(self.pixels).save(part)
        return path

    def _repr_png_(self) -> bytes:
        """Return the PNG file (ISO/IEC 15948)."""
        height, width, _ = self.pixels.shape
        chunks = (
            (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
            (b"IDAT", b"".join(_compress_rows(self.pixels.reshape(height, 3 * width)))),
            (b"IEND", b""),
        )
        packed = (
            struct.pack(">I", len(d)) + kind + d + struct.pack(">I", zlib.crc32(kind + d))
            for kind, d in chunks
        )
        return b"\x89PNG\r\n\x1a\n" + b"".join(packed)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> npt.NDArray[Any]:
        pixels = self.pixels if dtype is None else self.pixels.astype(dtype)
        return pixels.copy() if copy else pixels

    def __repr__(self) -> str:
        height, width, _ = self.pixels.shape
        return f"<Picture of {width} x {height} pixels>"


def _compress_rows(rows: Pixels) -> Iterator[bytes]:
    """Return the stream of rows by the filter Sub, which packs pictures of a cloth 3 % better than
    a choice for each row.
    """
    packer = zlib.compressobj(6)
    band = max(1, BAND // rows.shape[1])
    for first in range(0, len(rows), band):
        lines = np.insert(rows[first : first + band], 0, 1, axis=1)  # 1: Sub
        lines[:, 4:] -= rows[first : first + band, :-3]  # modulo 256, as the standard says
        yield packer.compress(lines.tobytes())
    yield packer.flush()


def check_file_path(name: str, value: Any) -> Path:
    """Return `value` as the path of a file in a folder that is there."""
    path = check.path(name, value, "the path of a file")
    if not path.parent.is_dir():
        raise ValueError(f"{name} must be in an existing folder, got {str(path)!r}")
    return path


@check.check_names
def picture(
    scene: Scene,
    x: npt.ArrayLike | None = None,
    t: float | None = None,
    *,
    v: npt.ArrayLike | None = None,
    camera: Any = None,
    width: int = WIDTH,
    path: str | Path | None = None,
    color: Any = "faces",
    limits: tuple[float, float] | None = None,
    label: bool = False,
    ground: bool = True,
) -> Picture:
    """Draw a cloth and its spheres, with shadows and a ground. Cloth inside a sphere is red.

    The initially upper face of the cloth is blue, the lower one sand-coloured; spheres are grey.
    Where cloth lies under the surface of a sphere by more than 1e-5 of the picture's width, the
    surface is red, and stronger with depth up to 10 mm. Dark dots are pins.

    Parameters
    ----------
    scene : Scene
        Its spheres and pins are drawn.
    x : array_like, optional
        Positions [m], shape (rows, columns, 3). Default: the scene's initial positions.
    t : float, optional
        Time [s], which determines the places of moving spheres. Required where a sphere moves and
        `x` is given; else 0.
    v : array_like, optional
        Velocities [m/s], shape (rows, columns, 3), for ``color="speed"``.
    camera : Camera, str or sequence of 3 floats, optional
        A view, or the direction from the scene to the eye: a vector, or one of "corner", "front",
        "back", "left", "right", "top" and "below". A direction gives a view in perspective of the
        whole cloth, and of each sphere near it that is narrower than the cloth; a wider one is
        ground or wall. Default: "corner". A `Camera` without a distance is orthographic: lengths
        can be compared.
    width : int, default 640
        Pixels along the picture, 16 to 8192; its height follows from the view.
    path : path-like, optional
        File to write as well; see `Picture.save`.
    color : str or array_like, default "faces"
        Colours of the cloth: "faces", "stretch", "speed" or "depth", or a number for each mass
        point. "stretch" is l/L - 1 of the most stretched spring at a point, "depth" that of each
        place of the cloth below a sphere's surface. An array has shape (rows, columns).
    limits : (float, float), optional
        Ends of the colour scale, in SI units. Default: 0 and the 99th percentile; for "depth", 0
        and the greatest depth; for an array, its least and greatest number.
    label : bool, default False
        Add a strip below the picture: the time, a length, and the colour scale (Pillow, extra
        "plot"). ``>`` at the end of the scale means that some values are greater. A line above the
        scale says "as printed" if a sphere has that response. In perspective the length holds in
        the plane through the view's target. Requires `width` >= 320.
    ground : bool, default True
        Soft shadows, and a ground below all that the view frames if no sphere is as wide as the
        cloth.

    Returns
    -------
    Picture
        A notebook shows it; ``.pixels`` is its array, ``.save(path)`` writes it.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above; the message names it, what came and what is accepted.
    ImportError
        Without Pillow (extra "plot"), with `label`, or if `path` is no PNG file.

    Examples
    --------
    >>> scene = cs.scenes.paper_static()
    >>> front = cs.picture(scene, scene.initial_position, camera="front", width=320)
    >>> front.pixels.shape[1:]
    (320, 3)
    """
    check.instance("scene", scene, Scene)
    t = 0.0 if t is None and x is None else check_start_time(t, [scene])
    x = scene.initial_position if x is None else check.array("x", x, (*scene.cloth.shape, 3))
    v = None if v is None else check.array("v", v, (*scene.cloth.shape, 3))[None]
    path = None if path is None else check_file_path("path", path)
    style = Style(camera, width, color, limits, label, ground)
    return _draw_frame(Drawing(scene, x[None], v, np.array([t]), style), 0, path)


def picture_of_run(
    run: Any, frame: int | None, t: float | None, path: str | Path | None, **style: Any
) -> Picture:
    """Draw a frame, as `Run.picture` does. One camera and one colour scale hold all frames, so that
    pictures of a run can be compared.
    """
    count = len(run.t)
    if t is not None:
        if frame is not None:
            raise ValueError(f"frame must be None with t, got frame = {frame!r} and t = {t!r}")
        t = check.number("t", t, minimum=float(run.t[0]), maximum=float(run.t[-1]))
        frame = int(np.abs(run.t - t).argmin())
    k = (
        count - 1
        if frame is None
        else check.integer("frame", frame, minimum=-count, maximum=count - 1) % count
    )
    path = None if path is None else check_file_path("path", path)
    return _draw_frame(Drawing(run.scene, run.x, run.v, run.t, make_style(style)), k, path)


def make_style(arguments: Mapping[str, Any]) -> Style:
    """Return the style of `Run.picture` and `Run.animate`, of the names that it has."""
    check.refuse_unknown_arguments("picture", arguments, Style._fields)
    return Style(**arguments)


def _draw_frame(drawing: Drawing, k: int, path: Path | None) -> Picture:
    picture = Picture(drawing.pixels(k))
    if path is not None:
        picture.save(path)
    return picture
