"""Contacts: the responses against formulas written here, kernels against the reference."""

import itertools

import clothsim as cs
import numpy as np
import pytest
from points import CENTER, RADIUS, drifting, one_point
from tables import each
from variants import cases

DT = 1e-3


def ball(**arguments):
    return cs.Sphere(CENTER, RADIUS, **{"response": "ray", "offset": "none", **arguments})


def cloud(seed=1, shape=(11, 19), reach=1.0):
    """Points all over a cube around the sphere, with velocities in all directions."""
    rng = np.random.default_rng(seed)
    x = CENTER + rng.uniform(-reach, reach, (*shape, 3)) * RADIUS
    return x, rng.normal(size=(*shape, 3))


def answered(x, v, sphere, t, radius=RADIUS):
    """Kim et al., eq 7-12 with errata corrected, restitution and Coulomb friction, per point."""
    center = sphere.center_at(t)
    velocity = sphere.velocity_at(t)
    if sphere.as_printed:
        velocity = np.zeros(3)
    x = x.copy()
    v = v.copy()
    for at in np.ndindex(x.shape[:2]):
        m, u = x[at] - center, v[at] - velocity
        if np.linalg.norm(m) >= radius:
            continue
        if sphere.response == "ray":
            if m @ u > 0 and not sphere.as_printed:
                continue
            # |m - s u| = radius, the root s > 0
            s = max(np.roots([u @ u, -2 * m @ u, m @ m - radius**2]).real)
            if not sphere.as_printed:  # it goes back no further than it came in the step
                s = min(s, DT)
            m = m - s * u
            x[at] = center + m
            travels = not sphere.as_printed and (sphere.restitution < 1 or sphere.friction > 0)
        n = m / np.linalg.norm(m)
        speed = u @ n
        if speed >= 0 and not sphere.as_printed:
            continue
        impulse = (1 + sphere.restitution) * speed
        tangential = u - speed * n
        slip = np.linalg.norm(tangential)
        loss = min(slip, sphere.friction * abs(impulse))
        v[at] = v[at] - impulse * n - loss * tangential / slip
        if sphere.response == "ray" and travels:  # the rest of the step
            x[at] += s * (v[at] - velocity)
    return x, v


SLIDES = [(1.0, 0.0), (0.4, 0.0), (0.7, 0.3), (0.0, 9.0)]  # restitution, friction


@cases(
    precision=["double"],
    response=["reflect", "ray"],
    moving=[False, True],
    as_printed=[False, True],
)
@each("restitution, friction", SLIDES)
def test_responses_are_those_of_the_formulas(
    variant, response, moving, as_printed, restitution, friction
):
    motion = cs.Linear((1.5, -0.7, 0.4)) if moving else None
    sphere = ball(
        response=response,
        motion=motion,
        restitution=restitution,
        friction=friction,
        as_printed=as_printed,
    )
    x, v = cloud()
    t = 0.03
    expected = answered(x + DT * v, v, sphere, t + DT)
    touched = np.abs(expected[1] - v).max(axis=-1) > 1e-6
    assert 20 < touched.sum() < 150
    result = cs.step(drifting(x, sphere), x, v, DT, t=t, **variant.options)
    np.testing.assert_allclose(result[0], expected[0], rtol=0, atol=1e-13)
    np.testing.assert_allclose(result[1], expected[1], rtol=0, atol=1e-13)
    reference = cs.reference_step(drifting(x, sphere), x, v, DT, t=t)
    np.testing.assert_allclose(reference[0], expected[0], rtol=0, atol=1e-13)
    np.testing.assert_allclose(reference[1], expected[1], rtol=0, atol=1e-13)


@cases()
@each("speed", [0.0, 1e-300, 1e-200, 1e-170, 1e-160, 1e-155, 1e-100, 1e-20])
def test_the_ray_of_a_slow_point(variant, speed):
    """No velocity has no ray: the point is projected along the normal. A slow one has one: as
    printed to the surface, else by the way of the step.
    """
    position = np.array([0.1, -0.2, 0.15])
    bound = {"double": 1e-12, "single": 1e-7}[variant.precision]
    surface = RADIUS * position / np.linalg.norm(position)
    if variant.precision == "single":
        speed = float(np.float32(speed))
    for as_printed in (False, True):
        sphere = ball(response="ray", as_printed=as_printed)
        x, v = one_point(position, -speed * position, sphere, **variant.options)
        place = surface if as_printed or speed == 0 else position
        np.testing.assert_allclose(x, place, atol=bound)
        assert np.abs(v).max() <= speed
        assert speed == 0 or v @ position >= 0


