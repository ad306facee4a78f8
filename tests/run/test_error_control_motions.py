"""Error control where pins and spheres move.

No motion is stepped over, contact is as with short steps, and every call ends.
"""

import clothsim as cs
import numpy as np
import pytest
from clothsim.model.scene import turning_times
from random_cloths import draw, rms

REQUESTS = [
    {"rtol": 1e-6},
    {"rtol": 1e-9},
    {"rtol": 1e-6, "integrator": "dopri5"},
    {"rtol": 1e-5, "integrator": "rk4"},
    {},
]


def side(rows):
    return [(r, 0) for r in range(rows)]


def pulse_scene(smooth=False):
    """Move a side of a sheet at rest out and back in 10 ms, where steps are ten times as long."""
    # A spline calms down within the further places.
    places = np.arange(95, 108) if smooth else (100, 101, 102)
    times = np.array([0, *places, 200]) / 200
    pull = cs.Keyframes(times, offsets=np.outer(times == 0.505, (0.05, 0, 0)), smooth=smooth)
    cloth = cs.Cloth(
        (8, 8), (0.7, 0.7), mass=0.64, stiffness=1.0, damping=0.0, pins=dict.fromkeys(side(8), pull)
    )
    return cs.Scene(cloth, gravity=(0, 0, 0))


def jumping_ball(start=0.5, response="penalty"):
    """Let a sphere out of reach of a sheet at rest come up and go back in 20 ms."""
    low, up = (0.4, -0.3, 0.4), (0.4, -0.05, 0.4)
    motion = cs.Keyframes([0, start, start + 0.01, start + 0.02, 1], [low, low, up, low, low])
    cloth = cs.Cloth(
        (9, 9),
        (0.8, 0.8),
        mass=0.81,
        stiffness=10.0,
        damping=0.0,
        pins=((0, 0), (0, -1), (-1, 0), (-1, -1)),
    )
    return cs.Scene(cloth, cs.Sphere(low, 0.1, motion, response, "none"), gravity=(0, 0, 0))


def rising_ball():
    """Let a sphere meet a sheet at rest, whose earlier steps are as long as the run."""
    sides = tuple((r, c) for r in (0, 8) for c in range(9))
    cloth = cs.Cloth((9, 9), mass=0.3, stiffness=500.0, damping=0.02, pins=sides)
    return cs.Scene(
        cloth, cs.Sphere((0.5, -0.3, 0.5), 0.15, cs.Linear((0, 0.5, 0))), gravity=(0, 0, 0)
    )


def check_error(run, solution, request):
    """Check that the error is as asked and the estimate true, or that the report says why not."""
    error = solution.error_of(run.x[-1])["rms"]
    bound = solution.error_bound["rms"][-1]
    estimate = run.report["error_estimate"]
    assert estimate["reason"] or error <= request + bound
    assert estimate["rms"] >= 0.5 * (error - 10 * bound)
    return estimate["reason"] == ""


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("options", REQUESTS, ids=str)
def test_a_pulse_within_a_step_is_seen(options, smooth):
    scene = pulse_scene(smooth)
    run = cs.simulate(scene, 1.0, **options)
    assert check_error(run, cs.reference(scene, 1.0), options.get("rtol", 1e-3) * 0.7)
    if options.get("integrator") != "rk4":
        assert {0.5, 0.505, 0.51} <= set(cs.simulate(scene, 1.0, every=1, **options).t)
        assert run.report["force_evaluations"] < (7000 if smooth else 1500)


def random_scene(number):
    """Draw a cloth of random stiffness and damping.

    Its pins move by a pulse, by a short reciprocation, by both or smoothly, in turn.
    """
    rng = np.random.default_rng([51, number])
    rows = int(rng.integers(3, 7))
    times = np.cumsum(
        [
            0.0,
            *(
                part
                for _ in range(2)
                for part in (rng.uniform(0.05, 0.2), *[10 ** rng.uniform(-4, -2)] * 2)
            ),
        ]
    )
    ways = rng.normal(size=(len(times), 3)) * 0.02 * (np.arange(len(times)) % 3 == 2)[:, None]
    pulse = cs.Keyframes(times, offsets=ways)
    shake = cs.Reciprocate(
        rng.normal(size=3), 2e-3, 10 ** rng.uniform(-2, -0.5), rng.choice([0.0, 5.0, 200.0]), 0.3
    )
    wave = cs.Sinusoid(rng.normal(size=3) * 1e-3, 10 ** rng.uniform(0, 2), 0.4)
    curve = cs.Keyframes(
        np.arange(6) / 8,
        offsets=rng.normal(size=(6, 3)) * 0.01 * (np.arange(6) > 0)[:, None],
        smooth=True,
    )
    motions = [(pulse, pulse), (shake, shake), (pulse, shake), (wave, curve)][number % 4]
    pins = {pin: motions[k % 2] for k, pin in enumerate(side(rows))}
    springs = {"stiffness": 10 ** rng.uniform(0, 3.5), "damping": rng.choice([0.0, 0.02])}
    return cs.Scene(
        cs.Cloth((rows, 5), mass=0.02 * rows, pins=pins, **springs),
        gravity=(0, -9.80665 * rng.integers(0, 2), 0),
    )


