"""One self-contained page that plays runs: `Run.to_html`, `compare`.

The page uses WebGL directly. A snapshot of k3d shows only one scene, without curves and without
cloth inside a sphere in red. Everything is inside the file, and its content security policy forbids
requests. `pack_frames` says how frames are stored.
"""

from __future__ import annotations

import json
import zlib
from base64 import b64encode
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

import numpy as np

from ..base import Floats, check
from ..base.files import write_bytes
from ..model.cloth import Cloth
from ..model.obstacle import RESPONSES, Plane, Sphere
from ..model.ready import hanging, oscillator, paper_moving, paper_static, paper_swing
from ..model.scene import Scene
from ..run.difference import Difference
from ..run.difference import difference as difference_of
from ..run.result import Run
from . import raster
from .camera import DIRECTIONS, Camera, distance_to_extremes, make_camera
from .label import add_title
from .notebook import Frame, runs_html
from .picture import PIN_SIZE, Picture, check_file_path, picture
from .plots.run import curves_over_frames
from .plots.style import COLORS
from .scale import HEAT, TOP_PART, VIRIDIS, point_stretch

# Times the narrowest view of the runs of a page. A cloth that was thrown off is wider; at twice it
# makes others small, at half two scenes of different size do not both fit.
WIDER = 2.5
MOST_RUNS = 8  # a browser keeps 16 canvases of WebGL alive, and eight panels fill a screen
FLAT = 1e6  # radius of the sphere that stands for a plane, in longer sides of the cloth
MOST_SPHERES = 100  # whose depths a fragment shader compares; WebGL 2 warrants room for 112
POSTER_WIDTH = 400  # pixels of the picture shown where scripts or WebGL are missing
LEVELS = 65535
SHORTEST = 4.0  # s; a run that is over sooner is shown slowed down
SPEEDS = (1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1, 2, 4)
VIEWS = ("corner", "front", "right", "top")
TURNED_BY = "On a focused cloth shift and arrows turn, plus and minus enlarge, 0 goes back."
HELP = (
    "Drag turns, wheel or pinch enlarges, a click shows the values of a mass point, space "
    "plays, arrows step."
)
SHADING = {
    "front": raster.CLOTH_FRONT.tolist(),
    "back": raster.CLOTH_BACK.tolist(),
    "sphere": raster.SPHERE.tolist(),
    "pin": raster.PIN.tolist(),
    "red": raster.PENETRATION.tolist(),
    "leastRed": raster.LEAST_RED,
    "fullRedDepth": raster.FULL_RED_DEPTH,
    "key": raster.KEY.tolist(),
    "colors": COLORS,
    "light": raster.LIGHT,
    "viridis": VIRIDIS,
    "heat": HEAT,
    "darkSphere": raster.DARK_SPHERE.tolist(),
    "planeCell": raster.PLANE_CELL,
    "planeLine": raster.PLANE_LINE,
    "toneOfPlanes": raster.PLANE_TONE,
    "planeInShadow": raster.PLANE_IN_SHADOW,
    "lightSize": raster.LIGHT_SIZE,
}
"""Colours and lights of pictures, which the page draws with."""


class Comparison:
    """Runs side by side with a common clock; `compare` makes it. `runs` maps labels to runs."""

    def __init__(self, runs: Mapping[str, Run], difference: bool = False) -> None:
        self.runs = dict(runs)
        self.difference = difference
        self._distances = _differences_to_first(self.runs) if difference else []

    def to_html(self, path: str | Path, *, title: str | None = None) -> Path:
        """Write one self-contained page that plays the runs side by side, with one slider and their
        curves below.

        docs/look.md shows its controls. `title` is the heading, by default the labels. Rounding and
        errors are those of `Run.to_html`.
        """
        path = check_file_path("path", path)
        title = " and ".join(self.runs) if title is None else check.instance("title", title, str)
        return write_bytes(path, self._page_html(title).encode())

    def show(self, height: int = 600) -> Frame:
        """Return the page for a notebook cell; `height` is 300 to 4000 pixels."""
        title = " and ".join(self.runs)
        height = check.integer("height", height, minimum=300, maximum=4000)
        return Frame(self._page_html(title), f"<{title}, to be played in a notebook>", height)

    def picture(
        self, t: float | None = None, path: str | Path | None = None, **style: Any
    ) -> Picture:
        """Draw the runs side by side, in one view: the stored frames nearest to the time `t` [s],
        by default the last ones.

        A run that is shorter shows its last frame. Of several runs, each has its label above
        (Pillow, extra "plot"). `path` is a file to write as well, `style` are further arguments of
        `Run.picture`.
        """
        path = None if path is None else check_file_path("path", path)
        cameras = [make_camera(None, run.scene, run.x, run.t) for run in self.runs.values()]
        style = {"camera": common_camera(cameras), **style}
        times = (None if t is None else min(t, float(run.t[-1])) for run in self.runs.values())
        images = [run.picture(t=t, **style).pixels for run, t in zip(self.runs.values(), times)]
        height = max(map(len, images))  # the label of a run "as printed" has a further line
        padded = [
            np.pad(image, ((0, height - len(image)), (0, 0), (0, 0)), constant_values=255)
            for image in images
        ]
        if len(padded) > 1:
            padded = [
                add_title(image, label) for image, label in zip(padded, self.runs, strict=True)
            ]
        joined = Picture(np.concatenate(padded, axis=1))
        if path is not None:
            joined.save(path)
        return joined

    def _page_html(self, title: str) -> str:
        return page_text(title, page_body(title, self.runs, self._distances))

    def _repr_html_(self) -> str:
        return runs_html(self.runs)

    def __repr__(self) -> str:
        return f"<Comparison of {', '.join(map(repr, self.runs))}>"


