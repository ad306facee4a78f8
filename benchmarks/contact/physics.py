"""Energy, rest and friction of continuous contact."""

from __future__ import annotations

import math
from typing import Any

import clothsim as cs
import numpy as np
from clothsim.typing import Offset, Precision

GRAVITY = 9.80665


def _bounce(scene: cs.Scene, before: float, after: float, dt: float) -> dict[str, Any]:
    """Energies of an undamped scene at the first contact, and `after` seconds later."""
    stepper = cs.Stepper(scene, threads=1)
    stepper.advance(math.floor(before / dt), dt)
    start = cs.energy(scene, stepper.positions, stepper.velocities)
    stepper.advance(round(after / dt), dt)
    end = cs.energy(scene, stepper.positions, stepper.velocities)
    return {
        "dt": dt,
        "kinetic_at_impact": start["kinetic"],
        "elastic_afterwards": end["elastic"],
        "made": end["total"] - start["total"],
    }


def drop(
    dt: float = 5e-6, height: float = 0.2, after: float = 0.2, offset: Offset = "edge"
) -> dict[str, Any]:
    """Energy that contact makes when an undamped cloth falls on an elastic sphere.

    The paper's cloth falls from the height `height` on its sphere, without pins. It bounces and
    crumples for `after` seconds, without friction and with restitution 1. The exact total energy is
    constant, so any change comes from the contact or the integrator.

    Parameters
    ----------
    dt : float
        Time step [s].
    height, after : float
        Height of the fall [m], time from the first contact on [s].
    offset : str
        Offset of the sphere.

    Returns
    -------
    dict
        "made" [J], "part" of m g h, and the energies of `dt`'s run.
    """
    cloth = cs.Cloth(damping=0.0, pins=())
    sphere = cs.Sphere((0.5, 0.0, 0.5), 0.25, response="continuous", offset=offset, restitution=1.0)
    sphere = sphere.replace(center=(0.5, -height - sphere.contact_radius(cloth), 0.5))
    result = _bounce(cs.Scene(cloth, sphere), math.sqrt(2 * height / GRAVITY), after, dt)
    result["part"] = result["made"] / (cloth.mass_per_point.sum() * GRAVITY * height)
    return result


def under_whole_cloth(
    dt: float = 1e-4, height: float = 0.2, after: float = 0.2, offset: Offset = "none"
) -> dict[str, Any]:
    """As `drop`, on a sphere of 5 m that the whole cloth meets, at a coarse step.

    Returns
    -------
    dict
        "part" of the kinetic energy at impact that contact made.
    """
    cloth = cs.Cloth(damping=0.0, pins=())
    sphere = cs.Sphere((0.5, 0.0, 0.5), 5.0, response="continuous", offset=offset, restitution=1.0)
    sphere = sphere.replace(center=(0.5, -height - sphere.contact_radius(cloth), 0.5))
    result = _bounce(cs.Scene(cloth, sphere), math.sqrt(2 * height / GRAVITY), after, dt)
    result["part"] = result["made"] / result["kinetic_at_impact"]
    return result


def on_sphere(cloth: cs.Cloth, center: Any, radius: float, slope: float) -> np.ndarray:
    """The flat sheet laid on a sphere, its middle at the angle `slope` from the top, towards +x."""
    flat = cloth.rest_positions - np.array((cloth.size[1] / 2, 0.0, cloth.size[0] / 2))
    length = np.linalg.norm(flat, axis=-1, keepdims=True)
    angle = length / radius
    sideways = flat / np.where(length > 0, length, 1)
    x = np.sin(angle) * sideways + np.cos(angle) * np.array((0.0, 1.0, 0.0))
    c, s = math.cos(slope), math.sin(slope)
    turned = x @ np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
    return np.asarray(np.asarray(center) + radius * (1 + 1e-12) * turned)


