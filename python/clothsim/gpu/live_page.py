"""One self-contained page that simulates a scene in the browser: `Scene.to_live_html` and `cs.view`.

The page runs the WGSL of this room through WebGPU (`viewing/web/solver.js`), and `viewing/web/draw.js` draws it.
WebGPU has no float64: the page computes in compensated float32, and responses in float32 relative to the sphere.
"""

from __future__ import annotations

import math
import webbrowser
import zlib
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

from .. import _core
from ..base import check
from ..base.files import write_bytes
from ..base.progress import in_notebook
from ..engine.options import Options
from ..engine.plan import core_plan
from ..model.as_core import core_sphere
from ..model.mesh import GROUP
from ..model.scene import Scene
from ..stability.limit import max_stable_dt
from ..viewing.camera import DIRECTIONS, camera_for
from ..viewing.notebook import Frame
from ..viewing.page import filled, json_text, page_text, poster
from ..viewing.picture import PIN_SIZE, file_path
from .parameters import CONTACT_SIZE, FIRST_SPRING, FIRST_WEIGHT, rest_lengths
from .shader import Features, SphereFeatures, check_scenes, shader_text, source

STIFFNESS_FACTORS = tuple(2.0**k for k in range(-4, 5))
DAMPING_FACTORS = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0)
UNLIMITED_DT = 1e-3  # s, the time step of a scene that nothing limits
ROOM = 1.6  # a view this many times as wide as the scene at its start has room for a cloth that falls
METHODS = (
    ("1 (reflect)", "reflect", False),
    ("1, as printed", "reflect", True),
    ("2 (ray)", "ray", False),
    ("2, as printed", "ray", True),
    ("continuous", "continuous", False),  # of one sphere
)
HEIGHT = 700  # pixels of the page in a notebook
SLIDERS = {"stiffness": "stiffness K", "damping": "damping", "gravity": "gravity", "dt": "time step", "radius": "radius"}


def live_page(scene: Scene, path: str | Path, dt: float | None = None, title: str | None = None) -> Path:
    """`Scene.to_live_html`."""
    path = file_path("path", path)
    return write_bytes(path, _page(scene, dt, title).encode())


def view(scene: Scene, **unknown: Any) -> Path | Frame:
    """Open the live page of a scene in the browser, or show it in a notebook.

    The page is that of `Scene.to_live_html`, which says what it does.

    Parameters
    ----------
    scene : Scene
    **unknown
        Refused by name.

    Returns
    -------
    pathlib.Path or object
        The page, a file in the folder for temporary files. In a notebook, the page as the value of a cell.

    Raises
    ------
    ValueError, TypeError
        If `scene` is no Scene, or one that `Scene.to_live_html` refuses.
    RuntimeError
        If there is no browser.

    Examples
    --------
    >>> import clothsim as cs
    >>> page = cs.view(cs.scenes.paper_static())  # doctest: +SKIP
    """
    if unknown:
        raise TypeError(
            f"view takes a scene alone, got {', '.join(unknown)}: its controls are on the page that cs.view(scene) opens"
        )
    page = _page(check.instance("scene", scene, Scene))
    if in_notebook():
        return Frame(page, "<live page, to be shown in a notebook>", HEIGHT)
    path = write_bytes(Path(mkdtemp(prefix="clothsim-"), "live.html"), page.encode())
    if not webbrowser.open(path.as_uri()):
        raise RuntimeError(f"no web browser was found: open {path} in one")
    return path


def _page(scene: Scene, dt: float | None = None, title: str | None = None) -> str:
    rows, columns = scene.cloth.shape
    title = f"Cloth of {rows} x {columns} points, live" if title is None else check.instance("title", title, str)
    guaranteed = max_stable_dt(scene)
    if dt is None:
        dt = guaranteed / 2 if math.isfinite(guaranteed) else UNLIMITED_DT
    dt = check.number("dt", dt, minimum=0, exclusive=True)
    check_scenes([scene])
    data = _data(scene, dt)
    picture = poster(scene, scene.initial_position, 0.0, camera_for(None, scene, scene.initial_position, [0.0]))
    sliders = "".join(
        f'<label>{text} <input type="range" id="{name}"><output id="{name}-says"></output></label>'
        for name, text in SLIDERS.items()
    )
    options = "".join(
        f"<option{' selected' if k == data['method'] else ''}>{name}</option>" for k, name in enumerate(data.pop("names"))
    )
    body = filled(
        "live.html",
        title=escape(title),
        picture=picture,
        sliders=sliders,
        options=options,
        state=_state(scene),
        meta=json_text(data),
    )
    return page_text(title, body, ("draw.js", "orbit.js", "solver.js", "live.js"))


def _state(scene: Scene) -> str:
    """The planes of the initial state in float64, deflated, in base64."""
    x, v = scene.initial_position, np.where(scene.cloth.pinned[..., None], 0.0, scene.initial_velocity)
    planes = np.concatenate([x, v], axis=2).transpose(2, 0, 1)
    return b64encode(zlib.compress(planes.astype("<f8").tobytes(), 9)).decode("ascii")


