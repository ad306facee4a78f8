"""Motions: where the centre is, and that the velocity is its derivative."""

import numpy as np
import pytest
from clothsim.model.motion import Keyframes, Linear, Reciprocate, Sinusoid
from scipy.interpolate import CubicSpline

CENTER = (0.5, -0.5, 0.25)
MOTIONS = [
    Linear((1.0, -2.0, 0.5)),
    Reciprocate((0.0, 3.0, 4.0), distance=0.8, period=1.7, deceleration=3.0, phase=0.3),
    Reciprocate((1.0, 0.0, 0.0), period=2.0, deceleration=0.0),
    Keyframes([0.0, 0.4, 1.3, 2.0], [(0, 0, 0), (1, 0, 0), (1, 2, -1), (0, 0, 0)]),
    Keyframes(
        [0.0, 0.4, 1.3, 2.0],
        offsets=[(0, 0, 0), (0.3, 0, 0), (0.7, 2, -1), (1, 3, -2)],
        smooth=True,
    ),
    Keyframes([0.0, 0.8, 1.7, 2.5], [(0, 0, 0), (1, 0, 0), (1, 2, -1), (0, 0, 0)], smooth="rest"),
    Sinusoid((0.3, 0.0, -0.1), frequency=1.3, phase=0.2),
]


@pytest.mark.parametrize("motion", MOTIONS)
def test_velocity_is_the_derivative_of_the_center(motion):
    t = np.linspace(-0.9, 3.1, 57)  # meets no kink of the motions above
    h = 1e-5
    slope = (motion.center_at(t + h, CENTER) - motion.center_at(t - h, CENTER)) / (2 * h)
    # Central differences: h^2/6 times the third derivative (< 300 m/s^3), and rounding.
    np.testing.assert_allclose(motion.velocity_at(t), slope, rtol=0, atol=1e-8)


def test_reciprocate_follows_its_formulas():
    t = np.linspace(-3.0, 4.0, 501)
    for k in (0.0, 1e-9, 3.0, 200.0):
        motion = Reciprocate((0, 3, 4), distance=0.8, period=1.7, deceleration=k, phase=0.3)
        w = (t / 1.7 + 0.3) % 1
        s = np.where(w < 0.5, 1, -1)
        q = 2 * w % 1
        displacement, slope = (
            (np.expm1(-k * q) / np.expm1(-k), k * np.exp(-k * q) / -np.expm1(-k))
            if k
            else (q, 1 + 0 * q)
        )
        u = np.array([0, 0.6, 0.8])
        place = CENTER + np.outer(s * (displacement - 0.5) * 0.8, u)
        velocity = np.outer(s * slope * 2 / 1.7 * 0.8, u)
        np.testing.assert_allclose(motion.center_at(t, CENTER), place, rtol=0, atol=1e-14)
        np.testing.assert_allclose(motion.velocity_at(t), velocity, rtol=1e-10, atol=1e-13)
    # At a turning point the velocity is that of the way back.
    forth, back = Reciprocate((1, 0, 0), period=2.0).velocity_at([0.0, 1.0])[:, 0]
    assert forth == -back > 0


def test_reciprocate_is_repeated_interpolation():
    """Frames that each go the same fraction of the rest of the way, over half a period."""
    k = 5.0
    frames = 100_000
    x = 0.5 - (1 - k / frames) ** np.arange(frames + 1)
    scaled = -0.5 + (x + 0.5) / (x[-1] + 0.5)
    motion = Reciprocate((1, 0, 0), period=2.0, deceleration=k)
    exact = motion.center_at(np.linspace(0.0, 1.0 - 1e-12, frames + 1), (0, 0, 0))[:, 0]
    np.testing.assert_allclose(scaled, exact, rtol=0, atol=k / frames)


def test_sinusoid():
    motion = Sinusoid((0.3, 0.0, -0.1), frequency=1.3, phase=0.2)
    t = np.linspace(-3.0, 9.0, 500)
    angle = 2 * np.pi * (1.3 * t + 0.2)[:, None]
    amplitude = np.array([0.3, 0.0, -0.1])
    np.testing.assert_allclose(
        motion.center_at(t, CENTER), CENTER + amplitude * np.sin(angle), rtol=0, atol=1e-14
    )
    np.testing.assert_allclose(
        motion.velocity_at(t), 2.6 * np.pi * amplitude * np.cos(angle), rtol=0, atol=1e-13
    )


