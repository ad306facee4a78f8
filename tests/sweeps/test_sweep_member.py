"""A member of a sweep as a run: `Dataset.clothsim.member`."""

import clothsim as cs
import numpy as np
import pytest

xarray = pytest.importorskip("xarray")

BALL = cs.Scene(
    cs.Cloth((7, 7), mass=1.0, stiffness=200.0, damping=0.2),
    cs.Sphere((0.5, -0.1, 0.5), 0.08, response="ray", offset="edge"),
)


def sweep(over, **options):
    return cs.sweep(BALL, over, duration=0.1, every=0.02, progress=False, **options)


def test_a_member_is_its_run_with_the_bits_of_the_sweep():
    over = {
        "sphere_motion": {"still": None, "up": cs.Linear((0.0, 2.0, 0.0))},
        ("dt", "precision"): [(1e-3, "double"), (5e-4, "single")],
    }
    ds = sweep(over, metrics={"x": lambda run: run.x})
    run = ds.clothsim.member(sphere_motion="up", dt_precision=1)
    assert (run.report["dt"], run.report["precision"]) == (5e-4, "single")
    assert run.scene.spheres[0].motion == cs.Linear((0.0, 2.0, 0.0))
    assert np.array_equal(run.x, ds.x.sel(sphere_motion="up", dt_precision=1))
    still = ds.isel(dt_precision=0).clothsim.member(sphere_motion="still", every=1)
    assert still.scene == BALL and len(still.t) == 101


def test_scenes_tolerances_and_stores(tmp_path):
    pytest.importorskip("zarr")
    scenes = {"ball": BALL, "none": BALL.replace(spheres=())}
    ds = sweep({"scene": scenes, "rtol": [1e-4]}, store=tmp_path / "s.zarr", metrics="stable")
    run = cs.open_sweep(tmp_path / "s.zarr").clothsim.member(scene="none")
    assert run.scene == scenes["none"] and run.report["tolerance"]["asked"] == pytest.approx(1e-4)
    assert run == ds.sel(scene="none").clothsim.member()


def test_an_unstable_member_is_the_run_up_to_its_last_good_state():
    ds = sweep({"dt": [1e-3, 0.02]}, metrics="stable")
    assert not ds.stable.sel(dt=0.02)
    with pytest.warns(cs.StabilityWarning):
        run = ds.clothsim.member(dt=0.02)
    assert run.report["stopped"] == "unstable" and np.isfinite(run.x).all()


def test_a_selection_of_several_members_is_refused_by_name():
    ds = sweep({"dt": [1e-3, 5e-4]}, metrics="stable")
    with pytest.raises(ValueError, match=r"one value of 'dt', got 2: give member\(dt=\.\.\.\)"):
        ds.clothsim.member()
    for lost in (
        lambda: ds.isel(dt=1, drop=True).clothsim.member(),
        lambda: ds.clothsim.member(dt=0.5),
    ):
        with pytest.raises(KeyError):
            lost()
    large = sweep(
        {"position": [BALL.initial_position, 2 * BALL.initial_position]}, dt=1e-3, metrics="stable"
    )
    with pytest.raises(
        ValueError, match="position is swept over arrays, which a Dataset does not keep"
    ):
        large.isel(position=0).clothsim.member()
