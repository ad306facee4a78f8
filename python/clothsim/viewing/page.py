"""One self-contained page that plays runs: `Run.to_html`, `compare`.

The page is our own WebGL. A snapshot of k3d shows a single scene, without curves, and without red
where cloth is inside a sphere. Frames are packed (`packing`).

Everything is inside the file, and its content security policy forbids requests.
"""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from ..base import check
from ..base.files import write_bytes
from ..base.plots import COLORS
from ..base.progress import ProgressBar
from ..model.scene import Scene
from ..run.difference import difference as difference_of
from ..run.result import Run
from . import raster
from .camera import DIRECTIONS, Camera, camera_for, reach
from .chart import PARTS, curves
from .notebook import Frame, runs_html
from .packing import pack, point_stretch, tops_of
from .page_controls import TURNED_BY, controls, few, filled, small_print, views, web_file
from .picture import PIN_SIZE, file_path, picture

Advance = Callable[[int], object]

# Times the narrowest view of the runs of a page. A cloth that was thrown off is wider; at twice it makes others small, at
# half two scenes of different size do not both fit.
WIDER = 2.5
MOST_RUNS = 8  # a browser keeps 16 canvases of WebGL alive, and eight panels fill a screen
MOST_SPHERES = 100  # whose depths a fragment shader compares; WebGL 2 warrants room for 112
POSTER_WIDTH = 400  # pixels of the picture shown where scripts or WebGL are missing
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
}
"""Colours and lights of pictures, which the page draws with."""


class Comparison:
    """Runs side by side with a common clock; `compare` makes it.

    Attributes
    ----------
    runs : dict
        Label -> Run.
    difference : bool
        Whether the page shows the distance to the first run.
    """

    def __init__(self, runs: Mapping[str, Run], difference: bool = False) -> None:
        self.runs, self.difference = dict(runs), difference

    def to_html(self, path: str | Path, *, title: str | None = None) -> Path:
        """Write one self-contained page that plays the runs side by side, in step.

        One slider moves all runs through time; below, curves of energy, stretch, penetration and contacts have a cursor
        there. The page can be turned, moved and enlarged by mouse, fingers and keys. It colours the cloth by stretch,
        speed, depth below a sphere or distance to the first run, and makes no request. A click on the cloth shows the
        values of a mass point of all runs, and their curves.

        Positions are rounded to 1/65535 of the run's extent on each axis (15 um on 2 m). The square roots of stretch,
        speed and distance have 255 levels. A run that is shorter than another keeps its last frame.

        Parameters
        ----------
        path : path-like
            File to write.
        title : str, optional
            Heading of the page. Default: the labels.

        Returns
        -------
        pathlib.Path
            The file written.

        Raises
        ------
        ValueError, TypeError
            If an argument is not as above.
        """
        path = file_path("path", path)
        title = " and ".join(self.runs) if title is None else check.instance("title", title, str)
        return self._write(path, title)

    def _write(self, path: Path, title: str, progress: bool = False) -> Path:
        """Write the page; with `progress`, a bar counts frames."""
        # Every frame is measured, its springs are, and it is packed.
        frames = sum(len(run.t) for run in self.runs.values())
        with ProgressBar(progress, total=(PARTS + 2) * frames, unit="frame", desc="page") as bar:
            content = _page(title, self.runs, bar.advance, self.difference).encode()
        return write_bytes(path, content)

    def show(self, height: int = 600) -> Frame:
        """The page inside a notebook, to be played.

        Parameters
        ----------
        height : int, default 600
            Of the page in pixels, 300 to 4000.

        Returns
        -------
        Frame
        """
        height = check.integer("height", height, minimum=300, maximum=4000)
        page = _page(" and ".join(self.runs), self.runs, difference=self.difference)
        return Frame(page, f"{self!r}, to be played in a notebook", height)

    def _repr_html_(self) -> str:
        return runs_html(self.runs)

    def __repr__(self) -> str:
        return f"<Comparison of {', '.join(map(repr, self.runs))}>"


