"""Continuous contact: time of impact, what follows it, and what never happens."""

import clothsim as cs
import numpy as np
import pytest
from contact import drop, resting, under_whole_cloth
from contact_fuzz import crossings
from points import CENTER, RADIUS, drifting, one_point

DT = 1e-3


def ball(**arguments):
    return cs.Sphere(
        **{
            "center": CENTER,
            "radius": RADIUS,
            "response": "continuous",
            "offset": "none",
            "restitution": 1.0,
            **arguments,
        }
    )


@pytest.mark.parametrize("miss", [1e-9, 1e-6, 1e-3, -1e-9, -1e-6, -1e-3])
@pytest.mark.parametrize("far", [1.0, 1e3])
def test_grazing_is_decided_to_rounding(miss, far):
    """Past the sphere at RADIUS + miss: turned below, left alone to the bit above."""
    v = np.array([2 * far, 0, 0])
    _, after = one_point((-far, RADIUS + miss, 0), v, ball(), 1.0)
    assert (after == v).all() == (miss > 0)


@pytest.mark.parametrize(
    "count, options",
    [
        (400_000, {}),
        (400_000, {"seed": 3, "precision": "single"}),
        pytest.param(10**8, {"seed": 2}, marks=pytest.mark.slow),
    ],
)
def test_nothing_passes(count, options):
    """In single the state is compensated, and the time of impact is found in double anyway."""
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
    the second half counts too, q^2/12. "continuous" misses none.
    """
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
    """1e-6 of m g h is asked for at 5e-6 s; four times the step already has it. A radius rho that
    grows moves points against their springs: 6e-6 of m g h.
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
    assert (
        result["normal_jitter"] < 1e-6
        if offset == "none"
        else result["normal_jitter"] == result["jitter"] == 0
    )
