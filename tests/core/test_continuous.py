"""Continuous contact: time of impact, what follows it, and what never happens."""

import warnings

import clothsim as cs
import numpy as np
import pytest
from contact import drop, resting, under_whole_cloth
from contact.physics import on_sphere
from contact_fuzz import crossings
from points import CENTER, RADIUS, drifting, one_point

DT = 1e-3


def ball(**arguments):
    return cs.Sphere(**{"center": CENTER, "radius": RADIUS, "offset": "none", "restitution": 1.0, **arguments})


@pytest.mark.parametrize("restitution, height", [(1.0, 2.5), (0.5, 1.5), (0.0, 0.5)])
def test_a_head_on_hit_turns_round_at_the_surface(variant, restitution, height):
    """From 1 above the centre, 4 a step: at the surface after 0.5, the other 3.5 e lead up."""
    x, v = one_point((0, 1, 0), (0, -4, 0), ball(restitution=restitution), 1.0, **variant.options)
    bound = {"double": 1e-14, "single": 2e-6}[variant.precision]
    height = 0.5 + 3.5 * restitution
    np.testing.assert_allclose(x, (0, height, 0), rtol=0, atol=4 * bound)
    np.testing.assert_allclose(v, (0, 4 * restitution, 0), rtol=0, atol=bound)


def test_a_slanting_hit_and_friction():
    """At (0.3, 0.4) the normal is (0.6, 0.8): 3-4-5 triangles all the way."""
    start, way = np.array([0.3, 1.4, 0]), np.array([0.0, -2.0, 0])
    n, along = np.array([0.6, 0.8, 0]), np.array([0.8, -0.6, 0])
    place = np.array([0.3, 0.4, 0])
    for friction, kept in ((0.0, 1.0), (0.25, 1 - 0.25 * 3.2 / 1.2), (1.0, 0.0)):
        x, v = one_point(start, way, ball(friction=friction), 1.0)
        out = 1.6 * n + 1.2 * kept * along
        np.testing.assert_allclose(v, out, rtol=0, atol=1e-13)
        np.testing.assert_allclose(x, place + out / 2, rtol=0, atol=1e-13)


def test_a_moving_sphere_hits_in_its_own_frame():
    """A sphere that comes at speed 5: off at 10, from where they met at 0.1 of the step."""
    x, v = one_point((1.0, 0, 0), (0, 0, 0), ball(motion=cs.Linear((5.0, 0, 0))), 1.0)
    np.testing.assert_allclose(v, (10, 0, 0), rtol=0, atol=1e-13)
    np.testing.assert_allclose(x, (1 + 10 * 0.9, 0, 0), rtol=0, atol=1e-13)


@pytest.mark.parametrize("miss", [1e-9, 1e-6, 1e-3, -1e-9, -1e-6, -1e-3])
@pytest.mark.parametrize("far", [1.0, 1e3])
def test_grazing_is_decided_to_rounding(miss, far):
    """Past the sphere at RADIUS + miss: turned below, left alone to the bit above."""
    v = np.array([2 * far, 0, 0])
    _, after = one_point((-far, RADIUS + miss, 0), v, ball(), 1.0)
    assert (after == v).all() == (miss > 0)


def test_kernels_agree(crumpled, kernel, precision):
    """To rounding; tests/core/test_impacts.py compares the law itself with the reference."""
    sphere = cs.Sphere(
        (0.6, -0.2, 0.4), 0.25, cs.Linear((0, 1.5, 0.3)), "continuous", friction=0.1, offset="edge", restitution=1.0
    )
    scene, x, v, _ = crumpled(spheres=sphere)
    dt = 1e-3  # a bounce that one has and the other not is below the bound
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cs.ContactWarning)
        for restitution in (0.0, 0.6, 1.0):
            one = scene.replace(spheres=sphere.replace(restitution=restitution))
            here, met, decided = (x, v), 0, 0
            for k in range(40):
                free = cs.step(one.replace(spheres=()), *here, dt, kernel="gather")
                expected = cs.step(one, *here, dt, t=k * dt, kernel="gather")
                result = cs.step(one, *here, dt, t=k * dt, kernel=kernel, precision=precision)
                met += int((expected[0] != free[0]).any(axis=-1).sum())
                bound = {"double": 1e-12, "single": 1e-3}[precision]
                for mine, exact in zip(result, expected, strict=True):
                    difference = np.abs(mine - exact).max(axis=-1) / np.abs(exact).max()
                    decided += int((difference > bound).sum())
                    assert difference.max() < 1e-2
                here = expected
            # Where rounding, or the slop of single, decides whether a point touches or flies, the
            # results are apart by a little.
            assert met > 200 and decided < 0.05 * met


@pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")
@pytest.mark.parametrize("offset, restitution", [("none", 0.2), ("cell", 0.0), ("cell", 0.5)])
def test_bits_do_not_depend_on_threads_in_a_large_cloth(offset, restitution, kernel, same_bits):
    """Contact has a second thread from 2 x 8,192 points on."""
    cloth = cs.Cloth((129, 131), stiffness=300.0, pins=())
    sphere = cs.Sphere((0.5, -0.6, 0.5), 0.6, cs.Linear((0, 4.0, 0)), "continuous", offset, restitution, 0.3)
    scene = cs.Scene(cloth, sphere)
    x, v = scene.initial_position, scene.initial_velocity
    expected = cs.step(scene, x, v, 4e-5, 60, t=0.0, threads=1, kernel=kernel)
    assert (np.abs(expected[1][..., 1] - 4.0) < 2.0).sum() > 100
    for threads in (2, 3):
        assert same_bits(cs.step(scene, x, v, 4e-5, 60, t=0.0, threads=threads, kernel=kernel), expected)
    deep = cs.penetration(expected[0], sphere, 60 * 4e-5)
    assert deep["points"] == 0


@pytest.mark.parametrize("changes", [{"offset": "edge"}, {"friction": 0.3}, {"restitution": 0.5}], ids=str)
def test_gather_bits_are_those_of_every_instruction_set(monkeypatch, same_bits, changes):
    scene = cs.scenes.paper_moving("continuous", phase=0.48, period=2.0)
    scene = scene.replace(velocity=np.where(scene.cloth.pinned[..., None], 0, (0.1, -1.0, 0.2)))
    scene = scene.replace(spheres=scene.spheres[0].replace(**{"offset": "cell", **changes}))
    results = []
    for name in cs.build_config()["instruction_sets_supported"]:
        monkeypatch.setenv("CLOTHSIM_ISA", name)
        for precision in ("double", "single"):
            stepper = cs.Stepper(scene, precision=precision, kernel="gather")
            stepper.advance(600, 3e-4)
            results.append((precision, (stepper.positions, stepper.velocities)))
    for precision, result in results:
        assert same_bits(result, dict(reversed(results))[precision])
    free = cs.step(scene.replace(spheres=()), scene.initial_position, scene.initial_velocity, 3e-4, 600)
    assert np.abs(free[0] - results[0][1][0]).max() > 1e-2


@pytest.mark.parametrize(
    "count, options",
    [(400_000, {}), (400_000, {"seed": 3, "precision": "single"}), pytest.param(10**8, {"seed": 2}, marks=pytest.mark.slow)],
)
def test_nothing_passes(count, options):
    """In single the state is compensated, and the time of impact is found in double all the same."""
    result = crossings(count, **options)
    assert result["hits"] > count / 5
    assert result["inside"] == 0 and result["crossings"] == 0 and result["deepest"] <= 0


@pytest.mark.parametrize("response", ["ray", "reflect"])
def test_the_check_of_passing_can_fail(response):
    result = crossings(100_000, response=response)
    assert result["inside"] > 1000 and result["crossings"] > 30_000