@pytest.mark.parametrize("response", ["reflect", "ray"])
def test_pinned_points_never_move(variant, response):
    x, v = cloud()
    pins = np.random.default_rng(2).random(x.shape[:2]) < 0.5
    v[pins] = 0
    x = x.astype(np.float32).astype(float)
    sphere = ball(response=response, motion=cs.Linear((0.2, 0.1, 0.0)))
    is_inside = np.linalg.norm(x - CENTER, axis=-1) < RADIUS
    assert (is_inside & pins).sum() > 10
    xt, vt = cs.step(drifting(x, sphere, pins), x, v, DT, 50, t=0.0, **variant.options)
    np.testing.assert_array_equal(xt[pins], x[pins])
    assert (vt[pins] == 0).all()
    assert (np.abs(vt - v)[is_inside & ~pins].max(axis=-1) > 0).any()


@cases(precision=["double"], response=["reflect", "ray"])
def test_several_spheres_respond_in_their_order(variant, response):
    spheres = [
        ball(response=response, restitution=0.5),
        cs.Sphere(CENTER + (0.3, 0.1, 0), 0.4, response=response, offset=0.02, restitution=1.0),
        cs.Sphere(
            CENTER - (0.2, 0.2, 0.1),
            0.3,
            cs.Linear((1, 0, 0)),
            response,
            0.0,
            restitution=0.8,
            friction=0.2,
        ),
    ]
    x, v = cloud()
    expected = x + DT * v, v
    for sphere, radius in zip(spheres, (RADIUS, 0.42, 0.3)):
        expected = answered(*expected, sphere, DT, radius)
    result = cs.step(drifting(x, spheres), x, v, DT, t=0.0, **variant.options)
    for part, expected_part in zip(result, expected):
        np.testing.assert_allclose(part, expected_part, rtol=0, atol=1e-12)
    reverse = cs.step(drifting(x, spheres[::-1]), x, v, DT, t=0.0, **variant.options)
    assert np.abs(reverse[0] - result[0]).max() + np.abs(reverse[1] - result[1]).max() > 1e-3


MOTIONS = [
    cs.Linear((0.4, -0.3, 0.2)),
    cs.Reciprocate((1, 1, 0), 0.4, 0.05, 3.0, 0.2),
    cs.Reciprocate((0, 1, 0), 0.4, 0.05, 0.0),
    cs.Keyframes([0.0, 0.02, 0.05], [CENTER, CENTER + (0.1, 0, 0), CENTER - (0, 0.2, 0)]),
    cs.Keyframes([-1.0, 0.02, 0.05, 1.0], CENTER + 0.1 * np.eye(4, 3), smooth=True),
    cs.Sinusoid((0.1, -0.2, 0.0), 9.0, 0.3),
]


@pytest.mark.parametrize("motion", MOTIONS, ids=lambda m: type(m).__name__)
def test_the_core_moves_spheres_as_python_does(motion):
    """A point at rest inside lands on the surface of the sphere where it is at the step's end."""
    sphere = ball(response="ray", as_printed=True, motion=motion)
    for t in (0.0, 0.013, 0.02, 0.031, 0.049, 0.08, -0.01):
        center = sphere.center_at(t + DT)
        x = np.tile(center + (0.05, 0.1, -0.02), (2, 2, 1))
        after, _ = cs.step(drifting(x, sphere), x, 0 * x, DT, t=t)
        np.testing.assert_allclose(np.linalg.norm(after - center, axis=-1), RADIUS, rtol=1e-13)
        core = ball(response="reflect", motion=motion)
        _, v = cs.step(drifting(x, core), x, 0 * x, DT, t=t)
        n = (x[0, 0] - center) / np.linalg.norm(x[0, 0] - center)
        kick = -2 * min(-core.velocity_at(t + DT) @ n, 0) * n
        np.testing.assert_allclose(v[0, 0], kick, atol=1e-11)