@check.check_names
def compare(runs: Mapping[str, Run], *, difference: bool = False) -> Comparison:
    r"""Put runs side by side, to play them with a common clock.

    Parameters
    ----------
    runs : mapping of str to Run
        Label -> run, 1 to 8 of them. Scenes and stored times may differ.
    difference : bool, default False
        Whether the page also shows the distance \|x - x_first\| to the first run, as a colour and
        as a curve of its root mean square. It requires cloths of one shape, and that the first run
        has stored all times of the others.

    Returns
    -------
    Comparison
        Its ``to_html(path)`` writes the page, ``picture(t=)`` draws the runs, ``show()`` plays them
        in a notebook.

    See Also
    --------
    clothsim.difference : the distance of two runs as numbers.

    Examples
    --------
    >>> scenes = {name: cs.scenes.paper_static(name) for name in ("reflect", "ray")}
    >>> runs = {name: cs.simulate(scenes[name], 0.1, dt=1e-3, every=5) for name in scenes}
    >>> cs.compare(runs)
    <Comparison of 'reflect', 'ray'>
    """
    difference = check.boolean("difference", difference)
    accepted = f"runs must be a mapping of 1 to {MOST_RUNS} labels to runs"
    if not isinstance(runs, Mapping):
        raise TypeError(f"{accepted}, got {type(runs).__name__}")
    if not 1 <= len(runs) <= MOST_RUNS:
        raise ValueError(f"{accepted}, got {len(runs)}")
    for label, run in runs.items():
        check.instance("a label of runs", label, str)
        check.instance(f"runs[{label!r}]", run, Run)
    return Comparison(runs, difference)


def _differences_to_first(runs: Mapping[str, Run]) -> list[Difference]:
    """Return the differences of the further runs to the first, at all their times."""
    (first, base), *others = runs.items()
    if not others:
        raise ValueError(
            f"difference must be False unless there are two runs at least, got {first!r} alone"
        )
    distances = [difference_of(base, run) for _, run in others]
    for (label, run), distance in zip(others, distances, strict=True):
        if len(distance["t"]) < len(run):
            raise ValueError(
                f"difference=True needs times of {label!r} that {first!r} has stored too, got "
                f"{len(distance['t'])} of {len(run)}: give fps= or times= to simulate"
            )
    return distances


def _title_of_scene(scene: Scene) -> str:
    """Return the name of a ready scene, or what the scene has."""
    responses = ", ".join(dict.fromkeys(sphere.response for sphere in scene.spheres))
    ready = {
        f"{f.__name__}, {responses}": f(responses)
        for f in (paper_static, paper_moving)
        if responses in RESPONSES
    }
    ready |= {f.__name__: f() for f in (paper_swing, hanging, oscillator)}
    rows, columns = scene.cloth.shape
    other = f"Cloth of {rows} x {columns} points" + (f", response {responses}" if responses else "")
    return next((name for name, candidate in ready.items() if candidate == scene), other)


def comparison_of(run: Run, title: str | None = None) -> Comparison:
    """Return a comparison of one run, labelled with its page's title, for `Run.to_html` and
    `Run.show`.
    """
    return Comparison(
        {_title_of_scene(run.scene) if title is None else check.instance("title", title, str): run}
    )