def compare(runs: Mapping[str, Run], *, difference: bool = False) -> Comparison:
    r"""Put runs side by side, to play them with a common clock.

    Parameters
    ----------
    runs : mapping of str to Run
        Label -> run, 1 to 8 of them. Scenes and stored times may differ.
    difference : bool, default False
        Whether the page also shows the distance \|x - x_first\| to the first run, as a colour and as a curve of its root
        mean square. Cloths have one shape then, and each time that a run has stored is one of the first run's.

    Returns
    -------
    Comparison
        Its ``to_html(path)`` writes the page, ``show()`` plays it in a notebook. There it also shows itself, as pictures.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.

    See Also
    --------
    clothsim.difference : the distance of two runs as numbers.

    Examples
    --------
    >>> import tempfile, clothsim as cs
    >>> runs = {
    ...     f"method {k}": cs.simulate(cs.scenes.paper_static(response), 0.1, dt=1e-3, every=5)
    ...     for k, response in ((1, "reflect"), (2, "ray"))
    ... }
    >>> both = cs.compare(runs)
    >>> both
    <Comparison of 'method 1', 'method 2'>
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     both.to_html(folder + "/both.html").stat().st_size < 1_000_000
    True
    """
    difference = check.boolean("difference", difference)
    accepted = f"a mapping of 1 to {MOST_RUNS} labels to runs"
    if not isinstance(runs, Mapping):
        raise TypeError(f"runs must be {accepted}, got {type(runs).__name__}")
    if not 1 <= len(runs) <= MOST_RUNS:
        raise ValueError(f"runs must be {accepted}, got {len(runs)}")
    for label, run in runs.items():
        if not isinstance(label, str) or not isinstance(run, Run):
            raise TypeError(f"runs must be {accepted}, got {label!r}: {type(run).__name__}")
        check.instance("a label of runs", label, str)
    if difference:
        _differences(runs)
    return Comparison(runs, difference)


def _differences(runs: Mapping[str, Run]) -> list[dict[str, Any]]:
    """The differences of the further runs to the first, at all their times."""
    (first, base), *others = runs.items()
    if not others:
        raise ValueError(f"difference must be False unless there are two runs at least, got {first!r} alone")
    found = [difference_of(base, run) for _, run in others]
    for (label, run), one in zip(others, found, strict=True):
        if len(one["t"]) < len(run):
            raise ValueError(
                f"difference=True needs times of {label!r} that {first!r} has stored too, got {len(one['t'])} of "
                f"{len(run)}: give fps= or times= to simulate"
            )
    return found


def _title_of(run: Run) -> str:
    rows, columns = run.scene.cloth.shape
    responses = ", ".join(dict.fromkeys(sphere.response for sphere in run.scene.spheres))
    response = f", response {responses}" if responses else ""
    return f"Cloth of {rows} x {columns} points{response}"


def run_to_html(run: Run, path: str | Path, title: str | None = None, progress: bool = False) -> Path:
    """`Run.to_html`; with `progress`, a bar counts frames."""
    title = _title_of(run) if title is None else check.instance("title", title, str)
    return Comparison({title: run})._write(file_path("path", path), title, progress)


def run_to_frame(run: Run, height: int) -> Frame:
    """`Run.show`."""
    height = check.integer("height", height, minimum=300, maximum=4000)
    title = _title_of(run)
    return Frame(_page(title, {title: run}), f"<{title}, to be played in a notebook>", height)


def _page(title: str, runs: Mapping[str, Run], advance: Advance = lambda _: None, difference: bool = False) -> str:
    cameras = [camera_for(None, run.scene, run.x, run.t) for run in runs.values()]
    meta, data = _contents(runs, cameras, advance, difference)
    posters = [poster(r.scene, r.x[-1], float(r.t[-1]), camera) for r, camera in zip(runs.values(), cameras, strict=True)]
    panels = "".join(
        f'<figure class="run"><figcaption><span id="key-{k}"></span> <b>{escape(label) if len(runs) > 1 else ""}</b> '
        f'<span id="says-{k}"></span>'
        f'</figcaption><div class="stage">{posters[k]}<canvas id="canvas-{k}" '
        f'tabindex="0" role="application" aria-label="Cloth and spheres of {escape(label or title)}. {TURNED_BY}">'
        "</canvas></div></figure>"
        for k, label in enumerate(runs)
    )
    size = len(runs) if len(runs) <= 4 else MOST_RUNS
    body = (
        f"<header><h1>{escape(title)}</h1>{views()}</header>\n"
        f'<p id="problem" hidden></p>\n<div id="runs" class="of-{size}">{panels}</div>\n'
        f"{controls(meta, runs)}{few(runs)}"
        f'<div id="curves"></div>\n<p class="small">{escape(small_print(meta))}</p>\n'
        f"{data}"
        f'<script type="application/json" id="meta">{json_text(meta)}</script>\n'
    )
    return page_text(title, body, ("draw.js", "orbit.js", "charts.js", "page.js"))


