"""An independent search for a place of a sheet between spheres, in NumPy: it shares no code with the core."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator

import clothsim as cs
import numpy as np
from contact.oracle import corner_indices, nearest_places

_MARGIN = 2e-6  # of the radius: places this far outside a sphere count as outside
_ROUNDS = 400
_PATIENCE = 20  # rounds in which the depth has to fall by a tenth
_TIMES = np.array([1.0, 0.75, 0.5, 0.25, 0.1])  # of a path, at which a round looks for depth


def _starts(scene: cs.Scene, x: np.ndarray, t: float, dt: float) -> Iterator[np.ndarray]:
    """Sheets to begin with: as it lies, carried by each sphere, flat, and flat between each two spheres."""
    yield x
    centres = [np.asarray(s.center_at(t + dt)) for s in scene.spheres]
    for sphere, centre in zip(scene.spheres, centres, strict=True):
        yield x + (centre - np.asarray(sphere.center_at(t)))
    middle = x.mean(axis=0)
    normal = np.linalg.svd(x - middle)[2][2]
    yield x - ((x - middle) @ normal)[:, None] * normal
    for (one, c1), (other, c2) in itertools.combinations(zip(scene.spheres, centres, strict=True), 2):
        way = c2 - c1
        length = np.linalg.norm(way)
        if length == 0:
            continue
        outer = [s.radius if s.offset == "face" else s.contact_radius(scene.cloth) for s in (one, other)]
        axis = way / length
        height = outer[0] + (length - sum(outer)) / 2
        flat = x - ((x - c1) @ axis - height)[:, None] * axis
        yield flat
        yield x + 0.5 * (flat - x)


def _relax(scene: cs.Scene, x: np.ndarray, y: np.ndarray, t: float, dt: float) -> np.ndarray:
    """Project the end of straight paths out of the spheres, all places at once, until none is inside."""
    corners = corner_indices(scene.cloth.shape)
    pinned = scene.cloth.pinned.ravel()
    corners = corners[~pinned[corners].any(axis=1)]
    points = np.flatnonzero(~pinned)
    y = y.copy()
    y[pinned] = x[pinned]
    deepest = np.inf
    for k in range(_ROUNDS):
        move, count, depth = np.zeros_like(y), np.zeros(len(y)), 0.0
        for sphere in scene.spheres:
            face = sphere.offset == "face"
            places = corners if face else np.repeat(points[:, None], 3, axis=1)
            times = _TIMES if face else _TIMES[:1]
            if not len(places):
                continue
            start, end = x - sphere.center_at(t), y - sphere.center_at(t + dt)
            at = (1 - times)[:, None, None] * start + times[:, None, None] * end
            weights, distance = nearest_places(at[:, places].reshape(-1, 3, 3))
            radius = sphere.radius if face else sphere.contact_radius(scene.cloth)
            deep = np.flatnonzero(distance < (1 + _MARGIN / 2) * radius)
            if not len(deep):
                continue
            time, index = times[deep // len(places)], places[deep % len(places)]
            w, corner = weights[deep], at[(deep // len(places))[:, None], index]
            normal = (w[..., None] * corner).sum(axis=1) / np.maximum(distance[deep], 1e-300)[:, None]
            lift = ((1 + _MARGIN) * radius - distance[deep]) / (time * (w * w).sum(axis=1))
            np.add.at(move, index, (w * lift[:, None])[..., None] * normal[:, None])
            np.add.at(count, index, w > 0)
            depth = max(depth, float((radius - distance[deep]).max()))
        if not count.any():
            break
        if k % _PATIENCE == _PATIENCE - 1:
            if depth > 0.9 * deepest:
                break
            deepest = depth
        y += move / np.maximum(count, 1)[:, None]
        y[pinned] = x[pinned]
    return y


def finds_place(
    scene: cs.Scene,
    x: np.ndarray,
    t: float,
    dt: float,
    passed: Callable[[cs.Scene, np.ndarray, np.ndarray, float, float], bool],
) -> bool:
    """Whether projections from several starts find a place that the sheet reaches on straight paths.

    Parameters
    ----------
    scene : Scene
        Cloth and spheres.
    x : numpy.ndarray
        Positions before the step, shape (rows, columns, 3) [m].
    t, dt : float
        Time before the step, and its length [s].
    passed : callable
        Judge of a step from positions to positions: true where a sphere crosses the sheet.

    Returns
    -------
    bool
        False where the search finds no place. There may still be one.
    """
    before = x.reshape(-1, 3)
    for start in _starts(scene, before, t, dt):
        if not passed(scene, before, _relax(scene, before, start, t, dt), t, dt):
            return True
    return False