@cases(response=["reflect", "ray"])
@each("offset, reach", [("none", 0.25), ("edge", 0.25 + 5.2e-4), (0.03, 0.28)])
def test_the_offset_is_where_contact_begins(variant, response, offset, reach):
    """On the paper's cloth eq 13 gives 0.52 mm."""
    scene = cs.Scene(
        cs.Cloth(stiffness=0.0, damping=0.0, pins=()),
        gravity=(0, 0, 0),
        spheres=cs.Sphere((0, 0, 0), 0.25, response=response, offset=offset, restitution=1.0),
    )
    exact = scene.spheres[0].contact_radius(scene.cloth)
    assert abs(exact - reach) < 2e-6
    x = np.full((32, 32, 3), 9.0)
    v = np.zeros((32, 32, 3))
    x[5, 7], v[5, 7] = (0, exact + 2e-6, 0), (0, -1e-3, 0)
    x[6, 8], v[6, 8] = (0, exact + 1e-6, 0), (0, -3.0, 0)
    xt, vt = cs.step(scene, x, v, 1e-6, t=0.0, **variant.options)
    assert vt[5, 7, 1] < 0 < vt[6, 8, 1]
    if response == "ray":
        assert abs(xt[6, 8, 1] - exact) < {"double": 1e-15, "single": 1e-7}[variant.precision]


@cases(response=["reflect", "ray"])
@each("as_printed, motion", itertools.product((False, True), (None, cs.Linear((0.0, 1.5, 0.3)))))
def test_kernels_agree_with_the_reference_over_contact(
    variant, crumpled, relative, response, as_printed, motion
):
    spheres = [
        cs.Sphere(
            (0.6, -0.2, 0.4),
            0.25,
            motion,
            response,
            friction=0.1,
            as_printed=as_printed,
            offset="edge",
            restitution=1.0,
        ),
        cs.Sphere(
            (0.1, 0.15, 0.7),
            0.2,
            None,
            response,
            restitution=0.5,
            as_printed=as_printed,
            offset="edge",
        ),
    ]
    scene, x, v, dt = crumpled(spheres=spheres)
    free = cs.reference_step(scene.replace(spheres=()), x, v, dt, 40)
    expected = cs.reference_step(scene, x, v, dt, 40, t=0.0)
    assert relative(expected, free, x) > 1e-2
    result = cs.step(scene, x, v, dt, 40, t=0.0, **variant.options)
    # Contact multiplies rounding: 1e4 times what it is without.
    assert relative(result, expected, x) < {"double": 1e-10, "single": 1e-2}[variant.precision]


@cases(precision=["double", "single"], axis=[0, 1, 2], side=[-1, 1], response=["reflect", "ray"])
def test_a_sphere_is_met_from_every_side(variant, axis, side, response):
    toward = -side * np.eye(3)[axis]
    sphere = cs.Sphere(
        (0.5, 0.0, 0.5) - 0.9 * toward,
        0.2,
        cs.Linear(100.0 * toward),
        response,
        "none",
        restitution=0.5,
    )
    cloth = cs.Cloth((16, 12), stiffness=10.0, damping=0.0, pins=())
    scene = cs.Scene(cloth, sphere, gravity=(0, 0, 0))
    x = cloth.rest_positions
    v = np.zeros((16, 12, 3))
    steps = 45 if axis == 1 else 15  # steps until the contact, which magnifies rounding
    expected = cs.reference_step(scene, x, v, 2e-4, steps, t=0.0)
    assert (np.abs(expected[1]).max(axis=-1) > 10).sum() > 2
    result = cs.step(scene, x, v, 2e-4, steps, t=0.0, **variant.options)
    bound = {"double": 1e-7, "single": 2e-3}[variant.precision]
    np.testing.assert_allclose(result[0], expected[0], rtol=0, atol=bound)


def test_a_test_per_step_misses_q2_over_3_of_fast_points():
    """q: step over radius. Averaged over the disc that a sphere shows, the first half of the
    chord, where a point still approaches, is missed with the probability q^2/3; literally, where
    the second half counts too, q^2/12.
    """
    rng = np.random.default_rng(5)
    n = 40_000
    q = 0.9
    x = np.zeros((n // 200, 200, 3))
    x[..., 1] = RADIUS * np.sqrt(rng.random(x.shape[:2]))
    x[..., 0] = -RADIUS * (1 + q * (0.5 + rng.random(x.shape[:2])))
    x += CENTER
    v = np.zeros_like(x)
    v[..., 0] = q * RADIUS / DT
    for response in ("ray", "reflect"):
        for as_printed, expected in ((False, q**2 / 3), (True, q**2 / 12)):
            scene = drifting(x, ball(response=response, as_printed=as_printed, restitution=1.0))
            _, after = cs.step(scene, x, v, DT, 6, t=0.0)
            part = float((after == v).all(axis=-1).mean())
            assert abs(part - expected) < 4 * np.sqrt(expected / n)
