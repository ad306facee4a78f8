"""The bound of "ray": no point goes back by more than its way in the step, against formulas, the
reference, and the ray as printed, which a plane that it grazes throws far away.
"""

import clothsim as cs
import numpy as np
from points import drifting
from tables import each
from variants import cases

DT, DEPTH = 1e-3, 1e-6  # s, m
GRAZING = (1e-2, 1e-6, 1e-9, 1e-12, 1e-15)  # part of the speed that goes into the plane
FLOOR = cs.Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), response="ray")
# Points in the wedge of two planes may touch both, one after the other.
WEDGE = tuple(cs.Plane((0.0, 0.0, 0.0), (s, 1.0, 0.2), response="ray") for s in (-0.5, 0.5))


def row_below(plane, parts):
    """Return a row of points just below a plane, and velocities of length 1 almost along it.

    Their free step ends DEPTH below the plane, whatever its part of the speed into the plane.
    """
    n = plane.unit_normal
    along = np.cross(n, (0.0, 0.0, 1.0))
    along /= np.linalg.norm(along)
    parts = np.array(parts)[:, None]
    v = np.sqrt(1 - parts**2) * along - parts * n
    x = -DEPTH * n - DT * v
    return np.stack([x, x]), np.stack([v, v])


@cases(restitution=[1.0, 0.5], friction=[0.0, 0.3])
def test_a_point_that_grazes_a_plane_goes_back_by_its_way(variant, restitution, friction):
    plane = FLOOR.replace(restitution=restitution, friction=friction)
    x, v = row_below(plane, GRAZING)
    scene = drifting(x, plane)
    state = cs.step(scene, x, v, DT, t=0.0, **variant.options)
    n = plane.unit_normal
    bound = {"double": 1e-15, "single": 1e-7}[variant.precision]
    free = x + DT * v
    into = -(v @ n)[..., None]
    way = np.minimum(DEPTH / into, DT)  # speed 1: the first of them reaches the plane
    assert (way < DT)[:, 0].all() and (way == DT)[:, 1:].all()
    slide = v + into * n
    v_after = slide + restitution * into * n
    slip = np.linalg.norm(slide, axis=-1, keepdims=True)
    v_after -= np.minimum(slip, friction * (1 + restitution) * into) * slide / slip
    onward = way * v_after if restitution < 1 or friction > 0 else 0.0
    np.testing.assert_allclose(state[0], free - way * v + onward, rtol=0, atol=bound)
    np.testing.assert_allclose(state[1], v_after, rtol=0, atol=bound)
    assert (np.linalg.norm(state[0] - free, axis=-1) <= 2 * DT + bound).all()
    for answer, expected in zip(state, cs.reference_step(scene, x, v, DT, t=0.0), strict=True):
        np.testing.assert_allclose(answer, expected, rtol=0, atol=bound)


@cases(precision=["double"], moving=[False, True])
@each("restitution, friction", [(1.0, 0.0), (0.5, 0.0), (0.0, 0.4)])
def test_among_two_planes_no_point_is_thrown(variant, moving, restitution, friction):
    """Some points are almost in the first plane, others almost in the second, others anywhere."""
    rng = np.random.default_rng(11)
    motion = cs.Linear((0.2, 0.3, -0.1)) if moving else None
    planes = [
        plane.replace(restitution=restitution, friction=friction, motion=motion) for plane in WEDGE
    ]
    parts = [row_below(plane, 10.0 ** -rng.uniform(1, 15, 40)) for plane in planes]
    parts.append((1e-3 * rng.normal(size=(2, 40, 3)), rng.normal(size=(2, 40, 3))))
    x, v = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    v += planes[0].velocity_at(0.0)
    scene = drifting(x, planes)
    state = cs.step(scene, x, v, DT, t=0.0, **variant.options)
    touched = [plane.height(x + DT * v, DT) < 0 for plane in planes]
    assert (touched[0] & touched[1]).sum() > 20
    # A response goes back by at most the way of the step, and on for at most as long.
    speed = np.linalg.norm(v - planes[0].velocity_at(0.0), axis=-1)
    distance = np.linalg.norm(state[0] - (x + DT * v), axis=-1)
    each_way = 1 if restitution == 1 and friction == 0 else 2
    assert (distance <= sum(each_way * touches for touches in touched) * speed * DT + 1e-15).all()
    for answer, expected in zip(state, cs.reference_step(scene, x, v, DT, t=0.0), strict=True):
        np.testing.assert_allclose(answer, expected, rtol=0, atol=1e-13)


@cases(precision=["double"])
def test_the_ray_as_printed_goes_all_the_way(variant):
    """On a sphere of 1 km a ray that grazes it 1e-6 m below its top ends 4.5 cm away."""
    sphere = cs.Sphere((0.0, -1e3, 0.0), 1e3, None, "ray", "none")
    x, v = row_below(FLOOR, [1e-12])
    free = x + DT * v
    chord = np.sqrt(2 * 1e3 * DEPTH)
    for as_printed, way in ((True, chord), (False, DT)):
        scene = drifting(x, sphere.replace(as_printed=as_printed))
        state = cs.step(scene, x, v, DT, t=0.0, **variant.options)
        distance = np.linalg.norm(state[0] - free, axis=-1)
        np.testing.assert_allclose(distance, way, rtol=1e-6)
        expected = cs.reference_step(scene, x, v, DT, t=0.0)
        np.testing.assert_allclose(state[0], expected[0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(state[1], expected[1], rtol=0, atol=1e-9)


def test_a_sheet_that_slides_in_a_groove_makes_no_jump(kernel):
    cloth = cs.Cloth((8, 8), (0.6, 0.6), mass=0.5, stiffness=60.0, damping=0.05, pins=())
    planes = [plane.replace(restitution=0.0) for plane in WEDGE]
    x = cloth.rest_positions - (0.3, -0.23, 0.3)
    stepper = cs.Stepper(cs.Scene(cloth, planes, position=x), kernel=kernel)
    fastest = 0.0
    for _ in range(400):
        before = stepper.positions
        stepper.advance(1, DT)
        speed = np.linalg.norm(stepper.velocities, axis=-1).max()
        way = np.linalg.norm(stepper.positions - before, axis=-1).max()
        assert way <= 2 * max(speed, fastest) * DT
        assert max(cs.penetration(stepper.positions, plane)["points"] for plane in planes) < 1e-5
        fastest = speed
    assert abs(stepper.impulses[:, 1]).min() > 0.5