@pytest.mark.filterwarnings("ignore:the smooth curve leaves")
@pytest.mark.parametrize("count", [2, 3, 4, 5, 40])
def test_smooth_keyframes_are_the_clamped_spline(count):
    rng = np.random.default_rng(count)
    times = np.cumsum(rng.uniform(0.05, 1.0, count))
    centers = rng.normal(size=(count, 3))
    motion = Keyframes(times, centers, smooth=True)
    spline = CubicSpline(times, centers, bc_type="clamped")
    t = np.linspace(times[0], times[-1], 1000, endpoint=False)
    np.testing.assert_allclose(motion.center_at(t, CENTER), spline(t), rtol=0, atol=1e-12)
    np.testing.assert_allclose(motion.velocity_at(t), spline(t, 1), rtol=0, atol=1e-11)
    # At rest outside, as with straight lines.
    assert motion.center_at([0.0, 99.0], CENTER).tolist() == centers[[0, -1]].tolist()
    assert not motion.velocity_at([0.0, 99.0]).any()


HOLDS = {"times": [0.0, 0.5, 1.0, 1.5], "offsets": np.outer([0, 0, 0.1, 0.1], (1.0, 0, 0))}


def test_a_curve_that_rests_in_every_key_has_minimum_jerk():
    motion = Keyframes(**HOLDS, smooth="rest")
    t = np.linspace(0, 1.5, 301)
    u = np.clip((t - 0.5) / 0.5, 0, 1)
    place = 0.1 * u**3 * (10 - 15 * u + 6 * u**2)
    speed = 0.1 * 30 * u**2 * (1 - u) ** 2 / 0.5
    np.testing.assert_allclose(motion.center_at(t, (0, 0, 0))[:, 0], place, rtol=0, atol=1e-15)
    np.testing.assert_allclose(motion.velocity_at(t)[:, 0], speed, rtol=0, atol=1e-14)
    h = 1e-6  # the acceleration is 0 on both sides of a key
    for t in HOLDS["times"]:
        assert np.abs(motion.velocity_at([t - h, t + h])).max() < 1e-9


def test_a_curve_that_leaves_the_range_of_its_keys_warns(recwarn):
    with pytest.warns(UserWarning, match=r"range of its keys by 0\.0088\d m.*'rest' stays"):
        motion = Keyframes(**HOLDS, smooth=True)
    assert not motion.velocity_at([0.0, 1.5]).any()
    Keyframes([0, 1, 2, 3], offsets=np.outer([0, 1, 2, 3], (1, 0, 1e-9)), smooth=True)
    Keyframes(**HOLDS, smooth="rest")
    assert not recwarn
    with pytest.raises(ValueError, match="smooth must be one of 'rest', got 'reset'.*did you mean"):
        Keyframes(**HOLDS, smooth="reset")


@pytest.mark.parametrize(
    ("motion", "stops", "jumps"),
    [
        (Linear((1.0, 0.0, 0.0)), [], False),
        (Reciprocate((1, 0, 0), period=0.8, phase=0.25), [0.2, 0.6, 1.0, 1.4], True),
        (Sinusoid((1, 0, 0), 1.25, phase=0.25), [0.2, 0.6, 1.0, 1.4], False),
        (Keyframes([0.0, 0.5, 0.7, 1.6], np.eye(4, 3)), [0.5, 0.7], True),
        (Keyframes([0.0, 0.5, 0.7, 1.6], np.eye(4, 3), smooth="rest"), [0.5, 0.7], False),
    ],
)
def test_stops_are_where_pieces_end_and_smooth_motions_have_no_kink_there(motion, stops, jumps):
    assert motion._ends_of_pieces(0.0, 1.5) == pytest.approx(stops)
    for t in stops:
        before, after = motion.velocity_at([t - 1e-9, t + 1e-9])
        assert (np.abs(after - before).max() > 0.1) == jumps


def test_keyframes_stand_still_outside_and_are_right_continuous():
    motion = Keyframes([1.0, 2.0, 4.0], [(0, 0, 0), (2, 0, 0), (2, -4, 0)])
    t = [0.0, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0]
    assert motion.center_at(t, CENTER).tolist() == [
        *[[0, 0, 0], [0, 0, 0], [1, 0, 0], [2, 0, 0], [2, -2, 0], [2, -4, 0], [2, -4, 0]]
    ]
    assert motion.velocity_at(t).tolist() == [
        *[[0, 0, 0], [2, 0, 0], [2, 0, 0], [0, -2, 0], [0, -2, 0], [0, 0, 0], [0, 0, 0]]
    ]
    with pytest.raises(ValueError, match="read-only"):
        motion.times[0] = 0.0