def test_a_test_per_step_misses_q2_over_3_of_fast_points():
    """q: step over radius. Averaged over the disc that a sphere shows, the first half of the
    chord, where a point still approaches, is missed with the probability q^2/3; literally, where
    the second half counts too, q^2/12. "continuous" misses none."""
    rng = np.random.default_rng(5)
    n, q = 40_000, 0.9
    x = np.zeros((n // 200, 200, 3))
    x[..., 1] = RADIUS * np.sqrt(rng.random(x.shape[:2]))
    x[..., 0] = -RADIUS * (1 + q * (0.5 + rng.random(x.shape[:2])))
    x += CENTER
    v = np.zeros_like(x)
    v[..., 0] = q * RADIUS / DT

    def missed(**arguments):
        _, after = cs.step(drifting(x, ball(**arguments)), x, v, DT, 6, t=0.0)
        return float((after == v).all(axis=-1).mean())

    assert missed(response="continuous") == 0
    for response in ("ray", "reflect"):
        for as_printed, expected in ((False, q**2 / 3), (True, q**2 / 12)):
            part = missed(response=response, as_printed=as_printed)
            assert abs(part - expected) < 4 * np.sqrt(expected / n)


@pytest.mark.parametrize(
    "dt, offset, bound",
    [
        (2e-5, "edge", 1e-9),
        (1e-4, "cell", 1e-5),
        (2e-5, "cell", 1e-5),
        pytest.param(5e-6, "edge", 1e-6, marks=pytest.mark.slow),
    ],
)
def test_contact_makes_no_energy(dt, offset, bound):
    """1e-6 of m g h is asked for at 5e-6 s; four times the step already has it. A radius rho that grows moves points
    against their springs: 6e-6 of m g h.
    """
    result = drop(dt, offset=offset)
    assert result["elastic_afterwards"] > 100
    assert abs(result["part"]) < bound


@pytest.mark.parametrize("offset, bound", [("none", 1e-3), ("cell", 2e-9)])
def test_contact_under_the_whole_cloth_makes_no_energy(offset, bound):
    result = under_whole_cloth(offset=offset)
    assert result["kinetic_at_impact"] > 900
    assert abs(result["part"]) < bound


@pytest.mark.parametrize("offset", ["none", "cell"])
@pytest.mark.parametrize("steps", [20_000, pytest.param(10**6, marks=pytest.mark.slow)])
def test_a_state_at_rest_stays_at_rest(steps, offset, precision):
    """`python benchmarks/contact --full` watches 1e6 steps too."""
    result = resting(steps, precision=precision, offset=offset)
    assert result["touching"] == 64 and result["depth"] == 0
    assert result["normal_jitter"] < 1e-6 if offset == "none" else result["normal_jitter"] == result["jitter"] == 0


@pytest.mark.parametrize("restitution, friction", [(0.0, 0.0), (0.0, 0.6), (0.5, 0.1)])
def test_the_fast_way_at_rest_is_that_of_gather(restitution, friction):
    """A sheet that lies on a sphere on its way, pinned in a corner: it slides or sticks.

    With restitution the speed that is left of a press is the root of a difference that vanishes.
    """
    motion = cs.Linear((0.3, 0.2, -0.1))
    sphere = cs.Sphere((0.1, -2, 0.2), 2, motion, "continuous", "none", restitution, friction)
    cloth = cs.Cloth((12, 11), (0.5, 0.5), 1.3, 300.0, 0.3, pins=((0, 0),))
    x = on_sphere(cloth, sphere.center, sphere.radius, 0.1)
    v = np.where(cloth.pinned[..., None], 0, motion.velocity + np.array((0.05, -0.2, 0.03)))
    x[0, 0, 1] += 0.2
    scene = cs.Scene(cloth, sphere, position=x, velocity=v)
    dt, free, answered = 1e-4, scene.replace(spheres=()), 0
    bound = 1e-13 if restitution == 0 else 1e-8
    stepper = cs.Stepper(scene)
    for _ in range(30):
        stepper.advance(10, dt)
        state, t = (stepper.positions, stepper.velocities), stepper.time
        exact = cs.step(scene, *state, dt, t=t, kernel="gather")
        fast = cs.step(scene, *state, dt, t=t)
        untouched = cs.step(free, *state, dt)
        answered += int((untouched[1] != fast[1]).any(axis=-1).sum())
        flown = np.abs(fast[1] - exact[1]).max(axis=-1) > 1e-4  # one takes off, the other stays
        assert flown.sum() <= 2
        for mine, theirs, scale in zip(fast, exact, (1, 10), strict=True):
            assert np.abs(mine - theirs)[~flown].max() < scale * bound
    assert answered > 30


def test_rest_keeps_no_trace_of_the_time_step():
    """A single point on the pole at restitution 0: the position does not change by a bit."""
    cloth = cs.Cloth((1, 2), stiffness=0.0, damping=0.0, pins=((0, 1),))
    sphere = ball(restitution=0.0)
    x = np.array([[CENTER + (0, RADIUS + 1e-15, 0), (9.0, 9, 9)]])
    stepper = cs.Stepper(cs.Scene(cloth, sphere, position=x))
    stepper.advance(10, 1e-4)
    rest = stepper.positions
    for dt in (1e-4, 1e-6, 1e-3):
        stepper.advance(1000, dt)
        assert np.abs(stepper.positions - rest).max() <= 2e-16
        assert np.abs(stepper.velocities).max() == 0


def test_a_bounce_loses_its_height_by_the_square_of_restitution():
    """Heights of successive bounces of one point: e^2 of the one before, to dt accuracy."""
    cloth = cs.Cloth((1, 2), stiffness=0.0, damping=0.0, pins=((0, 1),))
    x = np.array([[CENTER + (0, RADIUS + 0.1, 0), (9.0, 9, 9)]])
    scene = cs.Scene(cloth, ball(restitution=0.7), position=x)
    stepper = cs.Stepper(scene)
    heights = []
    for _ in range(7000):
        stepper.advance(1, 1e-4)
        heights.append(stepper.positions[0, 0, 1] - CENTER[1] - RADIUS)
    h = np.array(heights)
    peaks = h[1:-1][(h[1:-1] >= h[:-2]) & (h[1:-1] > h[2:]) & (h[1:-1] > 1e-3)]
    np.testing.assert_allclose(peaks[:3], 0.1 * 0.49 ** np.arange(1, 4), rtol=2e-5)
    assert h.min() >= 0
