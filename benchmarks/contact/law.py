"""The law of contact of offset "face" in figures: friction, restitution, energy and rest."""

from __future__ import annotations

import math
from typing import Any

import clothsim as cs
import numpy as np
from clothsim.typing import Offset, Precision

from .oracle import corner_indices, nearest_places
from .physics import GRAVITY, on_sphere

TANGENT = 0.3  # of the slope
_BETWEEN = 1e-4  # s, between two looks at a contact


def _touching(x: np.ndarray, corners: np.ndarray, sphere: cs.Sphere) -> tuple[np.ndarray, np.ndarray]:
    """Which triangles touch the sphere, and the weights of their nearest places."""
    weights, distance = nearest_places(x.reshape(-1, 3)[corners] - np.array(sphere.center))
    return distance < sphere.radius * (1 + 1e-5), weights


def _places(x: np.ndarray, corners: np.ndarray, weights: np.ndarray, sphere: cs.Sphere) -> np.ndarray:
    places = weights[..., None] * (x.reshape(-1, 3)[corners] - np.array(sphere.center))
    return np.asarray(places.sum(axis=1))


def stick(
    part: float = 1.05,
    dt: float = 1e-4,
    radius: float = 0.25,
    points: int = 2,
    duration: float | None = None,
    precision: Precision = "double",
) -> dict[str, Any]:
    """A sheet at rest on the slope of a sphere: how far do the places in contact slip?

    The sheet settles with a friction of 10 and drag of the air, which then ends. The friction
    becomes `part` times the tangent of the slope at its places of contact. Above 1 they have to
    stay, below 1 to slide as a body on the slope does. The slip counts tangential motion of the
    places of triangles that touch; a corner that swings does not count.

    Parameters
    ----------
    part : float
        Friction over tangent.
    dt : float
        Time step [s].
    radius : float
        Of the sphere [m]. The sheet is a tenth of it wide, at most 0.1 m.
    points : int
        Mass points along each side.
    duration : float, optional
        Time the sheet is watched [s]: 0.2 where it has to stay, at most 0.05 where it slides. The time is short,
        because a sheet tilts after a long slide.
    precision : str
        "double" or "single".

    Returns
    -------
    dict
        "tangent" of the slope, "slip" of the places in contact and "expected" [m].
    """
    duration = duration or (0.2 if part > 1 else 0.05 * min(1.0, math.sqrt(radius / 0.25)))
    size = min(0.1, radius / 10)
    cloth = cs.Cloth((points, points), (size, size), 1e-4 * points**2, 1000.0, 0.0, 2e-3, pins=())
    sphere = cs.Sphere((0, -radius, 0), radius, None, "continuous", "face", 0.0, 10.0)
    x = on_sphere(cloth, sphere.center, sphere.contact_radius(cloth), math.atan(TANGENT))
    stepper = cs.Stepper(cs.Scene(cloth, sphere, position=x), threads=1, precision=precision)
    stepper.advance(round(2.0 / 1e-4), 1e-4)
    corners = corner_indices(cloth.shape)
    x = stepper.positions
    near, weights = _touching(x, corners, sphere)
    normal = _places(x, corners, weights, sphere)[near].mean(axis=0)
    angle = math.acos(normal[1] / np.linalg.norm(normal))
    friction = part * math.tan(angle)
    # Forces between the places in contact that the friction of 10 held go.
    rough = sphere.replace(friction=1.05 * math.tan(angle))
    stepper = cs.Stepper(cs.Scene(cloth, rough, position=x), threads=1, precision=precision)
    stepper.advance(round(1.0 / 1e-4), 1e-4)
    x = stepper.positions
    rough = sphere.replace(friction=friction)
    scene = cs.Scene(cloth.replace(drag=0.0), rough, position=x)
    stepper = cs.Stepper(scene, threads=1, precision=precision)
    moved = np.zeros(3)
    for _ in range(round(duration / _BETWEEN)):
        x = stepper.positions
        near, weights = _touching(x, corners, sphere)
        stepper.advance(round(_BETWEEN / dt), dt)
        before, after = (_places(y, corners, weights, sphere)[near] for y in (x, stepper.positions))
        normals = before / np.linalg.norm(before, axis=1, keepdims=True)
        way = after - before
        moved += (way - (way * normals).sum(axis=1, keepdims=True) * normals).mean(axis=0)
    pull = GRAVITY * (math.sin(angle) - friction * math.cos(angle))
    return {"tangent": math.tan(angle), "slip": float(np.linalg.norm(moved)), "expected": max(0.0, pull) * duration**2 / 2}


