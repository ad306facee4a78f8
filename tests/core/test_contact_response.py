"""What becomes of a mass point that meets spheres, against the rules written out here in Python."""

import clothsim as cs
import numpy as np
import pytest

DT = 0.01
POINT = (1, 1)  # the free one of a cloth of 2 x 2


def ball(center, radius=0.5, motion=None, **arguments):
    return cs.Sphere(
        center, radius, motion, "continuous", "none", **{"restitution": 1.0, **arguments}
    )


class Rules:
    """docs/contact-law.md, "A step with continuous contact", for the free point of 2 x 2."""

    def __init__(self, scene, x, v, dt, precision):
        self.scene, self.dt, self.start = scene.replace(spheres=()), dt, x
        self.epsilon = float(np.finfo({"double": np.float64, "single": np.float32}[precision]).eps)
        x1, v1 = cs.step(self.scene, x, v, dt, t=0.0, precision=precision)
        self.place, self.x, self.v = x[POINT], x1[POINT], v1[POINT]
        self.gain = self.v - v[POINT]
        self.elapsed, self.contacts, self.flown, self.again = 0.0, 0, 0, False
        self.mass = scene.cloth.mass_per_point[POINT]

    def potential(self, place):
        x = self.start.copy()
        x[POINT] = place
        return cs.energy(self.scene, x, 0 * x)["total"]

    def surface(self, sphere):
        """The radius, 2 ulp of |place| + size, and the band over that: where points are put."""
        size = min(sphere.radius, 4 * np.hypot(*self.scene.cloth.size))
        top = sphere.center_at(self.dt) - sphere.radius * np.array(
            self.scene.gravity
        ) / np.linalg.norm(self.scene.gravity)
        return sphere.radius + self.epsilon * (2 * (np.abs(top).sum() + size) + 4 * size)

    def path(self, sphere):
        """In the sphere's frame: where the rest of the way begins, and the rest of the way."""
        start, end = sphere.center_at(0.0), sphere.center_at(self.dt)
        p = self.place - (start + self.elapsed * (end - start))
        return p, self.x - end - p

    def time(self, sphere):
        p, q = self.path(sphere)
        a, b, c = q @ q, p @ q, p @ p - self.surface(sphere) ** 2
        if b >= 0 or b * b <= a * c:
            return np.inf
        t = (-b - np.sqrt(b * b - a * c)) / a
        return max(t, 0.0) if t <= 1 else np.inf

    def answer(self, sphere):
        t, (p, q) = self.time(sphere), self.path(sphere)
        w = (sphere.center_at(self.dt) - sphere.center_at(0.0)) / self.dt
        e, mu = sphere.restitution, sphere.friction
        n = (p + t * q) / np.linalg.norm(p + t * q)
        u, depth = self.v - w, -(1 - t) * (q @ n)
        speed, press = u @ n, -self.gain @ n / self.dt
        bounce = e * np.sqrt(max(speed**2 - 2 * press * depth, 0.0))
        leaving, height = max(speed, bounce), 0.0
        if bounce > 0 and 2 * bounce > press * self.dt:
            self.flown += 1
            plane = self.x + depth * n
            at = [self.potential(y) for y in (self.x, plane, plane + e * depth * n)]
            last2 = e**2 * max(speed**2 + 2 * (at[0] - at[1]) / self.mass, 0.0)
            leaving = np.sqrt(last2)
            last2 += 2 * (at[1] - at[2]) / self.mass
            if last2 >= 0:
                leaving, height = np.sqrt(last2), e * depth
        slide = u - speed * n
        keep = 1.0
        if mu > 0:
            keep = max(1 - mu * (leaving - speed) / (np.linalg.norm(slide) or 1.0), 0.0)
        self.elapsed += t * (1 - self.elapsed)
        start, end = sphere.center_at(0.0), sphere.center_at(self.dt)
        self.place = p + t * q + start + self.elapsed * (end - start)
        self.x = end + p + t * q + keep * ((1 - t) * (q - (q @ n) * n)) + height * n
        self.v = w + keep * slide + leaving * n
        self.contacts += 1

    def run(self, spheres):
        while self.contacts < 16:
            first = min(spheres, key=self.time)
            if self.time(first) == np.inf:
                break
            self.again |= self.contacts > 0 and self.time(first) < 1e-6
            self.answer(first)
            if len(spheres) == 1:
                break