def cone(
    friction: float,
    slope: float = 0.35,
    duration: float = 0.2,
    dt: float = 1e-4,
    offset: Offset = "none",
) -> dict[str, Any]:
    """A block of cloth at rest on a slope that travels: does it slide?

    The slope is the side of a sphere of 50 m that moves at 3 m/s. The block is 0.1 m x 0.1 m with
    36 mass points. The restitution is 0. With friction mu it stays where mu > tan(slope), and
    slides with g (sin(slope) - mu cos(slope)) where mu is less.

    Parameters
    ----------
    friction : float
        The friction coefficient mu.
    slope : float
        Angle [rad].
    duration, dt : float
        Time the block is watched, and time step [s].
    offset : str
        Offset of the sphere.

    Returns
    -------
    dict
        "slip": motion of the block down the slope against the sphere [m]; "expected": that of the
        formula [m]; "spread": difference between its points [m].
    """
    motion = cs.Linear((3.0, 0.4, -1.0))
    sphere = cs.Sphere(
        (0.0, -50.0, 0.0), 50.0, motion, "continuous", offset, restitution=0.0, friction=friction
    )
    cloth = cs.Cloth((6, 6), (0.1, 0.1), 0.36, 100.0, 0.05, pins=())
    higher = 1e-11 if offset == "cell" else 0.0  # for what the core adds to rho^2
    x = on_sphere(cloth, sphere.center, sphere.contact_radius(cloth) * (1 + higher), slope)
    v = np.broadcast_to(motion.velocity, x.shape)
    stepper = cs.Stepper(cs.Scene(cloth, sphere, position=x, velocity=v), threads=1)
    stepper.advance(round(duration / dt), dt)
    moved = stepper.positions - sphere.center_at(stepper.time) - (x - np.array(sphere.center))
    down = np.array((math.cos(slope), -math.sin(slope), 0.0))
    slips = (moved @ down).ravel()
    acceleration = GRAVITY * (math.sin(slope) - friction * math.cos(slope))
    return {
        "friction": friction,
        "tangent": math.tan(slope),
        "slip": float(slips.mean()),
        "expected": max(acceleration, 0.0) * stepper.time**2 / 2,
        "spread": float(np.ptp(slips)),
    }


def resting(
    steps: int = 10**6, dt: float = 5e-6, precision: Precision = "double", offset: Offset = "none"
) -> dict[str, Any]:
    """How quietly a cloth lies on a sphere at restitution 0.

    A cloth of 0.1 m x 0.1 m with 8 x 8 mass points lies on top of the paper's sphere, with
    friction. It settles for a second, then moves for `steps` more.

    Returns
    -------
    dict
        "touching" mass points, "depth" [m], the deepest that any was inside, "normal_jitter" and
        "jitter" [m], how far any moved along the normal and in all.
    """
    sphere = cs.Sphere(
        (0.5, -0.5, 0.5), 0.25, response="continuous", offset=offset, restitution=0.0, friction=0.7
    )
    cloth = cs.Cloth((8, 8), (0.1, 0.1), 0.64, 500.0, 0.5, pins=())
    x = on_sphere(cloth, sphere.center, sphere.contact_radius(cloth), 0.0)
    stepper = cs.Stepper(cs.Scene(cloth, sphere, position=x), threads=1, precision=precision)
    stepper.advance(20_000, 5e-5)
    first = stepper.positions
    distances = [np.linalg.norm(first - np.array(sphere.center), axis=-1)]
    for _ in range(100):
        stepper.advance(steps // 100, dt)
        distances.append(np.linalg.norm(stepper.positions - np.array(sphere.center), axis=-1))
    heights = np.array(distances)
    return {
        "steps": steps // 100 * 100,
        "touching": int((heights[-1] < sphere.contact_radius(cloth) + 1e-5).sum()),
        "depth": max(0.0, float(sphere.radius - heights.min())),
        "normal_jitter": float(np.ptp(heights, axis=0).max()),
        "jitter": float(np.abs(stepper.positions - first).max()),
    }
