"""Every hard case ends as it should: in double on the edge kernel, in single on the other.

Bounds are about five to twenty times the measured figures.
"""

import itertools
import warnings
from dataclasses import dataclass, replace

import clothsim as cs
import numpy as np
import pytest
from clothsim.hard_cases import FAR, near_cloth_scene

CASES = cs.scenes.hard_cases()
LONG = 10_000  # steps, from which on the default kernel is enough
MILLION = 10**6  # steps, from which on a case is slow
KERNELS = {"double": "edge", "single": "gather"}


@dataclass(frozen=True)
class End:
    """The last state of a run, or the last good one before its error."""

    x: np.ndarray
    v: np.ndarray
    error: cs.UnstableError | None
    precision: str = "double"
    kernel: str = "auto"


def run(case, precision="double", kernel="auto"):
    stepper = cs.Stepper(case.scene, precision=precision, kernel=kernel, threads=1)
    error = None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cs.StabilityWarning)
        try:
            stepper.advance(case.steps, case.dt)
        except cs.UnstableError as raised:
            error = raised
    return End(stepper.positions, stepper.velocities, error, precision, kernel)


# Judges: functions of a case and its end that fail where the end is wrong.


def within(measure, double, single=None, low=0.0):
    """Make a judge of one figure, at most `double` or, in single, `single`."""
    high = {"double": double, "single": double if single is None else single}

    def judge(case, end):
        assert low <= float(measure(case, end)) <= high[end.precision], measure.__name__

    return judge


def error_over_distance(case, end):
    """Measure the largest distance to the scalar reference, over the largest distance moved."""
    start = case.scene.initial_position
    velocity = case.scene.initial_velocity
    expected, _ = cs.reference_step(case.scene, start, velocity, case.dt, case.steps, t=0.0)
    moved = np.abs(expected - start).max()
    return np.abs(end.x - expected).max() / moved if moved > 0 else np.abs(end.x - start).max()


def moves_like_the_reference(double, single):
    return within(error_over_distance, double, single)


def energy_gained(case, end):
    """Measure the gain of total energy, over the larger kinetic + elastic energy."""
    scene = case.scene
    first = cs.energy(scene, scene.initial_position, scene.initial_velocity)
    last = cs.energy(scene, end.x, end.v)
    scale = max(energy["kinetic"] + energy["elastic"] for energy in (first, last))
    return (last["total"] - first["total"]) / scale if scale > 0 else 0.0


def gains_energy(double, single, loss=np.inf):
    return within(energy_gained, double, single, -loss)


def ends_at(place, double, single):
    """Make a judge of the largest distance to known positions [m]."""

    def distance(case, end):
        return np.abs(end.x - place(case)).max()

    return within(distance, double, single)


def free_fall(case):
    t = case.steps * case.dt
    return case.scene.initial_position + np.array(case.scene.gravity) * t * t / 2


def motion_near_the_origin(case):
    near = near_cloth_scene()
    start = (near.initial_position, near.initial_velocity)
    return cs.step(near, *start, case.dt, case.steps, t=0.0)[0] + FAR


def normal_modes(case):
    """Compute x(t) = cos(sqrt(L) t) x(0), with L the spring Laplacian per unit mass."""
    cloth = case.scene.cloth
    table = cloth.spring_table()
    laplacian = np.zeros((cloth.rows * cloth.columns,) * 2)
    for a, b, sign in (("i", "i", 1), ("j", "j", 1), ("i", "j", -1), ("j", "i", -1)):
        np.add.at(laplacian, (table[a], table[b]), sign * table["stiffness"])
    squares, modes = np.linalg.eigh(laplacian / cloth.mass_per_point[0, 0])
    phase = np.cos(np.sqrt(squares.clip(0)) * case.steps * case.dt)
    start = case.scene.initial_position.reshape(-1, 3)
    return np.reshape(modes @ (phase[:, None] * (modes.T @ start)), (*cloth.shape, 3))


def first_point_at(*place):
    def places(case):
        expected = case.scene.initial_position.copy()
        expected[0, 0] = place
        return expected

    return places


def ends_like_double(bound):
    """Make a judge of a run in single by the same run in double."""

    def distance(case, end):
        other = "double" if end.precision == "single" else "single"
        start = (case.scene.initial_position, case.scene.initial_velocity)
        options = {"t": 0.0, "precision": other, "threads": 1, "kernel": end.kernel}
        expected, _ = cs.step(case.scene, *start, case.dt, case.steps, **options)
        return np.linalg.norm(end.x - expected, axis=-1).max()

    return within(distance, bound)


def distance_of_pins(case, end):
    moved = np.abs(end.x - case.scene.initial_position)
    return moved[case.scene.cloth.pinned].max()


def free_points_out(bound):
    def depth(case, end):
        (sphere,) = case.scene.spheres
        free = end.x[~case.scene.cloth.pinned]
        return max(0.0, -sphere.height(free, case.steps * case.dt).min())

    return within(depth, bound)


def largest_speed(least, most):
    def speed(case, end):
        return np.linalg.norm(end.v, axis=-1).max()

    return within(speed, most, low=least)