def page_body(
    title: str, runs: Mapping[str, Run], distances: Sequence[Mapping[str, Any]] = (), more: str = ""
) -> str:
    """Return the body of a page that plays runs, with `more` below its controls; `distances` are
    those of `_differences_to_first`.
    """
    cameras = [make_camera(None, run.scene, run.x, run.t) for run in runs.values()]
    meta, data = _settings_and_frames(runs, cameras, distances)
    posters = [
        poster_html(r.scene, r.x[-1], float(r.t[-1]), camera)
        for r, camera in zip(runs.values(), cameras, strict=True)
    ]
    panels = "".join(
        f'<figure class="run"><figcaption><span id="key-{k}"></span> '
        f"<b>{escape(label) if len(runs) > 1 else ''}</b> "
        f'<span id="says-{k}"></span>'
        f'</figcaption><div class="stage">{posters[k]}<canvas id="canvas-{k}" '
        f'tabindex="0" role="application" aria-label="{_names_of_bodies([runs[label].scene])} of '
        f'{escape(label or title)}. {TURNED_BY}">'
        "</canvas></div></figure>"
        for k, label in enumerate(runs)
    )
    size = len(runs) if len(runs) <= 4 else MOST_RUNS
    return (
        f"<header><h1>{escape(title)}</h1>{_view_buttons_html()}</header>\n"
        f'<p id="problem" hidden></p>\n<div id="runs" class="of-{size}">{panels}</div>\n'
        f"{_controls_html(meta, runs)}{_note_of_missing_frames(runs)}{more}"
        f'<div id="curves"></div>\n{_help_html(meta, runs)}\n'
        f"{data}"
        f'<script type="application/json" id="meta">{json_for_script(meta)}</script>\n'
    )


def page_text(title: str, body: str, scripts_after: str = "") -> str:
    """Return a self-contained page that makes no request; `scripts_after` follow its scripts."""
    code = "\n".join(map(read_web_file, ("draw.js", "orbit.js", "charts.js", "page.js")))
    shading = json_for_script(SHADING)
    style = read_web_file("page.css")
    return fill_web_file(
        "frame.html",
        title=escape(title),
        style=style,
        body=body,
        shading=shading,
        code=code,
        after=scripts_after,
    )


def read_web_file(name: str) -> str:
    """Return the text of a file of web/."""
    return (files(__package__) / "web" / name).read_text(encoding="utf-8")


def fill_web_file(name: str, **values: str) -> str:
    """Return a file of web/ with its $names replaced."""
    return Template(read_web_file(name)).substitute(values)


def _controls_html(meta: Mapping[str, Any], runs: Mapping[str, Run]) -> str:
    duration = max(float(run.t[-1] - run.t[0]) for run in runs.values())
    usual = max(s for s in SPEEDS if s <= max(min(1.0, duration / SHORTEST), SPEEDS[0]))
    speeds = "".join(
        "<option "
        f'value="{s}"{" selected" if s == usual else ""}>{s if s >= 1 else f"1/{round(1 / s)}"} '
        "x</option>"
        for s in SPEEDS
    )
    below = " or ".join(_obstacle_kinds([run.scene for run in runs.values()]))
    texts = {"depth": f"depth below a {below}", "difference": f"difference to {next(iter(runs))}"}
    modes = "".join(
        f'<option value="{name}">{escape(texts.get(name, name))}</option>'
        for name in ("faces", "stretch", "speed", "depth", "difference")
        if name == "faces" or name in meta["tops"]
    )
    return fill_web_file("controls.html", speeds=speeds, modes=modes)


def _note_of_missing_frames(runs: Mapping[str, Run]) -> str:
    """Return a sentence where a run has no frames between the first and the last."""
    short = [label for label, run in runs.items() if len(run) <= 2]
    if not short:
        return ""
    return (
        f'<p id="few">Only the marked times are stored of {escape(", ".join(short))}, so '
        "nothing between them is shown: "
        "give fps=30 to simulate for a film.</p>\n"
    )


def _view_buttons_html() -> str:
    buttons = "".join(
        f'<button type="button" data-direction="{json.dumps(DIRECTIONS[name])}">{name}</button>'
        for name in VIEWS
    )
    return f'<span class="views">view {buttons}</span>'


def _obstacle_kinds(scenes: Sequence[Scene]) -> list[str]:
    """Return what cloth meets in the scenes: "sphere", "plane", both or nothing."""
    kinds = {obstacle._kind for scene in scenes for obstacle in scene.spheres}
    return sorted(kinds, reverse=True)


