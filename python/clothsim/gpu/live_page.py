"""One self-contained page that simulates a scene in the browser: `Scene.to_live_html` and
`cs.view`.

The page is that of a run (`viewing/page.py`), with a short run of the scene. Where the browser has
WebGPU, it runs the WGSL of this room (`viewing/web/solver.js`), and records what it shows. WebGPU
has no float64: the page computes in compensated float32, and responses in float32 relative to the
sphere.
"""

from __future__ import annotations

import math
import warnings
import webbrowser
import zlib
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

from .. import _core
from ..base import check
from ..base.files import write_bytes
from ..base.progress import is_in_notebook
from ..engine.options import Options, compile_plan
from ..errors import ContactError, UnstableError
from ..methods.region import angles_and_radii_of_border
from ..model.mesh import GROUP
from ..model.obstacle import LAYER, RESPONSES, Sphere, lengths_of_offsets
from ..model.scene import Scene, core_sphere
from ..model.scene_files import toml_text
from ..run.result import Run
from ..run.simulate import simulate
from ..stability.limit import max_stable_dt
from ..viewing.notebook import Frame
from ..viewing.page import fill_web_file, json_for_script, page_body, page_text, read_web_file
from ..viewing.picture import check_file_path
from .shader import (
    CONTACT_SIZE,
    FIRST_SPRING,
    FIRST_WEIGHT,
    Features,
    SphereFeatures,
    check_scenes,
    rest_length_of_kinds,
    step_wgsl,
)
from .simulation import mean_positions, planes_of_state, split_planes

UNLIMITED_DT = 1e-3  # s, the time step of a scene that nothing limits
STORED = 2.0  # s of the run that a browser without WebGPU plays
STORED_STEPS = 2e7  # of single mass points that it may take: about half a second
STORED_POINTS = 21_000  # in all of its frames, which keeps the page below 400 kB
METHODS = (
    ("penalty", "penalty", False),
    ("1 (reflect)", "reflect", False),
    ("1, as printed", "reflect", True),
    ("2 (ray)", "ray", False),
    ("2, as printed", "ray", True),
)
HEIGHT = 700  # pixels of the page in a notebook
# Arguments of spheres and planes that the page's controls change.
CHANGED = (
    "center",
    "point",
    "radius",
    "restitution",
    "friction",
    "response",
    "as_printed",
    "offset",
    *LAYER,
)


def write_live_page(
    scene: Scene, path: str | Path, dt: float | None = None, title: str | None = None
) -> Path:
    """Write the page of `Scene.to_live_html`."""
    path = check_file_path("path", path)
    return write_bytes(path, _page_text(scene, dt, title).encode())


@check.check_names
def view(scene: Scene) -> Path | Frame:
    """Open the live page of a scene in the browser, or show it in a notebook.

    The page is that of `Scene.to_live_html`, which says what it does.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    pathlib.Path or object
        The page, a file in the folder for temporary files. In a notebook, the page as the value of
        a cell.

    Raises
    ------
    ValueError, TypeError
        If `scene` is not a Scene, or `Scene.to_live_html` refuses it.
    RuntimeError
        If there is no browser.

    Examples
    --------
    >>> page = cs.view(cs.scenes.paper_static())  # doctest: +SKIP
    """
    page = _page_text(check.instance("scene", scene, Scene))
    if is_in_notebook():
        return Frame(page, "<live page, to be shown in a notebook>", HEIGHT)
    path = write_bytes(Path(mkdtemp(prefix="clothsim-"), "live.html"), page.encode())
    if not webbrowser.open(path.as_uri()):
        raise RuntimeError(f"no web browser was found: open {path} in one")
    return path