def impact(
    speed: float = 1.0, dt: float = 1e-4, restitution: float = 1.0, phases: int = 40, precision: Precision = "double"
) -> dict[str, Any]:
    """A cell falls on a sphere without gravity, at every phase of the contact within a time step.

    The cell is level and free, so the sphere touches it at one place. The weights w of the corners give the place. Its
    effective mass is M = 1 / sum(w^2/m), so the energy after the impact is E - (1 - e^2) M u^2 / 2.

    Parameters
    ----------
    speed : float
        Speed of arrival u [m/s].
    dt : float
        Time step [s].
    restitution : float
        Restitution e.
    phases : int
        Drops, each with the contact at another part of the step.
    precision : str
        "double" or "single".

    Returns
    -------
    dict
        "worst": the largest difference from that energy, over the energy before.
    """
    cloth = cs.Cloth((2, 2), (0.1, 0.1), 0.04, 2000.0, 0.0, pins=())
    sphere = cs.Sphere((0, -0.25, 0), 0.25, None, "continuous", "face", restitution)
    flat = cloth.rest_positions - (0.045, 0.0, 0.04)
    corners = corner_indices(cloth.shape)
    weights, distance = nearest_places(flat.reshape(-1, 3)[corners] - np.array(sphere.center))
    weight = weights[distance.argmin()]
    mass = 0.01 / (weight**2).sum()
    v = np.broadcast_to((0.0, -speed, 0.0), flat.shape)
    worst = 0.0
    for phase in (np.arange(phases) + 0.5) / phases:
        x = flat + (0.0, 1e-6 + phase * speed * dt, 0.0)
        scene = cs.Scene(cloth, sphere, (0, 0, 0), x, v)
        stepper = cs.Stepper(scene, threads=1, precision=precision)
        before = cs.energy(scene, x, v)["kinetic"]
        while np.abs(stepper.velocities - v).max() < 0.1 * speed:
            stepper.advance(1, dt)
            if stepper.time > 3 * dt + 2e-6 / speed:
                raise AssertionError("the cell has not met the sphere")
        after = cs.energy(scene, stepper.positions, stepper.velocities)
        expected = before - (1 - restitution**2) * mass * speed**2 / 2
        worst = max(worst, abs(after["kinetic"] + after["elastic"] - expected) / before)
    return {"worst": worst}


def face_drop(dt: float = 1e-4, points: int = 8, after: float = 0.1) -> dict[str, Any]:
    """An undamped sheet falls 0.02 m on a sphere and bounces, restitution 1, no friction.

    Parameters
    ----------
    dt : float
        Time step [s].
    points : int
        Mass points along each side of the sheet of 1 m.
    after : float
        Time from the first contact on [s].

    Returns
    -------
    dict
        "gained" and "lost", the extremes of the total energy, of m g h.
    """
    height = 0.02
    cloth = cs.Cloth((points, points), mass=0.5 * points**2, stiffness=3500.0, damping=0.0, pins=())
    sphere = cs.Sphere((0.5, -0.25 - height, 0.5), 0.25, None, "continuous", "face", restitution=1.0)
    scene = cs.Scene(cloth, sphere)
    stepper = cs.Stepper(scene, threads=1)
    start = cs.energy(scene, stepper.positions, stepper.velocities)["total"]
    changes = []
    looks = 20
    for _ in range(looks):
        stepper.advance(round((math.sqrt(2 * height / GRAVITY) + after) / dt / looks), dt)
        changes.append(cs.energy(scene, stepper.positions, stepper.velocities)["total"] - start)
    scale = cloth.mass_per_point.sum() * GRAVITY * height
    return {"gained": max(0.0, *changes) / scale, "lost": max(0.0, -min(changes)) / scale}