def _names_of_bodies(scenes: Sequence[Scene]) -> str:
    """Return what is drawn of scenes, in words."""
    *others, last = ["Cloth", *(f"{kind}s" for kind in _obstacle_kinds(scenes))]
    return f"{', '.join(others)} and {last}" if others else last


def _help_html(meta: Mapping[str, Any], runs: Mapping[str, Run]) -> str:
    below = " or ".join(_obstacle_kinds([run.scene for run in runs.values()]))
    red = f"Red: cloth below the surface of a {below}. " if "depth" in meta["tops"] else ""
    micron = 1e6 * max(run["precision"] for run in meta["runs"])
    return f'<p class="small">{HELP} {red}Positions are stored to {micron:.2g} um.</p>'


def _settings_and_frames(
    runs: Mapping[str, Run], cameras: list[Camera], distances: Sequence[Mapping[str, Any]]
) -> tuple[dict[str, Any], str]:
    """Return the settings of the page, and its script elements with the frames."""
    values = {"stretch": [point_stretch(run.scene, run.x) for run in runs.values()]}
    values["speed"] = [
        np.array([np.linalg.norm(v, axis=-1).ravel() for v in run.v]) for run in runs.values()
    ]
    lines = [curves_over_frames(run) for run in runs.values()]
    if distances:
        distances_of_runs = [d["distance"].reshape(len(d["t"]), -1) for d in distances]
        values["difference"] = [np.zeros_like(values["speed"][0]), *distances_of_runs]
        for line, distance in zip(lines[1:], distances, strict=True):
            line["difference"] = distance["rms"]
    ends = {"max": 1.0, "top": TOP_PART}
    tops = {
        name: {
            end: max(float(np.quantile(numbers, part)) for numbers in each)
            for end, part in ends.items()
        }
        for name, each in values.items()
    }
    if 0 < max(len(run.scene.spheres) for run in runs.values()) <= MOST_SPHERES:
        deepest = max(float(line["triangles"].max()) for line in lines if "triangles" in line)
        tops["depth"] = {"max": deepest or 1e-3}
    entries = []
    data = ""
    for k, (label, run) in enumerate(runs.items()):
        packed = pack_frames(
            run.x, [each[k] for each in values.values()], [tops[name]["max"] for name in values]
        )
        base64 = b64encode(packed.data).decode("ascii")
        data += f'<script type="application/octet-stream" id="data-{k}">{base64}</script>\n'
        cloth = run.scene.cloth
        spheres = [
            obstacle_settings(s, run.t if s.motion else run.t[:1], run.x[0], cloth)
            for s in run.scene.spheres
        ]
        entries.append(
            {
                "label": label,
                "data": f"data-{k}",
                "shape": cloth.shape,
                "t": _round_for_json(run.t, 9),
                "low": packed.low.tolist(),
                "step": packed.step.tolist(),
                "precision": packed.precision,
                "spheres": spheres,
                "pins": np.flatnonzero(cloth.pinned).tolist(),
                "dots": [] if min(cloth.shape) > 1 else np.flatnonzero(~cloth.pinned).tolist(),
                "dotSize": PIN_SIZE * max(cloth.size),
                "curves": {name: _round_for_json(values, 6) for name, values in lines[k].items()},
            }
        )
    return {
        "tops": tops,
        "names": list(values),
        "camera": _camera_settings(runs, cameras),
        "runs": entries,
    }, data


def common_camera(views: list[Camera]) -> Camera:
    """Return a view of all of `views`, except far wider ones, beside which the others would be
    small.
    """
    views = [view for view in views if view.width <= WIDER * min(view.width for view in views)]
    target = np.mean([view.target for view in views], axis=0)
    far = [2 * float(np.linalg.norm(view.target - target)) for view in views]
    width, height = (
        max(getattr(v, side) + d for v, d in zip(views, far)) for side in ("width", "height")
    )
    return Camera(
        DIRECTIONS["corner"], target, width, height, max(v.distance or 0.0 for v in views)
    )


def _camera_settings(runs: Mapping[str, Run], views: list[Camera]) -> dict[str, Any]:
    """Return the view of the page, and a distance from its target that holds all runs."""
    view = common_camera(views)
    far = 1.05 * max(
        distance_to_extremes(run.scene, run.x, run.t, np.array(view.target))
        for run in runs.values()
    )
    return {
        "direction": view.direction,
        "target": view.target,
        "reach": far,
        "width": view.width,
        "height": view.height,
    }