@pytest.mark.parametrize("number", range(12))
def test_random_motions_of_pins(number):
    scene = random_scene(number)
    right = cs.reference(scene, 0.5)
    for options in ({"rtol": 1e-7}, {"rtol": 1e-4, "integrator": "dopri5"}, {}):
        assert check_error(cs.simulate(scene, 0.5, **options), right, options.get("rtol", 1e-3))


@pytest.mark.parametrize("response", ["penalty", "ray"])
@pytest.mark.parametrize(
    "options",
    [{"rtol": 1e-6}, {"rtol": 1e-6, "fps": 30}, {"rtol": 1e-6, "integrator": "dopri5"}, {}],
    ids=str,
)
def test_a_sphere_that_comes_and_goes_within_a_step_is_met(options, response):
    dt = 1e-4 if response == "ray" else 2e-5
    short = cs.simulate(jumping_ball(response=response), 1.0, dt=dt).report
    report = cs.simulate(jumping_ball(response=response), 1.0, **options).report
    # This is the time of the first state in contact, for "penalty" in a layer of 0.025 m.
    first = 0.508 if response == "ray" else 0.507 + dt
    assert short["first_contact"]["time"] == pytest.approx(first)
    assert report["first_contact"]["time"] == pytest.approx(first, abs=5e-4)
    if response == "penalty":
        assert report["energy"]["end"]["total"] == pytest.approx(
            short["energy"]["end"]["total"], rel=0.01
        )
    assert report["force_evaluations"] < (6_000 if response == "ray" else 20_000)


@pytest.mark.parametrize("response", ["penalty", "reflect"])
def test_frames_never_change_a_run_with_contact(response):
    scene = rising_ball().replace(spheres=rising_ball().spheres[0].replace(response=response))
    plain, framed = (cs.simulate(scene, 0.4, rtol=1e-4, **frames) for frames in ({}, {"fps": 300}))
    assert framed.report["first_contact"]["time"] < 0.3
    assert plain.x[-1].tobytes() == framed.x[-1].tobytes()
    assert (
        framed.penetration()["triangles"].max() <= 1.01 * framed.report["penetration"]["triangles"]
    )
    assert len(framed.t) == 121


@pytest.mark.parametrize(
    ("period", "smooth"), [(0.003, False), (0.05, False), (1.0, False), (0.003, True), (0.05, True)]
)
def test_a_sphere_that_goes_up_and_down_is_met(period, smooth):
    """Its way over the step counts: the speeds at two turning points say little of it."""
    cloth = cs.Cloth(
        (9, 9), (0.8, 0.8), mass=0.81, stiffness=10.0, damping=0.0, pins=((0, 0), (-1, -1))
    )
    motion = (
        cs.Sinusoid((0, 0.2, 0), 1 / period, 0.75)
        if smooth
        else cs.Reciprocate((0, 1, 0), 0.4, period, 50.0)
    )
    scene = cs.Scene(
        cloth, cs.Sphere((0.4, -0.27, 0.4), 0.1, motion, offset="none"), gravity=(0, 0, 0)
    )
    small = cs.simulate(scene, 0.1, dt=2e-6 if period < 0.01 else 1e-4).report["first_contact"][
        "time"
    ]
    assert cs.simulate(scene, 0.1, rtol=1e-4).report["first_contact"]["time"] == pytest.approx(
        small, abs=4e-3 * period + 1e-4
    )


