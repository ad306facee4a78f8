"""The report, and the scenes simulated in the browser, as self-contained pages: nothing is fetched."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable, Iterable
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import clothsim as cs

from ..base.files import write_bytes
from . import published as paper
from .paper_report import Table, headline, number, tables


def write(report: dict[str, Any], folder: Path) -> None:
    """Write index.html into `folder`, which holds the report's pictures."""
    parts = [
        "<h1>The experiments of Kim et al., run by clothsim</h1>",
        f'<p class="origin">{"<br>".join(map(escape, headline(report)))}</p>',
        f"<p>{escape(paper.CITATION)}: what the paper reports, beside what the same scenes give "
        "here. The same numbers are in report.txt and report.json. "
        f'<a href="{report["live"]}">The scenes, live in the browser</a>, by the compute shader.</p>',
    ]
    if "overview" in report:
        parts.append(f'<div class="overview">{_image(folder, report["overview"], "")}</div>')
    if report["reductions"]:
        parts.append("<p>This is the short form of the reproduction:</p>")
        parts.append(_list(report["reductions"]))
    parts.append("<p>Each method is run in two variants:</p>")
    parts.append(_list(f"{name}: {meaning}" for name, meaning in paper.VARIANTS.items()))
    for key, experiment in report["experiments"].items():
        parts += _experiment(key, experiment, folder)
    _write_page(folder / "index.html", "clothsim: the experiments of Kim et al.", parts)


def _write_page(path: Path, title: str, parts: Iterable[str]) -> Path:
    style = (files(__package__) / "report.css").read_text(encoding="utf-8")
    page = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}</title>\n<style>\n{style}</style>\n</head>\n<body>\n{chr(10).join(parts)}\n</body>\n</html>\n"
    )
    return write_bytes(path, page.encode())


def _experiment(key: str, experiment: dict[str, Any], folder: Path) -> list[str]:
    parts = [
        f"<h2>Experiment {key}: {escape(experiment['title'])}</h2>",
        f"<p>{escape(experiment['setting'])}</p>",
        f'<div class="claim"><strong>The paper:</strong> {escape(experiment["paper"])}</div>',
    ]
    if experiment["notes"]:
        parts += ['<div class="notes">', _list(experiment["notes"]), "</div>"]
    if "cells" in experiment:
        parts.append(
            "<p>Blue: the cloth's upper face as it starts; sand: its lower face. "
            '<span class="red">Red</span>: the sphere\'s surface where cloth lies under it, '
            "stronger with depth. "
            f'<a href="{experiment["page"]}">Play this table</a>: all methods side by side, in step. '
            f'<a href="{experiment["live"]}">Simulate this scene in the browser</a>, by the compute shader.</p>'
        )
        parts += _cells(experiment, folder)
    parts += [_table(table) for table in tables(key, experiment)]
    if "plot" in experiment:
        plot = _image(folder, experiment["plot"], experiment["plot_caption"])
        parts.append(f"<figure>{plot}</figure>")
    return parts


def _cells(experiment: dict[str, Any], folder: Path) -> list[str]:
    parts = []
    for frame in experiment["frames"]:
        cells = [cell for cell in experiment["cells"] if cell["frame"] == frame]
        if not cells:
            continue
        parts.append(f"<h3>Frame {frame}, t = {cells[0]['time']:.2f} s</h3>")
        parts.append('<div class="cells">')
        for cell in cells:
            depth = number(1e3 * cell["penetration"]["triangles"])
            name = f"Method {cell['method']}, {cell['variant']}"
            caption = f"{name}, frame {frame}: {depth} mm deep"
            parts.append(f"<figure>{_image(folder, cell['picture'], caption)}</figure>")
        parts.append("</div>")
    return parts


def _image(folder: Path, name: str, caption: str) -> str:
    return image((folder / name).read_bytes(), caption, caption or "Cloth and sphere in the experiments below")


def image(png: bytes, caption: str, alt: str) -> str:
    """A picture within the page, and its caption if there is one."""
    data = b64encode(png).decode("ascii")
    below = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f'<img src="data:image/png;base64,{data}" alt="{escape(alt, quote=True)}">{below}'


def _list(entries: Iterable[str]) -> str:
    return "<ul>" + "".join(f"<li>{escape(entry)}</li>" for entry in entries) + "</ul>"


def _table(table: Table) -> str:
    head = "".join(f"<th>{escape(heading)}</th>" for heading in table.headings)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in table.rows)
    caption = f"<h3>{escape(table.caption)}</h3>" if table.caption else ""
    return f'{caption}<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _continuous() -> cs.Scene:
    scene = cs.scenes.paper_moving("continuous", offset="cell")
    return scene.replace(spheres=[sphere.replace(restitution=0.0) for sphere in scene.spheres])


SCENES: dict[str, tuple[str, Callable[[], cs.Scene]]] = {
    "live_static.html": ("Experiment 1: a static sphere", cs.scenes.paper_static),
    "live_moving.html": ("Experiment 2: a moving sphere", cs.scenes.paper_moving),
    "live_swing.html": ("Experiments 3 and 4: the cloth alone", cs.scenes.paper_swing),
    "live_continuous.html": ("Beyond the paper: the moving sphere, which keeps all triangles out", _continuous),
}
"""Title and scene of every page."""


def write_gallery(folder: str | Path) -> Path:
    """Write live.html, which leads to a live page of each of the paper's scenes, and these pages beside it.

    Parameters
    ----------
    folder : path-like
        An existing folder.

    Returns
    -------
    pathlib.Path
        live.html.

    Examples
    --------
    >>> import tempfile
    >>> from clothsim.paper import write_gallery
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_gallery(folder).name
    'live.html'
    """
    folder, figures = Path(folder), []
    for name, (title, make) in SCENES.items():
        scene = make()
        scene.to_live_html(folder / name, title=title)
        picture = cs.picture(scene, width=480)._repr_png_()
        figures.append(f'<figure><a href="{name}">{image(picture, title, "The scene at its start")}</a></figure>')
    parts = [
        "<h1>The scenes of Kim et al., live</h1>",
        "<p>Each page simulates one scene in your browser, by the compute shader, and makes no request. It needs WebGPU. "
        "Drag the sphere and the pinned points, and choose the method in the list.</p>",
        f'<div class="cells">{"".join(figures)}</div>',
    ]
    return _write_page(folder / "live.html", "clothsim: the scenes of Kim et al., live", parts)