def poster_html(scene: Scene, x: np.ndarray, t: float, camera: Camera) -> str:
    """Return a state as a picture, for readers without scripts, WebGL or WebGPU."""
    png = picture(scene, x, t, camera=camera, width=POSTER_WIDTH)._repr_png_()
    return (
        f'<img alt="{_names_of_bodies([scene])} at t = {t:g} s" '
        f'src="data:image/png;base64,{b64encode(png).decode("ascii")}">'
    )


def _round_for_json(values: Any, digits: int) -> list[float | None]:
    """Return numbers for JSON; numbers that are not finite become null."""
    flat = np.asarray(values, float)
    return [float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in flat]


def json_for_script(meta: Mapping[str, Any]) -> str:
    """Return JSON for a script element."""
    # "</script>" in a label would end the element.
    return json.dumps(meta, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


class PackedFrames(NamedTuple):
    """`data` holds the frames; `low` and `step` [m] have one entry per axis."""

    data: bytes
    low: Floats
    step: Floats

    @property
    def precision(self) -> float:
        """Largest error of a stored coordinate [m]."""
        return float(self.step.max() / 2)


def pack_frames(x: Floats, scalars: list[Floats], tops: list[float]) -> PackedFrames:
    """Pack positions, shape (frames, rows, columns, 3), in 16 bits, and values, shape (frames,
    points), in 8 bits, deflated.

    Positions of a run are integers q, 0 to 65535, between its lowest and highest coordinate on each
    axis: x = low + step q. Second differences in time, q[k] - 2 q[k-1] + q[k-2], are small where a
    cloth moves smoothly. Their low bytes and high bytes are stored apart, which makes nearly all
    high bytes 0 and lets deflate remove them. A value is stored as the square root of value / top,
    in 255 levels: a scale that ends far below the top still has many colours.
    """
    frames = len(x)
    flat = x.reshape(frames, -1, 3)
    low = flat.min(axis=(0, 1))
    high = flat.max(axis=(0, 1))
    step = (high - low) / LEVELS
    # Frame by frame, and deflated piece by piece: Ctrl-C acts in between.
    zigzag = np.empty((frames, flat[0].size), np.uint16)
    last = rate = np.zeros(flat[0].size, np.int64)
    for k, points in enumerate(flat):
        q = np.round((points - low) / np.where(step > 0, step, 1.0)).astype(np.int64).T.reshape(-1)
        signed = (q - last - rate).astype(np.int16).astype(np.int32)  # modulo 65536, and back
        zigzag[k] = (signed << 1) ^ (signed >> 31)  # 0, -1, 1, -2, ... are 0, 1, 2, 3
        if k:
            rate = q - last
        last = q
    deflate = zlib.compressobj(6)
    data = [deflate.compress((codes & 255).astype(np.uint8).tobytes()) for codes in zigzag]
    data += [deflate.compress((codes >> 8).astype(np.uint8).tobytes()) for codes in zigzag]
    for values, top in zip(scalars, tops, strict=True):
        last_levels = np.zeros(values.shape[1:], np.uint8)
        for frame in values:
            levels = np.round(255 * np.sqrt(np.clip(frame / (top or 1.0), 0, 1))).astype(np.uint8)
            data.append(deflate.compress((levels - last_levels).tobytes()))
            last_levels = levels
    return PackedFrames(b"".join([*data, deflate.flush()]), low, step)


def obstacle_settings(sphere: Sphere | Plane, t: Floats, x: Floats, cloth: Cloth) -> dict[str, Any]:
    """Return a sphere of the page: radius and centres. A plane becomes a sphere so large that it
    looks flat below the cloth's start, with the directions of its grid's lines.
    """
    radius = sphere.radius
    centers = sphere.center_at(t)
    if not isinstance(sphere, Plane):
        return {"radius": radius, "centers": [_round_for_json(c, 15) for c in centers]}
    radius = FLAT * max(cloth.size)
    lines = raster.grid_directions(sphere.unit_normal)
    # By whole steps to the cloth's start, so that lines of the grid stay where they are.
    step = 10 * raster.PLANE_CELL
    way = lines @ (x.mean(axis=(0, 1)) - sphere.center_at(0.0))
    centers = centers + step * np.round(way / step) @ lines - radius * sphere.unit_normal
    return {
        "radius": radius,
        "centers": [_round_for_json(c, 15) for c in centers],
        "lines": [_round_for_json(line, 15) for line in lines],
    }
