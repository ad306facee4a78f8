"""Notebook output of a run or a scene: its lines and a picture, or the page itself.

Lines and picture are HTML without a script: JupyterLab and nbviewer show both, also where a
notebook is not trusted.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping
from html import escape
from typing import Any

from ..model.scene import Scene
from ..run.result import Run
from .picture import Picture, picture

WIDTH = 400  # pixels; beside the lines of a run in a notebook


def mime_bundle(text: str, picture: Picture) -> dict[str, Any]:
    """Return data by MIME type: HTML of text and picture, and the picture (for nbconvert)."""
    png = b64encode(picture._repr_png_()).decode("ascii")
    html = (
        '<div><pre style="display: inline-block; vertical-align: top; margin-right: 2em; '
        f'max-width: 100%; white-space: pre-wrap">{escape(text)}</pre>'
        '<img style="vertical-align: top; max-width: 100%" '
        f'width="{picture.pixels.shape[1]}" alt="cloth and obstacles" '
        f'src="data:image/png;base64,{png}"></div>'
    )
    return {"text/html": html, "image/png": png}


def run_bundle(run: Run) -> dict[str, Any]:
    """Return the `mime_bundle` of a run: its text and a picture of its last frame."""
    return mime_bundle(str(run), run.picture(width=WIDTH))


def runs_html(runs: Mapping[str, Run]) -> str:
    """Return the labels and pictures of the last frames, side by side."""
    cells = (
        mime_bundle(label, run.picture(width=WIDTH))["text/html"] for label, run in runs.items()
    )
    box = '<div style="display: inline-block; vertical-align: top"'
    boxes = (cell.replace("inline-block", "block").replace("<div", box) for cell in cells)
    return f"<div>{''.join(boxes)}</div>"


def scene_bundle(scene: Scene) -> dict[str, Any]:
    """Return the `mime_bundle` of a scene: an account of its work, and its initial state."""
    return mime_bundle(str(scene.explain()), picture(scene, width=WIDTH))


class Frame:
    """A page in a notebook: an iframe that holds all of it and may run scripts, nothing else."""

    def __init__(self, page: str, text: str, height: int) -> None:
        self.page = page
        self.text = text
        self.height = height

    def _repr_html_(self) -> str:
        return (
            '<iframe sandbox="allow-scripts allow-downloads" '
            f'srcdoc="{escape(self.page, quote=True)}" title="clothsim" '
            f'style="width: 100%; height: {self.height}px; border: 0"></iframe>'
        )

    def __repr__(self) -> str:
        return self.text
