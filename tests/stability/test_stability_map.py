"""The stability map."""

import clothsim as cs
import numpy as np
import pytest

pytest.importorskip("xarray", reason="stability_map returns an xarray.Dataset")

SCENE = cs.Scene(cs.Cloth((6, 7), mass=21.0, damping=20.0), gravity=(0, 0, 0))
STIFFNESS = np.geomspace(1e3, 1e7, 3)


def steps_around(factors):
    limits = [
        cs.max_stable_dt(
            SCENE.replace(cloth=SCENE.cloth.replace(stiffness=k)), x=SCENE.initial_position
        )
        / 0.97
        for k in STIFFNESS
    ]
    return np.sort(np.outer(limits, factors).ravel())


def test_prediction_and_measurement_agree_within_a_few_percent_of_the_limit():
    limits = cs.stability_map(SCENE, STIFFNESS, steps_around((0.8, 0.97, 1.03, 1.3)), steps=500)
    assert dict(limits.sizes) == {"stiffness": 3, "dt": 12} and limits.attrs["integrator"] == "rk4"
    assert limits.dt.attrs["units"] == limits.limit.attrs["units"] == "s"
    assert 0 < limits.stable.sum() < limits.stable.size
    np.testing.assert_array_equal(limits.stable, limits.predicted)
    assert (limits.guarantee < limits.limit).all()
    for k, limit, guarantee in zip(STIFFNESS, limits.limit, limits.guarantee):
        scene = SCENE.replace(cloth=SCENE.cloth.replace(stiffness=k))
        assert guarantee == cs.max_stable_dt(scene)
        assert cs.max_stable_dt(scene, x=scene.initial_position) == pytest.approx(
            0.97 * float(limit), rel=1e-12, abs=0
        )


def test_threads_and_spheres_make_no_difference():
    dt = steps_around((0.9, 1.1))
    ball = SCENE.replace(
        spheres=cs.Sphere(
            (0.5, 0.0, 0.5), 0.3, cs.Linear((0, 9.0, 0)), response="ray", offset="edge"
        )
    )
    first, *variants = (
        cs.stability_map(*of, dt, steps=300, threads=n)
        for *of, n in ((SCENE, STIFFNESS, 1), (ball, STIFFNESS, 2))
    )
    assert all(first.identical(variant) for variant in variants)


def test_the_plot_says_why_crosses_lie_below_the_predicted_limit():
    pytest.importorskip("matplotlib")
    limits = cs.stability_map(SCENE, STIFFNESS, [1e-5, 1e-1], steps=50)
    for stable, notes in ((limits.stable, 0), (limits.stable & False, 1)):
        texts = [text.get_text() for text in limits.assign(stable=stable).clothsim.plot().texts]
        assert len(texts) == notes and all(
            "it is that of the initial state" in text for text in texts
        )
