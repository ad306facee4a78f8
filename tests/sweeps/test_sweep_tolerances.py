"""Sweeps whose steps tolerances choose: what is swept, and the same bits as `simulate` alone."""

import clothsim as cs
import numpy as np
import pytest

pytest.importorskip("xarray")

SCENE = cs.scenes.hanging(shape=(6, 7))
UNDAMPED = cs.Scene(cs.Cloth((5, 5), mass=1.0, stiffness=200.0, damping=0.0))
BALL = cs.Scene(
    cs.Cloth((7, 7), mass=1.0, stiffness=200.0, damping=0.2),
    cs.Sphere((0.5, -0.3, 0.5), 0.2, restitution=0.5, response="ray", offset="edge"),
)
WATCHED = ["largest_stretch", "penetration", "first_contact"]


def sweep(scene, over=None, **options):
    return cs.sweep(scene, over, progress=False, **{"duration": 0.3, **options})


@pytest.mark.parametrize("metrics", ["stable", WATCHED, [*WATCHED, len], [len]])
@pytest.mark.parametrize("every", [None, 0.07, 5])
@pytest.mark.filterwarnings("ignore:.*'len'")  # of a run, which has none: that is not looked at
def test_states_have_the_bits_of_simulate(metrics, every):
    """Methods with dense output, and those with a fixed step that "auto" takes: undamped, loose."""
    seen = {}

    def last(run):
        seen[run.scene.cloth.damping, run.report["tolerance"]["asked"]] = run
        return 0.0

    names = [metrics] if isinstance(metrics, str) else [m for m in metrics if m is not len]
    for scene in (SCENE, UNDAMPED):
        sweep(scene, {"rtol": [1e-3, 1e-6]}, metrics=[*names, last], every=every)
        for rtol in (1e-3, 1e-6):
            alone = cs.simulate(scene, 0.3, rtol=rtol, every=every, threads=1)
            mine = seen[scene.cloth.damping, alone.report["tolerance"]["asked"]]
            assert mine.x.tobytes() == alone.x.tobytes() and mine.v.tobytes() == alone.v.tobytes()
            assert mine.t.tolist() == alone.t.tolist()
            for name in ("integrator", "precision", "steps", "force_evaluations"):
                assert mine.report[name] == alone.report[name]


@pytest.mark.parametrize(
    "options",
    [
        {"metrics": "energy_drift"},
        {"metrics": ["energy_drift", *WATCHED]},
        {"metrics": "energy_drift", "every": 0.1, "frames": True},
    ],
)
@pytest.mark.parametrize("scene", [SCENE, UNDAMPED])
def test_energy_and_frames_are_those_of_simulate(scene, options):
    result = sweep(scene, {"rtol": [2e-5, 1e-3]}, **options)
    for rtol in (2e-5, 1e-3):
        run = cs.simulate(scene, 0.3, rtol=rtol, every=options.get("every"))
        energy = run.report["energy"]
        mine = result.sel(rtol=rtol)
        assert float(mine.energy_drift) == energy["end"]["total"] - energy["start"]["total"]
        assert float(mine.max_stable_dt) == cs.max_stable_dt(scene, run.report["integrator"])
        if "frames" in options:
            assert mine.position.values.tobytes() == run.x.tobytes()


def test_the_error_is_within_the_request():
    asked = [1e-4, 1e-6, 1e-8]
    result = sweep(SCENE, {"atol": asked}, metrics="error", integrator="dop853")
    assert result.atol.attrs["units"] == "m"
    assert (result.error_rms <= result.atol).all() and (result.error_rms > 1e-4 * result.atol).all()
    relative = sweep(SCENE, {"rtol": asked}, metrics="error", integrator="dop853")
    assert max(SCENE.cloth.size) == 1.0 and np.array_equal(relative.error, result.error)
    assert relative.rtol.attrs["units"] == "1"


def test_watched_measures_equal_measures_of_the_run():
    undamped = BALL.replace(cloth=BALL.cloth.replace(damping=0.0))
    for scene, rtol in ((BALL, 1e-6), (undamped, 3e-4)):
        result = sweep(scene, rtol=rtol, metrics=WATCHED)
        report = cs.simulate(scene, 0.3, rtol=rtol).report
        assert report["integrator"] == "dop853"
        assert float(result.largest_stretch) == report["stretch"]["largest"] > 0.01
        assert float(result.penetration) == report["penetration"]["triangles"] > 1e-4
        assert float(result.penetration_points) == report["penetration"]["points"]
        first = float(result.first_contact)
        assert first == report["first_contact"]["time"]
        fixed = float(sweep(scene, dt=1e-4, metrics="first_contact").first_contact)
        # A contact is found at the end of the step in which it begins. No step near the sphere is longer than
        # a tenth of the contact radius, at the speed of the fall.
        radius, speed = scene.spheres[0].contact_radius(scene.cloth), 9.80665 * fixed
        assert -1e-4 <= first - fixed <= 0.1 * radius / speed


def test_tolerances_beside_steps():
    samples = [{"dt": 1e-3, "rtol": None}, {"dt": None, "rtol": 1e-9}]
    result = sweep(SCENE, samples, metrics="error")
    assert np.array_equal(result.dt, [1e-3, np.nan], equal_nan=True)
    assert np.array_equal(result.rtol, [np.nan, 1e-9], equal_nan=True)
    assert result.dt.attrs["units"] == "s"
    assert float(result.error[1]) < 2e-9 < 5e-9 < float(result.error[0]) < 2e-8
    zipped = sweep(SCENE, {("dt", "rtol"): [(1e-3, None), (None, 1e-9)]}, metrics="error")
    assert np.array_equal(zipped.error, result.error)


def test_automatic_without_a_tolerance_equals_simulate():
    result = sweep(SCENE, integrator="auto", metrics="energy_drift")
    energy = cs.simulate(SCENE, 0.3, integrator="auto").report["energy"]
    assert float(result.energy_drift) == energy["end"]["total"] - energy["start"]["total"]


def test_a_store_of_another_tolerance_is_refused(tmp_path):
    pytest.importorskip("zarr")
    sweep(SCENE, rtol=1e-4, store=tmp_path / "s.zarr", metrics="stable")
    with pytest.raises(ValueError, match=r"settings.rtol \(0.0001 in the store, 1e-05 given\)"):
        sweep(SCENE, rtol=1e-5, store=tmp_path / "s.zarr", metrics="stable")
