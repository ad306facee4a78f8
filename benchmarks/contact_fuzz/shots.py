"""Spheres shot at sheets, and spheres that close on sheets, judged by the oracle."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, cast

import clothsim as cs
import numpy as np
from clothsim.typing import Offset
from contact.oracle import corner_indices, nearest_places

from .exact import deepest_on_the_way
from .search import finds_place

_STEPS = 4  # of a shot


def _direction(rng: np.random.Generator) -> np.ndarray:
    n = rng.normal(size=3)
    return n / np.linalg.norm(n)


def _shot(rng: np.random.Generator, several: bool) -> tuple[cs.Scene, float] | None:
    """A sheet with some pins and spheres on their way to it, and a time step; None: one starts inside."""
    points = int(rng.integers(2, 9))
    count = int(rng.integers(0, 3)) if rng.random() < 0.4 else 0
    pins = [(int(a), int(b)) for a, b in rng.integers(0, points, (count, 2))]
    cloth = cs.Cloth(
        (points, points),
        mass=float(0.2 * points**2 * 10 ** rng.uniform(-1, 1)),
        stiffness=float(10 ** rng.uniform(0, 3)),
        damping=0.1,
        pins=pins,
    )
    cell = cloth.spacing[0]
    dt = min(10 ** rng.uniform(-5, -3.3), 0.5 * cs.max_stable_dt(cs.Scene(cloth)))
    corners = cloth.rest_positions.reshape(-1, 3)[corner_indices(cloth.shape)]
    spheres: list[cs.Sphere] = []
    for k in range(int(rng.integers(2, 4)) if several else 1):
        small = rng.random() < 0.5
        radius = float(cell * 10 ** rng.uniform(-1, 0) if small else 10 ** rng.uniform(-1, 0.5))
        speed = radius * 10 ** rng.uniform(-2, 3) / dt
        if rng.random() < 0.5:
            speed = min(speed, 10 ** rng.uniform(0, 2.5))
        aim, way = rng.uniform(-0.05, 1.05, 3) * (1, 0, 1), _direction(rng)
        back = radius * 1.001 / max(abs(way[1]), 0.1) + rng.uniform(0, 2) * min(speed * dt, 5.0)
        center = aim - way * back
        sphere = cs.Sphere(
            center,
            radius,
            cs.Linear(way * speed),
            "continuous",
            "face" if k == 0 or rng.random() < 0.6 else cast(Offset, str(rng.choice(("edge", "none")))),
            float(rng.choice((0.0, 0.5, 1.0))),
            float(rng.choice((0.0, 0.3))),
        )
        outer = sphere.radius if sphere.offset == "face" else sphere.contact_radius(cloth)
        if nearest_places(corners - center)[1].min() < 1.001 * outer:
            return None
        spheres.append(sphere)
    return cs.Scene(cloth, spheres), dt


def _passed(scene: cs.Scene, x: np.ndarray, y: np.ndarray, t: float, dt: float) -> bool:
    """Whether a sphere contains a free point, or a triangle with free corners, that it must keep out."""
    corners = corner_indices(scene.cloth.shape)
    corners = corners[~scene.cloth.pinned.ravel()[corners].any(axis=1)]
    free = ~scene.cloth.pinned.ravel()
    for sphere in scene.spheres:
        before = x.reshape(-1, 3) - sphere.center_at(t)
        after = y.reshape(-1, 3) - sphere.center_at(t + dt)
        if sphere.offset == "face":
            if not len(corners):
                continue
            deepest = deepest_on_the_way(before[corners], after[corners], sphere.radius)
        else:
            points = np.stack([np.repeat(p[free][:, None], 3, axis=1) for p in (before, after)])
            radius = sphere.contact_radius(scene.cloth)
            deepest = radius - np.linalg.norm(points[1][:, 0], axis=1).min(initial=np.inf)
        if deepest > 1e-9 * max(sphere.radius, 1.0):
            return True
    return False


def _thrown(scene: cs.Scene, state: tuple[np.ndarray, ...], end: tuple[np.ndarray, ...], dt: float) -> tuple[bool, bool]:
    """Whether contact moved a point too far from the free step, and whether contact made energy.

    The free step is one without spheres. Springs may take up the ways of a step. Spheres work at most
    with their speed times the impulse; a pinned corner may bear 0.99 of it.
    """
    cloth, free = scene.cloth, cs.Scene(scene.cloth, (), scene.gravity)
    x, v = cs.step(free, *state, dt, t=0.0)
    ways = [float(np.linalg.norm(np.asarray(s.center_at(dt)) - s.center_at(0.0))) for s in scene.spheres]
    own = np.linalg.norm(x - state[0], axis=-1)
    changed = (end[0] != x).any(axis=-1) | (end[1] != v).any(axis=-1)
    farthest = 2 * (sum(ways) + own[changed].max(initial=0.0)) + max(s.radius for s in scene.spheres)
    far = bool(np.linalg.norm(end[0] - x, axis=-1).max() > farthest)
    # Two spheres that close on a point squeeze it out faster than they move.
    most = 100 if cloth.pinned.any() or len(scene.spheres) > 1 else 1
    impulses = most * (cloth.mass_per_point * np.linalg.norm(end[1] - v, axis=-1)).sum()
    table = cloth.spring_table()
    stiffness = np.zeros(cloth.rows * cloth.columns)
    for corner in ("i", "j"):
        np.add.at(stiffness, table[corner], table["stiffness"])
    slack = (stiffness.reshape(cloth.shape) * (own + sum(ways) + 1e-6) ** 2)[changed].sum() / 2
    before, after = (cs.energy(free, *of)["total"] for of in ((x, v), end))
    bound = before + impulses * max(ways, default=0.0) / dt + slack + 1e-9 * abs(before) + 1e-12
    return far, bool(after > bound)


def _no_place(v: np.ndarray) -> Callable[[cs.Scene, np.ndarray, np.ndarray, float, float], bool]:
    """Judge of a place: whether a sphere contains a free part of it, or contact moves no point so far."""

    def judge(scene: cs.Scene, x: np.ndarray, y: np.ndarray, t: float, dt: float) -> bool:
        x, y = x.reshape(v.shape), y.reshape(v.shape)
        return _passed(scene, x, y, t, dt) or _thrown(scene, (x, v), (y, v), dt)[0]

    return judge


def shots(count: int = 300, seed: int = 1) -> dict[str, Any]:
    """Shoot spheres at sheets and judge every step.

    Steps go up to 1,000 radii. One to three spheres have sizes from a tenth of a cell to three
    sheets. Offsets are "face", "edge" and "none", with restitution and friction. Some corners are
    pinned. In each of four steps the oracle checks whether a sphere crossed a triangle of free
    corners or left one inside, and how far and with how much energy contact moved the points.

    Parameters
    ----------
    count : int
        Shots.
    seed : int
        Seed of the random numbers.

    Returns
    -------
    dict
        "shots"; "hits": shots in which a sphere changed the sheet; "passed": with a triangle or a
        point crossed or inside; "thrown": with a point farther from the free step than contact may
        move it; "gained": with energy that no sphere gave; "refused": ended with a `ContactError`;
        "with_place": refused, though an independent search finds a place within these bounds.
    """
    rng = np.random.default_rng(seed)
    total = {"shots": 0, "hits": 0, "passed": 0, "thrown": 0, "gained": 0, "refused": 0, "with_place": 0}
    while total["shots"] < count:
        drawn = _shot(rng, several=total["shots"] % 2 == 1)
        if drawn is None:
            continue
        scene, dt = drawn
        total["shots"] += 1
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", cs.ContactWarning)
            stepper = cs.Stepper(scene, threads=1)
            x, v = stepper.positions, stepper.velocities
            passed = thrown = gained = False
            for _ in range(_STEPS):
                t = stepper.time
                try:
                    stepper.advance(1, dt)
                except cs.ContactError:
                    total["refused"] += 1
                    total["with_place"] += finds_place(scene, x, t, dt, _no_place(v))
                    break
                y, u = stepper.positions, stepper.velocities
                passed |= _passed(scene, x, y, t, dt)
                far, more = _thrown(scene, (x, v), (y, u), dt)
                thrown |= far
                gained |= more
                x, v = y, u
        total["passed"] += passed
        total["thrown"] += thrown
        total["gained"] += gained
        total["hits"] += bool(np.abs(stepper.velocities).max() > 0.1)
    return total


def _squeeze(rng: np.random.Generator) -> tuple[cs.Scene, float, float] | None:
    """A sheet, two or three spheres that close on it, time step and duration; None: one starts inside."""
    points, radius = int(rng.integers(3, 10)), 0.2
    cloth = cs.Cloth((points, points), mass=0.02 * points**2, stiffness=100.0, damping=0.1, pins=())
    axis = rng.normal(size=3) * (0.1, 0, 0.1) + (0, 1, 0)
    axis /= np.linalg.norm(axis)
    aside = np.cross(axis, _direction(rng))
    aside *= rng.uniform(0.41, 0.7) / np.linalg.norm(aside)
    middle = np.array((rng.uniform(0.2, 0.8), 0.0, rng.uniform(0.2, 0.8)))
    start, gap, dt = 0.02, 10 ** rng.uniform(-5, -3), float(rng.choice((1e-3, 2e-4)))
    ways = [(1, 0.0), (-1, 0.0), (-1, 1.0)][: int(rng.integers(2, 4))]
    spheres = [
        cs.Sphere(
            middle + sign * axis * (radius + start) + beside * aside,
            radius,
            cs.Linear(-sign * axis),
            "continuous",
            cast(Offset, str(rng.choice(("face", "face", "edge", "none")))),
            0.0,
            float(rng.choice((0.0, 0.5))),
        )
        for sign, beside in ways
    ]
    flat = cloth.rest_positions.reshape(-1, 3)[corner_indices(cloth.shape)]
    outer = [s.radius if s.offset == "face" else s.contact_radius(cloth) for s in spheres]
    if any(nearest_places(flat - s.center_at(0.0))[1].min() < r for s, r in zip(spheres, outer, strict=True)):
        return None
    # The outer radii of the two opposite spheres leave the gap.
    duration = start - gap / 2 - (outer[0] + outer[1] - 2 * radius) / 2
    return cs.Scene(cloth, spheres, (0, 0, 0)), dt, duration


def squeezes(count: int = 60, seed: int = 1) -> dict[str, Any]:
    """Let two or three spheres close on a sheet until a gap of 1 mm to 0.01 mm is left between two.

    The third sphere closes beside the second. Offsets are mixed. A flat sheet fits into the gap, so
    that the sheet can lie between the spheres if it turns or bends. An independent search judges the
    steps that end with a `ContactError`.

    Parameters
    ----------
    count : int
        Scenes.
    seed : int
        Seed of the random numbers.

    Returns
    -------
    dict
        "squeezes"; "refused": ended with a `ContactError`; "with_place": refused, though the search
        finds a place; "inside": with a triangle, or a point for other offsets, in a sphere.
    """
    rng = np.random.default_rng(seed)
    total = {"squeezes": 0, "refused": 0, "with_place": 0, "inside": 0}
    while total["squeezes"] < count:
        drawn = _squeeze(rng)
        if drawn is None:
            continue
        scene, dt, duration = drawn
        total["squeezes"] += 1
        stepper = cs.Stepper(scene, threads=1)
        try:
            stepper.advance(int(duration / dt), dt)
        except cs.ContactError as error:
            total["refused"] += 1
            assert error.x is not None
            total["with_place"] += finds_place(scene, error.x, error.time - dt, dt, _passed)
            continue
        x = stepper.positions.reshape(-1, 3)
        corners = corner_indices(scene.cloth.shape)
        for sphere in scene.spheres:
            centred = x - sphere.center_at(stepper.time)
            if sphere.offset == "face":
                distance = nearest_places(centred[corners])[1].min()
            else:
                distance = np.linalg.norm(centred, axis=1).min()
            outer = sphere.radius if sphere.offset == "face" else sphere.contact_radius(scene.cloth)
            if distance < outer * (1 - 1e-12):
                total["inside"] += 1
                break
    return total
