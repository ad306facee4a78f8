"""Notebook output of a run or a scene: its lines and a picture, or the page itself.

Lines and picture are HTML without a script: JupyterLab and nbviewer show both, also where a notebook is not trusted.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping
from html import escape
from typing import Any

from ..measure.measures import energy, penetration
from ..methods.bound import limiting_term
from ..model.scene import Scene
from ..model.wording import cloth_text, counted, joules, quantity, spheres_text
from ..run.result import Run
from .picture import Picture, picture

WIDTH = 400  # pixels; beside six lines in a notebook


def bundle(text: str, picture: Picture) -> dict[str, Any]:
    """MIME types -> data: HTML of text and picture, and the picture alone (for nbconvert to PDF)."""
    png = b64encode(picture._repr_png_()).decode("ascii")
    html = (
        f'<div><pre style="display: inline-block; vertical-align: top; margin-right: 2em">{escape(text)}</pre>'
        f'<img style="vertical-align: top" width="{picture.pixels.shape[1]}" alt="cloth and spheres" '
        f'src="data:image/png;base64,{png}"></div>'
    )
    return {"text/html": html, "image/png": png}


def run_bundle(run: Run) -> dict[str, Any]:
    """The `bundle` of a run: its text and a picture of its last frame."""
    return bundle(str(run), run.picture(width=WIDTH))


def runs_html(runs: Mapping[str, Run]) -> str:
    """Labels and pictures of the last frames, side by side."""
    cells = (bundle(label, run.picture(width=WIDTH))["text/html"] for label, run in runs.items())
    box = '<div style="display: inline-block; vertical-align: top"'
    return f"<div>{''.join(one.replace('inline-block', 'block').replace('<div', box) for one in cells)}</div>"


def scene_bundle(scene: Scene) -> dict[str, Any]:
    """`bundle` with the lines of a scene and a picture of its initial state."""
    return bundle("\n".join(_scene_lines(scene)), picture(scene, scene.initial_position, 0.0, width=WIDTH))


def _scene_lines(scene: Scene) -> list[str]:
    """Six lines: cloth, springs, spheres, gravity, initial state and stable time step."""
    cloth, x = scene.cloth, scene.initial_position
    size, mass, pinned = "{:g} x {:g} m".format(*cloth.size), float(cloth.mass_per_point.sum()), int(cloth.pinned.sum())
    springs = ", ".join(f"{k:g} N/m {name}" for name, k in cloth.family_stiffness.items())
    energies = energy(scene, x, scene.initial_velocity)
    kinds = ["kinetic", "elastic", "gravity", *["force"] * (scene.force is not None)]
    # Rounding: the energy of one spring of the cloth's length that a strain of 1e-10 stretches.
    rounding = 1e-20 * max(cloth.family_stiffness.values(), default=0.0) * max(cloth.size) ** 2
    total, *parts = joules([float(energies[name]) for name in ("total", *kinds)], rounding)
    depths = [penetration(x, sphere, 0.0) for sphere in scene.spheres]
    deepest = [f"{name} {quantity(max(float(one[name]) for one in depths), 'm')}" for name in depths[0]] if depths else []
    term = limiting_term(scene, "rk4")
    return [
        f"Scene of {cloth_text(scene)}, {size}, {quantity(mass, 'kg')}",
        f"{counted(cloth.spring_count(), 'spring')} ({springs or 'none'}), {counted(pinned, 'pinned point')}",
        f"{spheres_text([scene])}, gravity ({', '.join(f'{g:g}' for g in scene.gravity)}) m/s^2",
        f"initial energy {total} ({', '.join(map(' '.join, zip(kinds, parts)))})",
        f"initial penetration: {', '.join(deepest) or 'no sphere'}",
        f"stable time step {quantity(term.max_stable_dt, 's')} with rk4, limited by {term.name}",
    ]


class Frame:
    """A page inside a notebook: an iframe that holds all of it and may run scripts, nothing else."""

    def __init__(self, page: str, text: str, height: int) -> None:
        self.page, self.text, self.height = page, text, height

    def _repr_html_(self) -> str:
        return (
            f'<iframe sandbox="allow-scripts allow-downloads" srcdoc="{escape(self.page, quote=True)}" title="clothsim" '
            f'style="width: 100%; height: {self.height}px; border: 0"></iframe>'
        )

    def __repr__(self) -> str:
        return self.text
