"""What becomes of a triangle that meets a sphere, against the rules written out here in Python."""

import clothsim as cs
import numpy as np
import pytest
from clothsim import _core
from clothsim.contact.triangles import distance

DT = 0.01
TRIANGLES = ((0, 1, 2), (1, 3, 2))  # of a cloth of 2 x 2, in the order in which they are answered


def nearest(corners):
    """Weights of the place of a triangle that is nearest to the origin."""
    best, least = None, np.inf
    for free in ((0, 1, 2), (0, 1), (1, 2), (2, 0), (0,), (1,), (2,)):
        c = corners[list(free)]
        sides = (c[1:] - c[0]).T
        along = np.linalg.lstsq(sides, -c[0], rcond=None)[0] if len(free) > 1 else np.zeros(0)
        weights = np.concatenate([[1 - along.sum()], along])
        far = np.linalg.norm(weights @ c)
        if (weights >= 0).all() and far < least:
            best, least = np.zeros(3), far
            best[list(free)] = weights
    return best


def meeting(p0, p1, radius):
    """The first time at which a moving triangle is as near to the origin as `radius`, or None."""

    def near(t):
        return distance(p0 + np.asarray(t)[..., None, None] * (p1 - p0)) - radius

    t = np.linspace(0, 1, 501)
    inside = near(t) <= 0
    if not inside.any():
        return None
    late = t[inside.argmax()]
    early = max(late - t[1], 0.0)
    for _ in range(40):
        middle = (early + late) / 2
        early, late = (early, middle) if near(middle) <= 0 else (middle, late)
    return late


class Rules:
    """docs/contact.md, "Faces", for a cloth of 2 x 2 and one sphere."""

    def __init__(self, scene, x, v):
        self.scene, self.sphere, self.cloth = scene, scene.spheres[0], scene.cloth
        self.mass = self.cloth.mass_per_point.ravel()
        self.free = ~self.cloth.pinned.ravel()
        centers = [self.sphere.center_at(t) for t in (0.0, DT)]
        self.w = (centers[1] - centers[0]) / DT
        self.start, self.v0, self.end_center = x.reshape(4, 3) - centers[0], v.reshape(4, 3), centers[1]
        x1, v1 = cs.step(scene.replace(spheres=()), x, v, DT)
        self.x, self.v = x1.reshape(4, 3).copy(), v1.reshape(4, 3).copy()
        self.tolerance = 2e-7 * self.sphere.radius

    @property
    def end(self):
        return self.x - self.end_center

    def elastic(self):
        shape = (2, 2, 3)
        return cs.energy(self.scene.replace(spheres=()), self.x.reshape(shape), self.v.reshape(shape))["elastic"]

    def answer(self, corners):
        corners, r = list(corners), self.sphere
        p0, p1 = self.start[corners], self.end[corners]
        t = meeting(p0, p1, r.radius)
        if t is None:
            return False
        place = p0 + t * (p1 - p0)
        weight = nearest(place)
        n = weight @ place
        n /= np.linalg.norm(n)
        share = np.where(self.free[corners], weight / self.mass[corners], 0.0)
        mobility = weight @ share
        share /= mobility
        way, speed = weight @ (p1 - p0), weight @ self.v[corners] - self.w
        press = -(weight @ (self.v - self.v0)[corners]) @ n / DT
        depth = -(1 - t) * min(way @ n, 0.0)
        if depth <= self.tolerance:
            return False
        u, before = speed @ n, self.elastic()
        arrival = np.sqrt(max(u**2 - 2 * press * depth, 0.0))
        leaving = max(u, r.restitution * arrival)
        self.x[corners] += share[:, None] * depth * n
        if 2 * r.restitution * arrival > press * DT:
            plane = self.elastic()
            arrival2 = max(u**2 - 2 * mobility * (plane - before), 0.0)
            up = share[:, None] * r.restitution * depth * n
            self.x[corners] += up
            last2 = r.restitution**2 * arrival2 - 2 * mobility * (self.elastic() - plane)
            if last2 < 0:
                self.x[corners] -= up
            leaving = np.sqrt(last2 if last2 >= 0 else r.restitution**2 * arrival2)
        slide, slip = speed - u * n, np.linalg.norm(speed - u * n)
        lost = min(r.friction * (leaving - u) / slip, 1.0)
        self.x[corners] -= share[:, None] * lost * (1 - t) * (way - (way @ n) * n)
        self.v[corners] += share[:, None] * ((leaving - u) * n - lost * slide)
        return True

    def run(self):
        """How many contacts were answered."""
        answered = 0
        for _ in range(20):
            met = [self.answer(corners) for corners in TRIANGLES]
            answered += sum(met)
            if not any(met):
                break
        return answered

    def clear(self):
        """Whether nothing is left for the last part of the pass, which lifts what is still near."""
        return min(distance(self.end[list(c)]) for c in TRIANGLES) > self.sphere.radius + 20 * self.tolerance