def case(rng, stiffness, spheres):
    """Three pinned corners, and a free one between spheres on their ways, near to the first."""
    mass = rng.uniform(0.5, 4.0, (2, 2))
    pins = ((0, 0), (0, 1), (1, 0))
    cloth = cs.Cloth((2, 2), mass=mass, stiffness=stiffness, damping=0.3, pins=pins)
    x = 3.0 * cloth.rest_positions
    v = np.zeros((2, 2, 3))
    v[POINT] = 20 * rng.normal(size=3)
    balls = []
    for _ in range(spheres):
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)
        radius, w = rng.uniform(0.2, 1.2), 10 * rng.normal(size=3)
        gap = rng.uniform(0.01, 0.1)
        center = x[POINT] - (radius + gap) * n
        # A table whose first part is not the whole step: what counts is the way of the step.
        motion = cs.Keyframes([0.0, 0.3 * DT, DT], center + np.outer((0, 0.2, 1.0), w * DT))
        balls.append(
            ball(
                center,
                radius,
                motion,
                restitution=rng.choice((0.0, 0.4, 1.0)[spheres > 1 :]),
                friction=rng.choice((0.0, 0.2, 2.0)),
            )
        )
    return cs.Scene(cloth, balls, (3.0, -40.0, 5.0)), x, v


@pytest.mark.parametrize("spheres, precision", [(1, "double"), (1, "single"), (2, "double")])
@pytest.mark.parametrize("stiffness", [0.0, 400.0])
def test_responses_of_points_follow_the_formulas(stiffness, spheres, precision):
    rng = np.random.default_rng(21)
    compared = several = flown = 0
    bound = {"double": 1e-11, "single": 2e-5}[precision]
    for _ in range(100):
        scene, x, v = case(rng, stiffness, spheres)
        rules = Rules(scene, x, v, DT, precision)
        rules.run(scene.spheres)
        ends = [np.linalg.norm(rules.x - s.center_at(DT)) - rules.surface(s) for s in scene.spheres]
        # Rounding decides whether a point in the tangent plane touches again.
        if rules.contacts == 0 or rules.again or min(ends) < -1e-12:
            continue
        compared += 1
        several += rules.contacts > 1
        flown += rules.flown
        after, v_after = cs.step(scene, x, v, DT, t=0.0, precision=precision)
        np.testing.assert_allclose(after[POINT], rules.x, rtol=0, atol=bound)
        np.testing.assert_allclose(v_after[POINT], rules.v, rtol=0, atol=100 * bound)
    assert compared >= 18 and flown >= 8
    assert spheres == 1 or several >= 3


def test_after_16_contacts_in_a_step_a_point_is_stopped_where_it_is():
    """A hundred times to and fro in a step: the 16th contact is with the sphere on the left."""
    cloth = cs.Cloth((1, 2), stiffness=0.0, damping=0.0, pins=((0, 1),))
    x, v = np.array([[(0.1, 0, 0), (90.0, 90, 90)]]), np.array([[(100.0, 0, 0), (0, 0, 0.0)]])
    scene = cs.Scene(cloth, [ball((-1.0, 0, 0)), ball((1.0, 0, 0))], (0, 0, 0))
    after, v_after = cs.step(scene, x, v, 1.0, t=0.0)
    np.testing.assert_allclose(after[0, 0], (-0.5, 0, 0), rtol=0, atol=1e-13)
    np.testing.assert_allclose(v_after[0, 0], (100.0, 0, 0), rtol=0, atol=1e-12)


@pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")
@pytest.mark.parametrize(
    "start, speed, distance, left",
    [
        (0.4, -3.0, 0.404, 0.0),  # inwards: stopped, and pushed
        (0.4, 0.1, 0.404, 0.1),  # outwards by less than the push: the push alone
        (0.4, 2.0, 0.42, 2.0),  # outwards by more: its own way, and its speed
        (0.498, -3.0, 0.5, 0.0),  # to the surface and no further
        (0.4, 30.0, 0.7, 30.0),  # out by itself
    ],
)
def test_a_point_that_starts_inside_goes_out_at_the_speed_of_the_push(start, speed, distance, left):
    """0.4 m/s for 0.01 s; what it does sideways is its own matter."""
    n, aside = np.array([0.6, 0.8, 0]), np.array([0, 0, 1.0])
    sphere = ball((0, 0, 0), push_out_speed=0.4, friction=0.5)
    cloth = cs.Cloth((1, 2), stiffness=0.0, damping=0.0, pins=((0, 1),))
    x = np.array([[start * n, (90.0, 90, 90)]])
    v = np.array([[speed * n + 1e-3 * aside, (0, 0, 0.0)]])
    after, v_after = cs.step(cs.Scene(cloth, sphere, (0, 0, 0)), x, v, DT, t=0.0)
    np.testing.assert_allclose(np.linalg.norm(after[0, 0]), distance, rtol=0, atol=1e-9)
    assert np.linalg.norm(after[0, 0]) >= distance - 1e-15
    np.testing.assert_allclose(v_after[0, 0] @ n, left, rtol=0, atol=1e-6)
    np.testing.assert_allclose(v_after[0, 0] @ aside, 1e-3, rtol=0, atol=1e-4)
