"""Random scenes without contact, and their true solution by a model that shares no code with
clothsim.

The right-hand side is NumPy over the spring list that this file makes for itself; SciPy's DOP853
integrates it twice, at two tolerances. Their distance bounds the error of the finer solution.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

import clothsim as cs
import numpy as np
from scipy.integrate import solve_ivp
from scipy.sparse import csr_matrix

TOLERANCES = 3e-12, 3e-14
SPRINGS = {"structural": ((0, 1), (1, 0)), "shear": ((1, 1), (1, -1)), "bend": ((0, 2), (2, 0))}


@dataclass(frozen=True)
class Case:
    """A scene, how long it runs, and how it was made."""

    name: str
    scene: cs.Scene
    duration: float
    start: str


def draw(seed: int, number: int) -> Case:
    """Scene `number` of the stream `seed`; each is drawn by itself."""
    rng = np.random.default_rng([seed, number])
    rows, columns = (int(n) for n in rng.integers(2, 19, 2))
    families = ("structural", *(f for f in ("shear", "bend") if rng.random() < 0.6))
    if min(rows, columns) < 3 and "bend" in families and max(rows, columns) < 3:
        families = tuple(f for f in families if f != "bend")
    common = 10 ** rng.uniform(2, 6)
    stiffness = dict.fromkeys(families, common)
    if rng.random() < 0.5:
        stiffness = {f: 10 ** rng.uniform(2, 6) for f in families}
    model = str(rng.choice(["spring", "point", "both", "none"]))
    total = 10 ** rng.uniform(-1, 2)
    mass: float | np.ndarray = total
    if rng.random() < 0.3:
        uneven = rng.uniform(0.3, 3.0, (rows, columns))
        mass = total * uneven / uneven.sum()
    point_mass = total / (rows * columns)
    omega = np.sqrt(8 * max(stiffness.values()) / point_mass)
    damping = drag = 0.0
    if model in ("spring", "both"):
        damping = 10 ** rng.uniform(-3, -0.5) * 2 * point_mass * omega / 8
    if model in ("point", "both"):
        drag = point_mass * 10 ** rng.uniform(-1, 1)
    pins = [
        (int(r), int(c))
        for r, c in zip(rng.integers(0, rows, 4), rng.integers(0, columns, 4), strict=True)
    ][: int(rng.integers(0, 5))]
    size = tuple(float(s) for s in rng.uniform(0.5, 1.5, 2))
    cloth = cs.Cloth(
        shape=(rows, columns),
        size=size,
        mass=mass,
        stiffness=stiffness,
        damping=damping,
        drag=drag,
        springs=families,
        pins=tuple(set(pins)),
    )
    # Radians by which the fastest mode turns, roughly: from a short run to 100 steps and more.
    duration = min(10 ** rng.uniform(1.3, 3.0) / omega, 2.0)
    start = str(rng.choice(["flat", "crumpled", "stretched", "moving"]))
    spacing = min(s / max(n - 1, 1) for s, n in zip(size, (rows, columns), strict=True))
    x = cloth.rest_positions.copy()
    v = np.zeros_like(x)
    if start == "crumpled":
        x += rng.standard_normal(x.shape) * spacing * 10 ** rng.uniform(-3, -0.7)
    elif start == "stretched":
        x *= rng.uniform(0.85, 1.3, 3)
    elif start == "moving":
        v = rng.standard_normal(x.shape) * 10 ** rng.uniform(-2, 0.3)
    v[cloth.pinned] = 0
    return Case(f"{seed}/{number}", cs.Scene(cloth, position=x, velocity=v), float(duration), start)


class Model:
    """The equation of motion of a scene without spheres, as SciPy takes it."""

    def __init__(self, scene: cs.Scene) -> None:
        cloth = scene.cloth
        rows, columns = cloth.shape
        grid = np.arange(rows * columns).reshape(rows, columns)
        ends, rest, stiffness, damping = [], [], [], []
        step = np.array([cloth.size[0] / max(rows - 1, 1), cloth.size[1] / max(columns - 1, 1)])
        for family in cloth.springs:
            for down, right in SPRINGS[family]:
                a = grid[: rows - down, max(0, -right) : columns - max(0, right)].ravel()
                b = grid[down:, max(0, right) : columns + min(0, right)].ravel()
                if not len(a):
                    continue
                ends += zip(a, b, strict=True)
                rest += [float(np.hypot(*(step * (down, right))))] * len(a)
                stiffness += [cloth.family_stiffness[family]] * len(a)
                damping += [cloth.family_damping[family]] * len(a)
        self.a, self.b = np.array(ends).T
        n = rows * columns
        count = len(ends)
        springs = np.arange(count)
        self.incidence = csr_matrix(
            (
                np.r_[np.ones(count), -np.ones(count)],
                (np.r_[self.a, self.b], np.r_[springs, springs]),
            ),
            shape=(n, count),
        )
        self.rest, self.stiffness, self.damping = map(np.array, (rest, stiffness, damping))
        self.inverse_mass = np.where(cloth.pinned, 0.0, 1 / cloth.mass_per_point).reshape(-1, 1)
        self.gravity = np.array(scene.gravity) * ~cloth.pinned.reshape(-1, 1)
        self.drag = cloth.drag
        self.n = n
        self.start = np.concatenate(
            [scene.initial_position.ravel(), scene.initial_velocity.ravel()]
        )

    def __call__(self, t: float, y: np.ndarray) -> np.ndarray:
        x, v = y.reshape(2, self.n, 3)
        d = x[self.b] - x[self.a]
        length = np.sqrt(np.einsum("ij,ij->i", d, d))
        pull = self.stiffness * (length - self.rest)
        if self.damping.any():
            pull += self.damping * np.einsum("ij,ij->i", v[self.b] - v[self.a], d) / length
        force = self.incidence @ (d * (pull / length)[:, None]) - self.drag * v
        out = np.empty_like(y)
        out[: 3 * self.n] = y[3 * self.n :]
        out[3 * self.n :] = (force * self.inverse_mass + self.gravity).ravel()
        return out


def rms(difference: np.ndarray) -> float:
    return float(np.sqrt((difference**2).sum(axis=-1).mean()))


def truth(case: Case, folder: Path) -> tuple[np.ndarray, float]:
    """Positions at the end and the rms distance [m] of two computations; kept in `folder`."""
    text = json.dumps([case.scene.to_dict(), case.duration, TOLERANCES], sort_keys=True)
    path = folder / f"{hashlib.sha256(text.encode()).hexdigest()[:24]}.npz"
    if path.exists():
        with np.load(path) as data:
            return data["x"], float(data["bound"])
    model = Model(case.scene)
    ends = []
    size = max(case.scene.cloth.size)
    omega = (
        np.sqrt(8 * model.stiffness.max() * model.inverse_mass.max()) or 1.0
    )  # 0 where all points are pinned
    n = 3 * model.n
    for tolerance in TOLERANCES:
        scale = np.r_[np.full(n, size), np.full(n, size * omega)] * tolerance
        solution = solve_ivp(
            model,
            (0, case.duration),
            model.start,
            "DOP853",
            t_eval=[case.duration],
            rtol=3e-14,
            atol=scale,
        )
        ends.append(solution.y[:n, -1].reshape(*case.scene.cloth.shape, 3))
    bound = rms(ends[1] - ends[0])
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(path, x=ends[1], bound=bound)
    return ends[1], bound
