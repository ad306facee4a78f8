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


def positions(run):
    return run.x


def sweep(scene, over=None, **options):
    return cs.sweep(scene, over, progress=False, **{"duration": 0.3, **options})


@pytest.mark.parametrize("options", [{}, {"every": 0.1}], ids=["ends", "frames"])
@pytest.mark.parametrize("scene", [SCENE, UNDAMPED, BALL], ids=["damped", "undamped", "ball"])
def test_members_are_those_of_simulate(scene, options):
    """Methods with dense output, and those with a fixed step that "auto" takes: undamped, loose."""
    metrics = ["energy_drift", "largest_stretch", "penetration", "first_contact", positions]
    result = sweep(scene, {"rtol": [2e-5, 1e-3]}, metrics=metrics, **options)
    for rtol in (2e-5, 1e-3):
        run = cs.simulate(scene, 0.3, rtol=rtol, every=options.get("every"), threads=1)
        report = run.report
        mine = result.sel(rtol=rtol)
        assert (
            float(mine.energy_drift)
            == report["energy"]["end"]["total"] - report["energy"]["start"]["total"]
        )
        assert float(mine.largest_stretch) == report["stretch"]["largest"]
        assert float(mine.penetration) == report["penetration"]["triangles"]
        assert repr(float(mine.first_contact)) == repr(report["first_contact"]["time"])
        assert float(mine.max_stable_dt) == cs.max_stable_dt(scene, report["integrator"])
        assert mine.positions.values.tobytes() == run.x.tobytes()


def test_the_error_is_within_the_request():
    tolerances = [1e-4, 1e-6, 1e-8]
    result = sweep(SCENE, {"atol": tolerances}, metrics="error", integrator="dop853")
    assert result.atol.attrs["units"] == "m"
    assert (result.error_rms <= result.atol).all() and (result.error_rms > 1e-4 * result.atol).all()
    relative = sweep(SCENE, {"rtol": tolerances}, metrics="error", integrator="dop853")
    assert max(SCENE.cloth.size) == 1.0 and np.array_equal(relative.error, result.error)
    assert relative.rtol.attrs["units"] == "1"


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