def names_point_limit_and_last_good_state(case, end):
    error = end.error
    assert error is not None and 1 <= error.step <= 300
    assert error.dt == case.dt and error.max_stable_dt < case.dt and error.point is not None
    assert np.isfinite(error.v).all() and np.array_equal(error.x, end.x)
    assert np.abs(error.x).max() <= 2.0  # m


JUDGES = {
    "stiffness 1e06 N/m": (moves_like_the_reference(3e-13, 1e-4), gains_energy(0.0, 0.0)),
    "stiffness 1e09 N/m": (moves_like_the_reference(3e-11, 1e-2), gains_energy(0.0, 0.0)),
    "stiffness 1e12 N/m": (moves_like_the_reference(1e-11, 1e-2), gains_energy(0.0, 0.0)),
    **dict.fromkeys(
        ("structural springs of 1e7 beside 1 N/m", "shear springs of 1e7 beside 1 N/m"),
        (moves_like_the_reference(1e-13, 1e-5), gains_energy(1e-7, 1e-5, 1e-5)),
    ),
    "dt at 0.95 of the limit": (gains_energy(1e-12, 1e-5),),
    "dt at 1.05 of the limit": (names_point_limit_and_last_good_state,),
    "dt 5e-6 s in single": (ends_like_double(1e-7),),
    "a million steps": (gains_energy(1e-11, 2e-5, 2e-5),),
    "a million steps in single": (ends_like_double(2e-7),),
    **dict.fromkeys(
        ("a point 1e6 times lighter", "a point 1e6 times heavier"),
        (moves_like_the_reference(2e-13, 1e-4), gains_energy(1e-12, 1e-6, 1e-7)),
    ),
    "zero rest length": (ends_at(normal_modes, 1e-4, 1e-4), moves_like_the_reference(1e-11, 1e-3)),
    "coincident points": (moves_like_the_reference(1e-11, 1e-3), gains_energy(0.0, 0.0)),
    "collapsed cloth": (ends_at(free_fall, 1e-12, 1e-6),),
    "collapsed cloth with two pins": (gains_energy(0.0, 0.0),),
    "collapsed cloth with noise": (gains_energy(3e-5, 3e-5, 3e-5),),
    "1e6 m away": (ends_at(motion_near_the_origin, 5e-8, 5e-6),),
    **dict.fromkeys(
        [f"a strip of {size}" for size in ("1 x 2", "1 x 12", "12 x 1", "2 x 12")],
        (moves_like_the_reference(5e-12, 5e-4),),
    ),
    "pins inside a sphere": (within(distance_of_pins, 0.0), free_points_out(1e-12)),
    "a sphere that starts inside the cloth": (free_points_out(1e-12), largest_speed(0.0, 10.0)),
    "a point at rest inside": (ends_at(first_point_at(3 / 26, -4 / 26, 12 / 26), 1e-15, 1e-7),),
    "a point at the exact centre": (ends_at(first_point_at(0.0, 0.5, 0.0), 1e-12, 1e-7),),
    "a sphere at 100 m/s": (
        moves_like_the_reference(1e-13, 1e-5),
        largest_speed(150.0, 201.0),
        free_points_out(0.0),
    ),
}


def check(case, end, judges):
    assert (end.error is not None) == case.unstable
    for judge in judges:
        judge(case, end)


def kernels(case):
    """List the pairs of precision and kernel that a case runs with."""
    if case.steps > LONG:
        return [(precision, "auto") for precision in case.precisions]
    if len(case.precisions) == 2:
        return KERNELS.items()
    return itertools.product(case.precisions, ("edge", "gather"))


RUNS = [
    pytest.param(
        name,
        precision,
        kernel,
        id=f"{name}-{precision}-{kernel}",
        marks=pytest.mark.slow if case.steps >= MILLION else (),
    )
    for name, case in CASES.items()
    for precision, kernel in kernels(case)
]


@pytest.mark.parametrize("name, precision, kernel", RUNS)
def test_hard_case(name, precision, kernel):
    check(CASES[name], run(CASES[name], precision, kernel), JUDGES[name])


def test_every_case_has_judges():
    assert JUDGES.keys() == CASES.keys()


@pytest.mark.parametrize(
    "name, changes",
    [
        ("a point at rest inside", {"scene": CASES["a point at the exact centre"].scene}),
        ("dt at 1.05 of the limit", {"dt": 1e-3}),
        ("dt at 0.95 of the limit", {"dt": 0.1}),
    ],
)
def test_a_wrong_outcome_is_seen(name, changes):
    case = replace(CASES[name], **changes)
    with pytest.raises(AssertionError):
        check(case, run(case), JUDGES[name])


def test_another_stiffness_is_seen():
    case = CASES["a strip of 1 x 12"]
    stiffer = case.scene.replace(cloth=case.scene.cloth.replace(stiffness=1001.0))
    with pytest.raises(AssertionError, match="error_over_distance"):
        check(case, run(replace(case, scene=stiffer)), JUDGES["a strip of 1 x 12"])
