"""The paper's scenes, each simulated in the browser, and a page that leads to them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import clothsim as cs

from ..base.files import write_bytes
from .paper_page import STYLE, image


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
    page = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>clothsim: the scenes of Kim et al., live</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        "<h1>The scenes of Kim et al., live</h1>\n"
        "<p>Each page simulates one scene in your browser, by the compute shader, and makes no request. It needs WebGPU. "
        'Drag the sphere and the pinned points, and choose the method in the list.</p>\n<div class="cells">'
        f"{''.join(figures)}</div>\n</body>\n</html>\n"
    )
    return write_bytes(folder / "live.html", page.encode())