def lying(
    steps: int = 20_000,
    dt: float = 1e-4,
    points: int = 8,
    mass: float = 0.64,
    width: float = 0.1,
    stiffness: float = 500.0,
    precision: Precision = "double",
) -> dict[str, Any]:
    """How quietly a sheet lies on the paper's sphere, restitution 0, friction 0.5.

    Air drags at the sheet, so that corners which hang free come to rest too.

    Parameters
    ----------
    steps : int
        Time steps after 2 s of settling.
    dt : float
        Time step [s].
    points, mass, width, stiffness : int, float, float, float
        Mass points along each side, total mass [kg], side [m] and stiffness [N/m].
    precision : str
        "double" or "single".

    Returns
    -------
    dict
        "speed" [m/s], the largest, and "depth" [m], the deepest of any triangle, over the steps.
    """
    drag = 20.0 * mass / points**2
    cloth = cs.Cloth((points, points), (width, width), mass, stiffness, 0.0, drag, pins=())
    sphere = cs.Sphere((0, -0.25, 0), 0.25, None, "continuous", "face", 0.0, 0.5)
    x = on_sphere(cloth, sphere.center, sphere.contact_radius(cloth), 0.0)
    stepper = cs.Stepper(cs.Scene(cloth, sphere, position=x), threads=1, precision=precision)
    stepper.advance(round(2.0 / dt), dt)
    corners, speed, depth = corner_indices(cloth.shape), 0.0, 0.0
    for _ in range(50):
        stepper.advance(max(1, steps // 50), dt)
        speed = max(speed, float(np.linalg.norm(stepper.velocities, axis=-1).max()))
        centred = stepper.positions.reshape(-1, 3)[corners] - np.array(sphere.center)
        depth = max(depth, sphere.radius - float(nearest_places(centred)[1].min()))
    return {"steps": max(1, steps // 50) * 50, "speed": speed, "depth": max(0.0, depth)}


def draped(points: int = 48, dt: float = 2e-5, duration: float = 5.0, precision: Precision = "double") -> dict[str, Any]:
    """How quietly a light sheet hangs over a sphere, restitution 0, friction 0.5, with drag of the air.

    The sheet of `clothsim contact drape` falls on the sphere. Its folds buckle for some seconds before it rests.

    Parameters
    ----------
    points : int
        Mass points along each side of the sheet of 1 m and 0.3 kg.
    dt : float
        Time step [s].
    duration : float
        Simulated time [s].
    precision : str
        "double" or "single".

    Returns
    -------
    dict
        "speed", the largest of all points, and "median" [m/s], and "depth" [m], the deepest of any triangle, over the
        last 0.1 s.
    """
    mass = 0.3
    cloth = cs.Cloth((points, points), mass=mass, stiffness=60.0, damping=0.0, drag=20 * mass / points**2, pins=())
    sphere = cs.Sphere((0.5, -0.3, 0.5), 0.25, None, "continuous", "face", 0.0, 0.5)
    stepper = cs.Stepper(cs.Scene(cloth, sphere), threads=1, precision=precision)
    stepper.advance(round((duration - 0.1) / dt), dt)
    corners, speed, median, depth = corner_indices(cloth.shape), 0.0, 0.0, 0.0
    for _ in range(20):
        stepper.advance(round(0.005 / dt), dt)
        speeds = np.linalg.norm(stepper.velocities, axis=-1)
        speed, median = max(speed, float(speeds.max())), max(median, float(np.median(speeds)))
        centred = stepper.positions.reshape(-1, 3)[corners] - np.array(sphere.center)
        depth = max(depth, sphere.radius - float(nearest_places(centred)[1].min()))
    return {"speed": speed, "median": median, "depth": max(0.0, depth)}


def symmetry(offset: Offset = "face", times: tuple[float, ...] = (0.017, 0.1, 0.4)) -> list[dict[str, Any]]:
    """How a sheet on a sphere keeps a symmetry of half a turn, and what becomes of a small noise.

    A sheet of 33 x 33 points falls at 1 m/s on a sphere below its middle, restitution 0, friction 0.3, at 1e-4 s.

    Parameters
    ----------
    offset : str
        Offset of the sphere.
    times : tuple of float
        Times after the touch [s].

    Returns
    -------
    list of dict
        "offset", "time" [s], "asymmetry" [m], the largest distance between the sheet and itself after half a turn, and
        "difference" [m], the largest between the sheet and one that starts with noise of 1e-12 m.
    """
    cloth = cs.Cloth((33, 33), mass=0.3, stiffness=100.0, damping=0.02, pins=())
    sphere = cs.Sphere((0, 0, 0), 0.25, None, "continuous", offset, 0.0, 0.3)
    x = cloth.rest_positions - (0.5, -0.2501, 0.5)
    v = np.zeros_like(x) - (0, 1, 0)
    noisy = x + 1e-12 * np.random.default_rng(1).normal(size=x.shape)
    sheets = [cs.Stepper(cs.Scene(cloth, sphere, position=start, velocity=v), threads=1) for start in (x, noisy)]
    found: list[dict[str, Any]] = []
    for time in times:
        for sheet in sheets:
            sheet.advance(round((time - sheet.time) / 1e-4), 1e-4)
        exact, other = (sheet.positions for sheet in sheets)
        far = {"asymmetry": exact[::-1, ::-1] * (-1, 1, -1) - exact, "difference": other - exact}
        found.append({"offset": offset, "time": time, **{name: float(np.abs(way).max()) for name, way in far.items()}})
    return found
