"""The stability map."""

import dataclasses

import clothsim as cs
import numpy as np
import pytest
from clothsim.stability import measure_map
from clothsim.stability.map_report import draw_map

SCENE = cs.Scene(cs.Cloth((6, 7), mass=21.0, damping=20.0), gravity=(0, 0, 0))
STIFFNESS = np.geomspace(1e3, 1e7, 3)


def steps_around(scene, stiffness, factors):
    limits = [
        cs.max_stable_dt(scene.replace(cloth=scene.cloth.replace(stiffness=k)), x=scene.initial_position) / 0.97
        for k in stiffness
    ]
    return np.sort(np.outer(limits, factors).ravel())


def test_prediction_and_measurement_agree_within_a_few_percent_of_the_limit():
    dt = steps_around(SCENE, STIFFNESS, (0.8, 0.97, 1.03, 1.3))
    found = measure_map(SCENE, STIFFNESS, dt, steps=500)
    assert found.stable.shape == found.predicted.shape == (3, 12)
    assert 0 < found.stable.sum() < found.stable.size
    np.testing.assert_array_equal(found.stable, found.predicted)
    assert (found.guarantee < found.limit).all()
    for k, limit, guarantee in zip(STIFFNESS, found.limit, found.guarantee):
        one = SCENE.replace(cloth=SCENE.cloth.replace(stiffness=k))
        assert guarantee == cs.max_stable_dt(one)
        assert cs.max_stable_dt(one, x=one.initial_position) == pytest.approx(0.97 * limit, rel=1e-12, abs=0)


def test_threads_and_spheres_make_no_difference():
    dt = steps_around(SCENE, STIFFNESS, (0.9, 1.1))
    ball = SCENE.replace(spheres=cs.Sphere((0.5, 0.0, 0.5), 0.3, cs.Linear((0, 9.0, 0)), response="ray", offset="edge"))
    maps = [measure_map(SCENE, STIFFNESS, dt, steps=300, threads=n).stable for n in (1, 2)]
    maps.append(measure_map(ball, STIFFNESS, dt, steps=300).stable)
    np.testing.assert_array_equal(maps[0], maps[1])
    np.testing.assert_array_equal(maps[0], maps[2])


def test_the_dataset_is_labelled():
    pytest.importorskip("xarray")
    dt = [1e-5, 1e-1]
    data = cs.stability_map(SCENE, STIFFNESS, dt, steps=50)
    assert dict(data.sizes) == {"stiffness": 3, "dt": 2}
    assert set(data.data_vars) == {"stable", "predicted", "limit", "guarantee"}
    assert data.stable.sel(dt=1e-5).all() and not data.stable.sel(dt=1e-1).any()
    assert data.dt.attrs["units"] == data.limit.attrs["units"] == "s"
    assert data.attrs["integrator"] == "rk4"


def test_the_plot_says_why_crosses_lie_below_the_predicted_limit():
    pytest.importorskip("matplotlib")
    found = measure_map(SCENE, STIFFNESS, [1e-5, 1e-1], steps=50)
    for stable, notes in ((found.stable, 0), (found.stable & False, 1)):
        texts = [text.get_text() for text in draw_map(dataclasses.replace(found, stable=stable)).texts]
        assert len(texts) == notes and all("it is that of the initial state" in text for text in texts)