def case(rng, stiffness, pinned):
    """A cell of four different masses on its way to a sphere that meets it between its corners."""
    mass = rng.uniform(0.5, 4.0, (2, 2))
    pins = [tuple(rng.integers(0, 2, 2))] if pinned else ()
    cloth = cs.Cloth((2, 2), mass=mass, stiffness=stiffness, damping=0.0, pins=pins)
    x = cloth.rest_positions + 0.15 * rng.normal(size=(2, 2, 3))
    v = np.where(cloth.pinned[..., None], 0, (0, -20.0, 0) + 8 * rng.normal(size=(2, 2, 3)))
    radius = rng.uniform(0.15, 0.3)
    aim = rng.dirichlet((2, 2, 2, 2)) @ x.reshape(4, 3)
    motion = cs.Linear(tuple(10 * rng.normal(size=3) + (0, 12, 0)))
    sphere = cs.Sphere(
        aim - (0, radius + rng.uniform(0.02, 0.2), 0), radius, motion, "continuous", "face",
        rng.choice((0.0, 0.4, 1.0)), rng.choice((0.0, 0.2, 2.0)),
    )  # fmt: skip
    return cs.Scene(cloth, sphere, (0, 0, 0)), x, v


@pytest.mark.parametrize("stiffness", [0.0, 300.0])
@pytest.mark.parametrize("pinned", [False, True], ids=["free", "a corner pinned"])
def test_triangles_are_answered_by_the_rules(stiffness, pinned):
    rng = np.random.default_rng(11)
    compared = several = 0
    for _ in range(100):
        scene, x, v = case(rng, stiffness, pinned)
        rules = Rules(scene, x, v)
        radius = scene.spheres[0].radius
        way = rules.end - rules.start
        s = np.clip(-(rules.start * way).sum(-1) / (way**2).sum(-1), 0, 1)
        corners = np.linalg.norm(rules.start + s[:, None] * way, axis=-1)
        starts = [distance(rules.start[list(c)]) for c in TRIANGLES]
        if min(corners) < 1.02 * radius or min(starts) < 1.001 * radius:
            continue
        answered = rules.run()
        if not answered or not rules.clear():
            continue
        compared, several = compared + 1, several + (answered > 1)
        after, v_after = cs.step(scene, x, v, DT, t=0.0)
        np.testing.assert_allclose(after.reshape(4, 3), rules.x, rtol=0, atol=2e-6)
        np.testing.assert_allclose(v_after.reshape(4, 3), rules.v, rtol=0, atol=2e-4)
    assert compared >= 15 and several >= 3


def test_the_time_of_a_touch_is_the_first():
    """At it the triangle is as near as asked for, before it is not, whoever comes first."""
    rng = np.random.default_rng(12)
    p0 = rng.normal(size=(200, 3, 3)) * rng.choice((0.3, 2.0), (200, 1, 1)) + (0, 0, 2.0)
    p1 = rng.normal(size=(200, 3, 3)) * rng.choice((0.3, 2.0), (200, 1, 1)) - (0, 0, 1.0)
    outside = distance(p0) > 1.01
    p0, p1 = p0[outside], p1[outside]
    times = _core.triangle_touches(p0, p1, 1.0, 1e-9)
    corner = side = face = 0
    for start, end, t in zip(p0, p1, times, strict=True):
        expected = meeting(start, end, 1.0)
        if expected is None:
            s = np.linspace(0, 1, 2001)[:, None, None]
            assert np.isnan(t) or distance(start + s * (end - start)).min() < 1 + 1e-4
            continue
        np.testing.assert_allclose(t, expected, rtol=0, atol=1e-6)
        parts = (nearest(start + t * (end - start)) > 0).sum()
        corner, side, face = corner + (parts == 1), side + (parts == 2), face + (parts == 3)
    assert min(corner, side, face) > 8
