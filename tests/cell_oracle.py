"""Offset "cell" in NumPy, from its law: radii of cells, and a step of contact with one sphere."""

import numpy as np


def circle_radius(a, b, c):
    """Radius of the smallest circle around each triangle: that on two corners, or on all three."""
    best = np.full(a.shape[:-1], np.inf)
    for p, q, r in ((a, b, c), (b, c, a), (c, a, b)):
        middle = (p + q) / 2
        radius = np.linalg.norm(p - middle, axis=-1)
        holds = np.linalg.norm(r - middle, axis=-1) <= radius * (1 + 1e-12)
        best = np.where(holds, np.minimum(best, radius), best)
    u, w = b - a, c - a  # centre a + s u + t w, as far from a as from b and c
    uu, ww, uw = (u * u).sum(-1), (w * w).sum(-1), (u * w).sum(-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        s, t = ww * (uu - uw) / (2 * (uu * ww - uw**2)), uu * (ww - uw) / (2 * (uu * ww - uw**2))
        around = np.linalg.norm(s[..., None] * u + t[..., None] * w, axis=-1)
    return np.where(np.isfinite(best), best, around)


def point_radii(x):
    """rho of each point: the largest circle of its cells' triangles, over both diagonals [m]."""
    rows, columns = x.shape[:2]
    a, b, c, d = x[:-1, :-1], x[:-1, 1:], x[1:, :-1], x[1:, 1:]
    cells = np.max(
        [circle_radius(*t) for t in ((a, b, c), (b, d, c), (a, b, d), (a, d, c))], axis=0
    )
    rho = np.zeros((rows, columns))
    for i in (0, 1):
        for j in (0, 1):
            part = rho[i : i + rows - 1, j : j + columns - 1]
            np.maximum(part, cells, out=part)
    return rho


def respond(sphere, x0, v0, x1, v1, dt, t0, free):
    """The state after contact of a step from (x0, v0) at t0 whose free end is (x1, v1), with
    restitution 0.
    """
    x, v = x1.copy(), v1.copy()
    start, end = sphere.center_at(t0), sphere.center_at(t0 + dt)
    speed = (end - start) / dt
    before = point_radii(x0)
    least = np.sqrt(sphere.radius**2 + np.minimum(before, sphere.radius) ** 2)
    p0, q = x0 - start, (x1 - end) - (x0 - start)
    a, b, c = (q * q).sum(-1), (p0 * q).sum(-1), (p0 * p0).sum(-1) - least**2
    root = b**2 - a * np.maximum(c, 0)
    for i in zip(*np.nonzero(free & (b < 0) & (root > 0)), strict=True):
        time = max(c[i], 0.0) / (-b[i] + np.sqrt(root[i]))
        if time > 1:
            continue
        place = p0[i] + time * q[i]
        n = place / np.linalg.norm(place)
        way = (1 - time) * (q[i] - min(q[i] @ n, 0) * n)
        u = v1[i] - speed
        normal = u @ n
        tangential = u - normal * n
        lost = sphere.friction * (max(normal, 0.0) - normal)
        slip = np.linalg.norm(tangential)
        keep = 1 - lost / slip if slip > lost else (1.0 if lost == 0 else 0.0)
        p = place + keep * way
        x[i] = end + p * max(1.0, least[i] / np.linalg.norm(p))
        v[i] = speed + keep * tangential + max(normal, 0.0) * n
    for _ in range(100):
        needed = np.sqrt(
            sphere.radius**2 + np.minimum(np.maximum(before, point_radii(x)), sphere.radius) ** 2
        )
        p = x - end
        distance = np.linalg.norm(p, axis=-1)
        low = free & (distance < needed * (1 - 1e-13))
        if not low.any():
            break
        x[low] = end + p[low] * (needed / distance)[low][:, None]
    return x, v