def _page_text(scene: Scene, dt: float | None = None, title: str | None = None) -> str:
    rows, columns = scene.cloth.shape
    title = (
        f"Cloth of {rows} x {columns} points, live"
        if title is None
        else check.instance("title", title, str)
    )
    stable_dt = max_stable_dt(scene)
    usual = stable_dt / 2 if math.isfinite(stable_dt) else UNLIMITED_DT
    dt = check.number("dt", usual if dt is None else dt, minimum=0, exclusive=True)
    check_scenes([scene])
    data = _page_data(scene, dt)
    names = (
        f"<option{' selected' if k == data['method'] else ''}>{name}</option>"
        for k, name in enumerate(data.pop("names"))
    )
    live = fill_web_file(
        "live.html",
        methods="".join(names),
        state=_compressed_text(_planes_of_initial_state(scene).astype("<f8").tobytes()),
        toml=_compressed_text(_toml_template(scene).encode()),
        data=json_for_script(data),
    )
    code = "\n".join(map(read_web_file, ("solver.js", "live.js")))
    stored = _short_run(scene, usual)
    return page_text(
        title,
        page_body(title, {title: stored}, more=live),
        f"<script data-live>\n{code}</script>\n",
    )


def _short_run(scene: Scene, dt: float) -> Run:
    """Return a short run of the scene, or its first step where the run does not come to its end."""
    points = math.prod(scene.cloth.shape)
    duration = min(STORED, STORED_STEPS / points * dt)
    frames = min(max(STORED_POINTS // points, 2), 60)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return simulate(scene, duration, dt, every=duration / (frames - 1))
        except (UnstableError, ContactError):
            return simulate(scene, dt, dt)


def _toml_template(scene: Scene) -> str:
    """Return the scene's file, with "@name" in place of the values that the page's controls change.

    The page leaves the line of a value out that the scene has none of.
    """
    data = scene.to_dict()
    data["gravity"] = "@gravity"
    data["cloth"] |= {name: f"@{name}" for name in ("stiffness", "damping", "drag")}
    obstacles = zip(scene.spheres, data.get("spheres", ()), strict=True)
    for k, (obstacle, values) in enumerate(obstacles):
        own = [name for name in CHANGED if name in obstacle.__match_args__]
        values |= {name: f"@spheres.{k}.{name}" for name in own}
        if values.get("motion", {}).get("centers"):
            values["motion"]["centers"] = f"@spheres.{k}.centers"
    return toml_text(data)


def _compressed_text(content: bytes) -> str:
    return b64encode(zlib.compress(content, 9)).decode("ascii")


def _planes_of_initial_state(scene: Scene) -> np.ndarray:
    """Return the planes of the initial state, shape (1, 6, points)."""
    x = scene.initial_position
    v = np.where(scene.cloth.pinned[..., None], 0.0, scene.initial_velocity)
    return planes_of_state(x, v, [scene])


def _collision_methods(scene: Scene) -> tuple[list[str], list[dict[str, Any]], int]:
    """Return names of the page's collision methods, the WGSL and the responses of each, and the
    index of the scene's own.
    """
    features = Features.of_scene(scene)
    layered = _scene_with_layers(scene)

    def method_data(spheres: Sequence[SphereFeatures]) -> dict[str, Any]:
        return {
            "wgsl": replace(features, spheres=tuple(spheres)).contacts_wgsl(),
            "responses": [sphere.response for sphere in spheres],
            "printed": [sphere.as_printed for sphere in spheres],
        }

    names = []
    methods = []
    for name, response, as_printed in METHODS:
        if response == "penalty" and not (scene.spheres and layered):
            continue
        names.append(name)
        methods.append(
            method_data(
                [
                    SphereFeatures(
                        response, as_printed and "as_printed" in obstacle.__match_args__, rough=True
                    )
                    for obstacle in scene.spheres
                ]
            )
        )
    own = method_data([s._replace(rough=True) for s in features.spheres])
    if own not in methods:  # spheres of different methods
        names.append("as in the scene")
        methods.append(own)
    return names, methods, methods.index(own)


def _page_data(scene: Scene, dt: float) -> dict[str, Any]:
    """Return everything that solver.js and live.js know of the scene."""
    cloth = scene.cloth
    eps = float(np.finfo(np.float32).eps)
    names, methods, own = _collision_methods(scene)
    features = replace(Features.of_scene(scene), moving=True, spheres=())
    lengths = rest_length_of_kinds(scene)
    masses = cloth.mass_per_point.ravel()
    lightest = float(masses.min())
    stiffest = max(cloth.family_stiffness.values())
    return {
        "shape": list(cloth.shape),
        "size": list(cloth.size),
        "offsets": {
            name: {"side": side, "diagonal": name == "cell", "offset": 0}
            for name, side in {"none": 0, **lengths_of_offsets(cloth)}.items()
        },
        "group": GROUP[0],
        "dt": dt,
        "exits": angles_and_radii_of_border("rk4")[1].tolist(),
        "mass": (masses[:1] if cloth.uniform_mass else masses).tolist(),
        "stiffness": dict(cloth.family_stiffness),
        "damping": dict(cloth.family_damping),
        "drag": cloth.drag,
        # A slider goes up to four times this, where the scene has none: a tenth of the critical
        # damping of a spring.
        "usualDissipation": 0.5,  # s/m
        "usualDamping": 0.2 * math.sqrt(stiffest * lightest),
        "gravity": list(scene.gravity),
        "springs": [
            {"family": family, "rest": lengths[k]}
            for k, (family, *_) in enumerate(_core.spring_kinds)
        ],
        "pairs": [
            {"row": row, "column": column, "family": family, "rest": lengths[kind]}
            for row, column, family, kind in _core.neighbours
            if (row, column) > (0, 0) and family in cloth.springs
        ],
        "pins": np.flatnonzero(cloth.pinned).tolist(),
        "longest": 2 * math.hypot(*cloth.spacing),
        "extent": compile_plan(scene, Options()).runaway_speed(1.0, 0.0),
        "spheres": [
            {**_sphere_data(sphere, scene), **layer}
            for sphere, layer in zip(scene.spheres, _layer_data(scene), strict=True)
        ],
        "restitutions": {response: Sphere(response=response).restitution for response in RESPONSES},
        "firstSpring": FIRST_SPRING,
        "firstWeight": FIRST_WEIGHT,
        "contactSize": CONTACT_SIZE,
        "epsilon": eps,
        "largestFloat": float(np.finfo(np.float32).max),
        "constants": features.override_constants(),
        "wgsl": step_wgsl(features, "single", False).removesuffix(features.contacts_wgsl()),
        "methods": methods,
        "names": names,
        "method": own,
    }


def _scene_with_layers(scene: Scene) -> Scene | None:
    """Return the scene with obstacles of response "penalty" alone and all their parameters; None
    where the cloth gives them no stiffness.
    """
    obstacles = []
    for sphere in scene.spheres:
        obstacle = sphere._copy_with_layer()
        try:
            obstacles.append(obstacle.replace(**obstacle.layer(scene.cloth)))
        except ValueError:
            return None
    return scene.replace(spheres=obstacles)


def _sphere_data(sphere: Any, scene: Scene) -> dict[str, Any]:
    core = core_sphere(sphere, scene)
    side = lengths_of_offsets(scene.cloth).get(sphere.offset, 0.0)  # 0: the offset is a number
    return {
        "center": list(sphere.center),
        "radius": sphere.radius if math.isfinite(sphere.radius) else None,  # None: a plane
        "normal": list(core.normal),
        # None takes that of the response.
        "restitution": sphere.to_dict().get("restitution"),
        "friction": sphere.friction,
        "side": side,
        "diagonal": sphere.offset == "cell",  # at most the diameter
        "offset": 0.0 if side else sphere.offset_length(scene.cloth),
        "named": sphere.offset,
        "centers": sphere.motion.to_dict().get("centers") if sphere.motion else None,
        "motion": sphere.motion.pieces_for_pages if sphere.motion else None,
    }


def _layer_data(scene: Scene) -> list[dict[str, Any]]:
    """Return for each obstacle the parameters of its layer, those that the scene gives, and the
    normal at the surface point from which the core in single measures the initial state.
    """
    layered = _scene_with_layers(scene)
    if layered is None:
        return [{} for _ in scene.spheres]
    places = mean_positions(split_planes(_planes_of_initial_state(scene), single=True))
    normals = compile_plan(layered, Options()).normals_towards(places[0], np.zeros(3), 0.0)
    return [
        {
            **{name: getattr(layer, name) for name in LAYER},
            "given": {name: getattr(sphere, name) for name in LAYER},
            "towards": list(normal),
        }
        for sphere, layer, normal in zip(scene.spheres, layered.spheres, normals, strict=True)
    ]