@pytest.mark.parametrize("options", [{"rtol": 1e-3}, *REQUESTS], ids=str)
def test_a_run_ends_where_a_sphere_meets_a_still_sheet(options):
    scene = rising_ball()
    report = cs.simulate(scene, 0.6, **options).report
    assert report["steps"] < 5000
    (sphere,) = scene.spheres
    thickness = sphere.layer(scene.cloth)["thickness"]
    touch = (0.3 - sphere.contact_radius(scene.cloth) - thickness) / 0.5
    # A step with error control may end in the layer, as deep as half of it.
    delay = thickness / 2 / 0.5
    if report["integrator"] == "rk4":
        delay = cs.max_stable_dt(scene) / 2
    assert touch <= report["first_contact"]["time"] <= touch + delay


@pytest.mark.filterwarnings("error::clothsim.StabilityWarning")
@pytest.mark.parametrize("options", [{}, {"rtol": 1e-4, "integrator": "rk4"}], ids=str)
def test_no_warning_of_time_steps_that_nobody_gave(options):
    cloth = cs.Cloth((8, 8), mass=1.0, stiffness=500.0, damping=1.0, pins=())
    scene = cs.Scene(cloth, cs.Plane((0, -1, 0), friction=0.5))
    assert cs.simulate(scene, 0.6, **options).report["first_contact"]["time"] < 0.5


def test_the_default_call_is_that_of_its_tolerance():
    case = draw(1, 3)
    default = cs.simulate(case.scene, case.duration)
    run = cs.simulate(case.scene, case.duration, rtol=1e-3)
    assert default.x.tobytes() == run.x.tobytes()
    assert default.report["error_estimate"] == run.report["error_estimate"]


def test_reasons_of_one_report_agree():
    """Steps of Verlet pass over a fast sphere, which the better run meets."""
    sphere = cs.Sphere((0.4, -5.0, 0.4), 0.05, cs.Linear((0, 50.0, 0)), "reflect", "none")
    scene = jumping_ball().replace(spheres=sphere)
    run = cs.simulate(scene, 1.0, rtol=0.3, integrator="velocity_verlet")
    assert run.report["first_contact"]["reason"] == "no sphere responded"
    assert run.report["error_estimate"]["reason"].startswith("this run misses a sphere")


@pytest.mark.parametrize(
    "motion", [cs.Reciprocate((1, 0, 0), 1e-3, 1e-7), cs.Sinusoid((1e-3, 0, 0), 1e7)]
)
def test_more_stops_than_steps_are_refused_before_any_run(motion, monkeypatch):
    monkeypatch.setattr(
        "clothsim.run.recording.Recording.run_to_end", lambda self: pytest.fail("a run was begun")
    )
    scene = cs.Scene(cs.Cloth((3, 3), pins={(0, 0): motion}))
    name = type(motion).__name__
    message = rf"period must be at least 2e-06 s.* got 1e-07 s of {name}.*: give dt"
    with pytest.raises(ValueError, match=message):
        cs.simulate(scene, 1.0, rtol=1e-3)


def test_a_given_step_passes_any_number_of_turns():
    tremble = cs.Reciprocate((0, 1, 0), 1e-9, period=1e-6)
    scene = cs.Scene(
        cs.Cloth((4, 4), mass=0.1, stiffness=50.0, damping=0.01),
        cs.Sphere((0.5, -3.0, 0.5), 0.2, tremble),
    )
    assert cs.simulate(scene, 1.0, dt=1e-3).report["steps"] == 1000
    with pytest.raises(ValueError, match="give dt"):
        cs.simulate(scene, 1.0, rtol=1e-3)


def test_frames_between_steps_have_driven_pins_where_they_are():
    scene = pulse_scene()
    run = cs.simulate(scene, 1.0, dt=0.02, times=[0.503, 0.505, 0.507])
    (pins,) = scene.driven_pins
    for k, t in enumerate(run.t[1:-1], 1):
        assert np.array_equal(run.x[k, :, 0], pins.places_at(t))
        assert np.array_equal(run.v[k, 0, 0], pins.motion.velocity_at(t))


def test_resumed_at_a_kink_and_elsewhere(same_bits):
    scene = random_scene(2)
    right = cs.reference(scene, 0.5)
    kink = turning_times(scene, 0.0, 0.5)[3]
    for first in (kink, kink + 0.0013):
        run = cs.simulate(scene, first, rtol=1e-7).resume(0.5 - first)
        assert rms(run.x[-1] - right.x[-1]) < 1e-6
