"""Ratio of `max_stable_dt` at a state to the true limit, over random scenes; see docs/stability.md.

    python benchmarks/stable_step.py --seed 1 --cases 150       # judge; --seed 0 is for tuning

The true limit comes from dense step matrices. Their tangent matrices are assembled here, spring by
spring, from the derivative of the force, and the step matrices from products of blocks: nothing is
shared with the package but the spring table. Up to the limit no eigenvalue is larger than 1, but
for growth that the equation has as well: of Runge-Kutta methods R(h mu) with Re mu > 0, of the
others real eigenvalues above 1 along whose velocity K is negative (buckling) while damping alone is
within the method's limit.
"""

from __future__ import annotations

import argparse
import math
import time

import clothsim as cs
import numpy as np

FAMILIES = ("structural", "shear", "bend")

GROWTH = 1e-7  # rounding of the dense eigenvalues, of Runge-Kutta methods
ALTERNATING, STEADY = 1e-3, 1e-2  # growth per step that counts, of the other methods
METHODS = tuple(
    name for name, one in cs.integrators().items() if one.explicit and one.imaginary_limit > 0
)


def random_case(rng: np.random.Generator) -> tuple[cs.Scene, np.ndarray, np.ndarray, str]:
    """Return a scene, a state of it, and what they are in words."""
    shape = (int(rng.integers(2, 9)), int(rng.integers(2, 15)))
    while shape[0] * shape[1] > 60:  # dense eigenvalues of six unknowns a point
        shape = (int(rng.integers(2, 9)), int(rng.integers(2, 15)))
    families = FAMILIES[: int(rng.integers(1, 4))]
    stiffness = {f: float(10 ** rng.uniform(2, 6)) for f in families}
    mass = 10 ** rng.uniform(-2, 0.5) * shape[0] * shape[1]
    if rng.random() < 0.4:
        mass = 10 ** rng.uniform(-2, 0.5, size=shape)
    typical = math.sqrt(
        max(stiffness.values()) * np.mean(mass) / (1 if np.ndim(mass) else shape[0] * shape[1])
    )
    size = float(typical * 10 ** rng.uniform(-3, 1))
    kind = str(rng.choice(["none", "spring", "families", "points", "both"]))
    damping = {
        "none": {"damping": 0.0},
        "spring": {"damping": size},
        "families": {"damping": {f: float(size * 10 ** rng.uniform(-2, 0)) for f in families}},
        "points": {"damping": 0.0, "drag": size},
        "both": {"damping": size, "drag": size},
    }[kind]
    scene = cs.Scene(cs.Cloth(shape, mass=mass, stiffness=stiffness, springs=families, **damping))
    x = scene.initial_position
    state = str(rng.choice(["rest", "noise", "stretch", "crumple"]))
    if state == "stretch":
        x = x * rng.uniform(1, 1.5)
    elif state != "rest":
        x = x + rng.normal(size=x.shape) * {"noise": 0.02, "crumple": 0.3}[state] / max(shape)
    v = 0 * x
    if rng.random() < 0.3:
        v = rng.normal(size=x.shape) * 10 ** rng.uniform(-1, 1) * ~scene.cloth.pinned[..., None]
        state += ", moving"
    return scene, x, v, f"{shape} {kind} {state}"