def page_text(title: str, body: str, scripts: Sequence[str]) -> str:
    """The text of a self-contained page that makes no request; `scripts` are files of web/."""
    code, style = "\n".join(map(web_file, scripts)), web_file("page.css")
    return filled("frame.html", title=escape(title), style=style, body=body, shading=json_text(SHADING), code=code)


def _contents(
    runs: Mapping[str, Run], cameras: list[Camera], advance: Advance, difference: bool
) -> tuple[dict[str, Any], str]:
    """Settings of the page, and its script elements with the frames."""
    values = {"stretch": [point_stretch(run.scene, run.x, advance) for run in runs.values()]}
    values["speed"] = [np.array([np.linalg.norm(v, axis=-1).ravel() for v in run.v]) for run in runs.values()]
    lines = [curves(run, advance) for run in runs.values()]
    if difference:
        found = _differences(runs)
        values["difference"] = [
            np.zeros_like(values["speed"][0]),
            *(one["distance"].reshape(len(one["t"]), -1) for one in found),
        ]
        for line, one in zip(lines[1:], found, strict=True):
            line["difference"] = one["rms"]
    tops = {name: tops_of(each) for name, each in values.items()}
    if 0 < max(len(run.scene.spheres) for run in runs.values()) <= MOST_SPHERES:
        deepest = max(float(line["triangles"].max()) for line in lines if "triangles" in line)
        tops["depth"] = {"max": deepest or 1e-3}
    entries, data = [], ""
    for k, (label, run) in enumerate(runs.items()):
        packed = pack(run.x, [each[k] for each in values.values()], [tops[name]["max"] for name in values])
        advance(len(run.t))
        base64 = b64encode(packed.data).decode("ascii")
        data += f'<script type="application/octet-stream" id="data-{k}">{base64}</script>\n'
        entries.append(
            {
                "label": label,
                "data": f"data-{k}",
                "shape": list(run.scene.cloth.shape),
                "t": _rounded(run.t, 9),
                "low": packed.low.tolist(),
                "step": packed.step.tolist(),
                "precision": packed.precision,
                "spheres": [
                    {
                        "radius": sphere.radius,
                        "centers": [_rounded(c, 15) for c in sphere.center_at(run.t if sphere.motion else run.t[:1])],
                    }
                    for sphere in run.scene.spheres
                ],
                "pins": np.flatnonzero(run.scene.cloth.pinned).tolist(),
                "dots": [] if min(run.scene.cloth.shape) > 1 else np.flatnonzero(~run.scene.cloth.pinned).tolist(),
                "dotSize": PIN_SIZE * max(run.scene.cloth.size),
                "curves": {name: _rounded(values, 6) for name, values in lines[k].items()},
            }
        )
    return {"tops": tops, "names": list(values), "camera": _camera(runs, cameras), "runs": entries}, data


def _camera(runs: Mapping[str, Run], views: list[Camera]) -> dict[str, Any]:
    """A view that contains all runs but those of far wider views, which would make the others small; and its depth."""
    views = [view for view in views if view.width <= WIDER * min(one.width for one in views)]
    target = np.mean([view.target for view in views], axis=0)
    far = [float(np.linalg.norm(view.target - target)) for view in views]
    return {
        "direction": list(DIRECTIONS["corner"]),
        "target": target.tolist(),
        "reach": 1.05 * max(reach(run.scene, run.x, run.t, target) for run in runs.values()),
        "width": max(v.width + 2 * d for v, d in zip(views, far, strict=True)),
        "height": max(v.height + 2 * d for v, d in zip(views, far, strict=True)),
    }


def poster(scene: Scene, x: np.ndarray, t: float, camera: Camera) -> str:
    """A state as a picture, for readers without scripts, WebGL or WebGPU."""
    png = picture(scene, x, t, camera=camera, width=POSTER_WIDTH)._repr_png_()
    return f'<img alt="Cloth and spheres at t = {t:g} s" src="data:image/png;base64,{b64encode(png).decode("ascii")}">'


def _rounded(values: Any, digits: int) -> list[float | None]:
    """Numbers for JSON; numbers that are not finite become null."""
    flat = np.asarray(values, float)
    return [float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in flat]


def json_text(meta: Mapping[str, Any]) -> str:
    """JSON for a script element."""
    # "</script>" in a label would end the element.
    return json.dumps(meta, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