def _methods(scene: Scene) -> tuple[list[str], list[dict[str, Any]], int]:
    """Names of the page's collision methods, the WGSL and the responses of each, and the index of the scene's own."""
    features, in_cells = Features.of(scene), [sphere.offset == "cell" for sphere in scene.spheres]

    def method(spheres: Sequence[SphereFeatures]) -> dict[str, Any]:
        responses = [sphere.response for sphere in spheres]
        cells = any(one == "continuous" and cell for one, cell in zip(responses, in_cells, strict=True))
        return {
            "wgsl": replace(features, spheres=tuple(spheres)).after_contacts(),
            "responses": responses,
            "cells": int(cells),
        }

    names, methods = [], []
    for name, response, as_printed in METHODS:
        if response == "continuous" and len(scene.spheres) != 1:
            continue
        names.append(name)
        rough = [sphere.friction > 0 and response != "continuous" for sphere in scene.spheres]
        methods.append(method([SphereFeatures(response, as_printed, one) for one in rough]))
    own = method(features.spheres)
    if own not in methods:  # spheres of different methods
        names.append("as in the scene")
        methods.append(own)
    return names, methods, methods.index(own)


def _data(scene: Scene, dt: float) -> dict[str, Any]:
    """Everything that solver.js and live.js know of the scene."""
    cloth, eps = scene.cloth, float(np.finfo(np.float32).eps)
    names, methods, own = _methods(scene)
    damping = DAMPING_FACTORS if any(cloth.family_damping.values()) else (1.0,)
    features = replace(Features.of(scene), moving=True)
    lengths = rest_lengths(scene)
    kinds = list(enumerate(_core.spring_kinds))
    masses = cloth.mass_per_point.ravel()
    return {
        "shape": list(cloth.shape),
        "group": GROUP[0],
        "dt": dt,
        "limits": _limits(scene, damping),
        "stiffnessFactors": STIFFNESS_FACTORS,
        "dampingFactors": damping,
        "mass": (masses[:1] if cloth.uniform_mass else masses).tolist(),
        "uniformMass": cloth.uniform_mass,
        "stiffness": dict(cloth.family_stiffness),
        "damping": dict(cloth.family_damping),
        "drag": cloth.drag,
        "gravity": list(scene.gravity),
        "springs": [{"family": family, "rest": lengths[k]} for k, (family, *_) in kinds],
        "pairs": [
            {"row": row, "column": column, "family": family, "rest": lengths[kind]}
            for row, column, family, kind in _core.neighbours
            if (row, column) > (0, 0)
        ],
        "pins": np.flatnonzero(cloth.pinned).tolist(),
        "dots": [] if min(cloth.shape) > 1 else np.flatnonzero(~cloth.pinned).tolist(),
        "dotSize": PIN_SIZE * max(cloth.size),
        "longest": 2 * math.hypot(*cloth.spacing),
        "extent": core_plan(scene, Options()).runaway_speed(1.0, 0.0),
        "spheres": [_sphere(sphere, scene) for sphere in scene.spheres],
        "firstSpring": FIRST_SPRING,
        "firstWeight": FIRST_WEIGHT,
        "contactSize": CONTACT_SIZE,
        "contact": _core.contact_constants,
        "epsilon": eps,
        "largestFloat": float(np.finfo(np.float32).max),
        "constants": features.constants(),
        "wgsl": source(replace(features, spheres=()), "single", False).removesuffix(
            replace(features, spheres=()).after_contacts()
        ),
        "methods": methods,
        "names": names,
        "method": own,
        "threadIds": shader_text("thread_ids"),
        "camera": _camera(scene),
    }


def _limits(scene: Scene, damping: tuple[float, ...]) -> list[list[float | None]]:
    """The guaranteed time step for every pair of factors of stiffness and damping [s]; None: nothing limits it."""
    cloth = scene.cloth
    table: list[list[float | None]] = []
    for k in STIFFNESS_FACTORS:
        row: list[float | None] = []
        for c in damping:
            changed = cloth.replace(
                stiffness={family: k * value for family, value in cloth.family_stiffness.items()},
                damping={family: c * value for family, value in cloth.family_damping.items()},
            )
            limit = max_stable_dt(scene.replace(cloth=changed))
            row.append(limit if math.isfinite(limit) else None)
        table.append(row)
    return table


def _sphere(sphere: Any, scene: Scene) -> dict[str, Any]:
    core = core_sphere(sphere, scene)
    # Length of the cloth in eq 13; 0: the offset is a number.
    side = {"edge": max(scene.cloth.spacing), "cell": math.hypot(*scene.cloth.spacing)}.get(sphere.offset, 0.0)
    return {
        "center": list(sphere.center),
        "radius": sphere.radius if math.isfinite(sphere.radius) else None,  # None: a plane
        "normal": list(core.normal),
        "spread": core.spread,
        "restitution": sphere.restitution,
        "friction": sphere.friction,
        "side": side,
        "cells": sphere.offset == "cell",
        "push": sphere.push_out_speed,
        "offset": 0.0 if side else sphere.offset_length(scene.cloth),
        "motion": sphere.motion.for_pages if sphere.motion else None,
    }


def _camera(scene: Scene) -> dict[str, Any]:
    view = camera_for(None, scene, scene.initial_position, [0.0])
    size = ROOM * max(view.width, view.height)
    return {
        "direction": list(DIRECTIONS["corner"]),
        "target": list(view.target),
        "reach": 4 * size,
        "width": size,
        "height": size,
    }