def dense(scene: cs.Scene, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """K and C of the free points, per unit mass: a = -K dx - C dv."""
    cloth = scene.cloth
    x = x.reshape(-1, 3)
    v = v.reshape(-1, 3)
    k, c = (np.zeros((len(x), 3, len(x), 3)) for _ in range(2))
    for spring in cloth.spring_table():
        i, j = int(spring["i"]), int(spring["j"])
        d, w = x[j] - x[i], v[j] - v[i]
        length = math.sqrt(d @ d)
        if length == 0:
            continue
        n = d / length
        turn = (np.eye(3) - np.outer(n, n)) / length  # dn/dd
        pull = spring["stiffness"] * (length - spring["rest_length"]) + spring["damping"] * (w @ n)
        by_d = np.outer(n, spring["stiffness"] * n + spring["damping"] * (turn @ w)) + pull * turn
        by_w = spring["damping"] * np.outer(n, n)
        for to, sign in ((i, 1), (j, -1)):
            k[to, :, j] -= sign * by_d
            k[to, :, i] += sign * by_d
            c[to, :, j] -= sign * by_w
            c[to, :, i] += sign * by_w
    for i in range(len(x)):
        c[i, :, i] += cloth.drag * np.eye(3)
    free = np.flatnonzero(np.repeat(~cloth.pinned.ravel(), 3))
    inverse = np.repeat(1 / cloth.mass_per_point.ravel(), 3)[free, None]
    size = 3 * len(x)
    return tuple(inverse * part.reshape(size, size)[np.ix_(free, free)] for part in (k, c))


def step_matrix(method: str, k: np.ndarray, c: np.ndarray, h: float) -> np.ndarray:
    """Of (x, h v), for the methods that are no Runge-Kutta methods."""
    identity = np.eye(len(k))
    zero = np.zeros_like(k)
    k, c = h * h * k, h * c

    def drift(part):
        return np.block([[identity, part * identity], [zero, identity]])

    def kick(part):
        return np.block([[identity, zero], [-part * k, identity - part * c]])

    if method == "semi_implicit_euler":
        return drift(1) @ kick(1)
    if method == "velocity_verlet":
        corner = identity - k / 2
        cross = identity - c / 2
        # v + (a + a') / 2 with a = -k x - c w and a' = -k x' - c (w + a)
        lower_x = -(k + k @ corner - c @ k) / 2
        lower_w = identity - (c + k @ cross + c - c @ c) / 2
        return np.block([[corner, cross], [lower_x, lower_w]])
    xi = 0.1786178958448091
    la = -0.2123418310626054
    chi = -0.06626458266981849
    first = drift(xi)
    outer = kick((1 - 2 * la) / 2)
    middle = drift(chi)
    inner = kick(la)
    long = drift(1 - 2 * (chi + xi))
    return first @ outer @ middle @ inner @ long @ inner @ middle @ outer @ first


def polynomial(method: str) -> list[float]:
    """Coefficients of a Runge-Kutta method's stability function, from z^0 on."""
    order = {"rk4": 4, "dopri5": 5, "dop853": 8}[method]
    further = {
        "rk4": [],
        "dopri5": [1 / 600],
        "dop853": [
            2.6916922001690827e-06,
            2.3413451082097813e-07,
            1.494736485459155e-08,
            3.6133245781282443e-10,
        ],
    }[method]
    return [1 / math.factorial(n) for n in range(order + 1)] + further


class Truth:
    """Whether a step is stable, by dense matrices."""

    def __init__(self, k: np.ndarray, c: np.ndarray) -> None:
        self.k = k
        self.c = c
        zero = np.zeros_like(k)
        identity = np.eye(len(k))
        self.rates = np.linalg.eigvals(np.block([[zero, identity], [-k, -c]]))
        self.symmetric = np.abs(k - k.T).max() < 1e-9 * np.abs(k).max()

    def stable(self, method: str, h: float) -> bool:
        if method not in ("semi_implicit_euler", "velocity_verlet", "pefrl"):
            z = h * self.rates[self.rates.real <= 1e-7 * np.abs(self.rates)]
            return bool((np.abs(np.polyval(polynomial(method)[::-1], z)) <= 1 + 10 * GROWTH).all())
        values, vectors = np.linalg.eig(step_matrix(method, self.k, self.c, h))
        flow = np.exp(h * self.rates[np.abs(self.rates.imag) > 1e-9 * np.abs(self.rates)])
        if np.sum((values.real < 0) & (np.abs(values) > 1 + ALTERNATING)) > np.sum(
            (flow.real < 0) & (np.abs(flow) > 1 + ALTERNATING / 2)
        ):
            return False
        steady = (values.real >= 0) & (np.abs(values) > 1 + STEADY)
        real = np.abs(values.imag) <= 1e-9 * np.abs(values)
        limit = cs.integrators()[method].real_limit
        for w in vectors[len(self.k) :, steady & real].real.T:
            if not (w @ self.k @ w < 0 and h * (w @ self.c @ w) < limit * (w @ w)):
                return False
        return np.sum(steady & ~real) <= np.sum((flow.real >= 0) & (np.abs(flow) > 1 + STEADY / 2))

    def limit(self, method: str, near: float) -> float:
        """Return the first unstable step from `near` / 4 to 4 `near`, to 0.1 %; else infinity."""
        low = near / 4
        if not self.stable(method, low):
            return low
        high = low
        while self.stable(method, high):
            low = high
            high = 1.04 * high
            if high > 4 * near:
                return math.inf
        while high > 1.001 * low:
            middle = math.sqrt(low * high)
            low, high = (middle, high) if self.stable(method, middle) else (low, middle)
        return low


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, default=1, help="0 tunes, 1 judges (default)")
    parser.add_argument("--cases", type=int, default=150)
    options = parser.parse_args()
    rows = []
    for number in range(options.cases):
        scene, x, v, what = random_case(np.random.default_rng([options.seed, number]))
        truth = Truth(*dense(scene, x, v))
        for method in METHODS:
            begin = time.perf_counter()
            value = cs.max_stable_dt(scene, method, x, v)
            seconds = time.perf_counter() - begin
            if math.isfinite(value):
                ratio = value / truth.limit(method, value)
                guarantee = cs.max_stable_dt(scene, method) / value * ratio
                rows.append((ratio, method, number, what, guarantee, seconds))
    for method in METHODS:
        method_rows = [row for row in rows if row[1] == method]
        rest = [row[4] for row in method_rows if row[3].endswith(("rest", "stretch"))]
        ratios, seconds = [row[0] for row in method_rows], [row[5] for row in method_rows]
        print(
            f"{method:<20} {len(method_rows)} cases, "
            f"value / limit {min(ratios):.4f} to {max(ratios):.4f}, "
            f"guarantee / limit at rest or stretched at most {max(rest):.4f}, "
            f"seconds median {np.median(seconds):.2f}, most {max(seconds):.2f}"
        )
    bad = [row for row in rows if not 0.9 <= row[0] <= 1.0]
    print(f"{len(rows) - len(bad)} of {len(rows)} within 0.9 to 1.0")
    for row in bad:
        print(f"  case {row[2]}: {row[1]} {row[0]:.4f}, {row[3]}")


if __name__ == "__main__":
    main()
