"""`sweep`: what it computes, and how it is labelled."""

import re

import clothsim as cs
import numpy as np
import pytest
from clothsim.sweeps.metrics import METRICS

xarray = pytest.importorskip("xarray")

SMALL = cs.scenes.hanging(shape=(6, 7), springs=("structural", "shear"))
BALL = cs.Scene(
    cs.Cloth((7, 7), mass=1.0, stiffness=200.0, damping=0.2),
    cs.Sphere((0.5, -0.3, 0.5), 0.2, restitution=0.5, response="ray", offset="edge"),
)


def sweep(*args, **options):
    return cs.sweep(*args, progress=False, **options)


# A member has the bits of its run


def test_members_have_the_bits_of_simulate(crumpled):
    scene = crumpled(shape=(5, 9)).scene.replace(
        spheres=cs.Sphere((0.5, -0.2, 0.5), 0.15, response="ray", offset="edge")
    )
    over = {
        "damping_shear": [0.1, 0.5],
        "precision": ["single", "double"],
        "dt": [7e-4, 1e-3],
        "kernel": ["edge", "gather"],
    }
    metrics = {
        "stable": "stable",
        "t": lambda run: run.t,
        "x": lambda run: run.x,
        "v": lambda run: run.v,
    }
    result = sweep(scene, over, duration=0.1, every=0.033, metrics=metrics)
    assert result.stable.all()
    for k, damping in enumerate(over["damping_shear"]):
        member_scene = scene.replace(
            cloth=scene.cloth.replace(damping={**scene.cloth.damping, "shear": damping})
        )
        for precision in over["precision"]:
            for dt in over["dt"]:
                for kernel in over["kernel"]:
                    single = cs.simulate(
                        member_scene,
                        0.1,
                        dt=dt,
                        every=0.033,
                        precision=precision,
                        kernel=kernel,
                        threads=1,
                    )
                    member_run = result.isel(damping_shear=k).sel(
                        precision=precision, dt=dt, kernel=kernel
                    )
                    assert (
                        member_run.x.values.tobytes() == single.x.tobytes()
                        and member_run.v.values.tobytes() == single.v.tobytes()
                    )
                    assert np.array_equal(member_run.t, single.t) and len(single.t) == 5


UNDAMPED = cs.Scene(cs.Cloth((6, 7), mass=2.56, stiffness=1e3, damping=0))


@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
@pytest.mark.parametrize(("scene", "dt", "first"), [(SMALL, 2e-2, 1), (UNDAMPED, 7.6e-3, 65)])
def test_a_member_that_diverges_is_marked(scene, dt, first):
    with pytest.warns(RuntimeWarning, match="'abs'"):
        result = sweep(
            scene, {"dt": [1e-3, dt]}, duration=2.0, metrics=["stable", "energy_drift", abs]
        )
    with pytest.raises(cs.UnstableError) as caught:
        cs.simulate(scene, 2.0, dt=dt)
    assert caught.value.step >= first  # the core is first called for 64 steps
    bad = result.isel(dt=1)
    assert int(bad.status) == 2 and not bad.stable
    assert int(bad.unstable_step) == caught.value.step
    assert float(bad.unstable_time) == caught.value.time
    assert float(bad.max_stable_dt) == caught.value.max_stable_dt == cs.max_stable_dt(scene)
    assert str(bad.message.values) == str(caught.value)
    assert np.isnan(bad.energy_drift)
    # `abs` of a run is an error of the function's own: that member's loss, the other's not.
    assert int(result.isel(dt=0).status) == 3 and "abs" in str(result.isel(dt=0).message.values)


def test_a_point_that_goes_through_a_layer_harms_its_member_alone(leak):
    scenes = {"slow": leak(0.1), "fast": leak(1.0)}
    metrics = ["stable", "energy_drift"]
    result = sweep(SMALL, {"scene": scenes}, duration=0.3, dt=1e-3, metrics=metrics)
    with pytest.raises(cs.ContactError) as caught:
        cs.simulate(scenes["fast"], 0.3, dt=1e-3)
    assert result.status.values.tolist() == [1, 2]
    assert result.stable.values.tolist() == [True, False]
    assert int(result.unstable_step[1]) == caught.value.step > 1
    assert float(result.unstable_time[1]) == caught.value.time
    assert str(result.message.values[1]) == str(caught.value)
    assert np.isfinite(result.energy_drift[0]) and np.isnan(result.energy_drift[1])


# Metrics


LOOSE = cs.Scene(cs.Cloth((5, 5), mass=1.0, stiffness=200.0, damping=0.2))


@pytest.fixture(scope="module")
def solution():
    """Solve LOOSE to 0.15 s by extrapolation, which shares no code with the sweep."""
    return cs.reference(LOOSE, 0.15).x[-1]


def test_error_is_the_distance_from_the_solution(solution):
    dts = [4e-3, 2e-3, 1e-3]
    result = sweep(LOOSE, {"dt": dts}, duration=0.15, metrics="error")
    for dt in dts:
        run = cs.simulate(LOOSE, 0.15, dt=dt)
        distance = np.linalg.norm(run.x[-1] - solution, axis=-1)
        member_run = result.sel(dt=dt)
        assert float(member_run.error) == pytest.approx(distance.max(), rel=1e-4, abs=0)
        assert float(member_run.error_rms) == pytest.approx(
            np.sqrt((distance**2).mean()), rel=1e-4, abs=0
        )
    orders = np.log2(result.error.values[:-1] / result.error.values[1:])
    assert orders == pytest.approx([4, 4], abs=0.25)


@pytest.mark.parametrize("response", ["ray", "reflect"])
def test_after_a_contact_there_is_no_error_but_a_reason(response):
    """At 0.2 s the cloth is still above the sphere, at 0.6 s it lies on it."""
    scene = BALL.replace(spheres=BALL.spheres[0].replace(response=response))
    result = sweep(scene, {"duration": [0.1, 0.6]}, dt=1e-3, metrics=["error", "stable"])
    before, after = (result.isel(duration=k) for k in (0, 1))
    assert 0 < float(before.error) < 1e-6 and str(before.message.item()) == ""
    assert int(after.status) == 1 and bool(after.stable)
    for name in ("error", "error_rms", "reference_error"):
        assert np.isnan(after[name])
    assert "contact" in after.message.item() and "chaotic" in after.message.item()


def test_members_that_differ_only_in_numerics_use_one_reference(monkeypatch):
    from clothsim.sweeps import metrics

    solved = []
    solve = metrics.solve_in_double
    metrics._cached_reference.cache_clear()
    monkeypatch.setattr(
        metrics,
        "solve_in_double",
        lambda *args: solved.append(args[0].cloth.stiffness) or solve(*args),
    )
    over = {"stiffness": [100.0, 200.0], "dt": [1e-3, 2e-3], "precision": ["single", "double"]}
    assert BALL.cloth.stiffness == 200.0
    shared = sweep(BALL, over, duration=0.05, metrics="error")
    assert sorted(solved) == [100.0, 200.0]
    # and what a member gets does not depend on which others there are
    single = sweep(BALL, {"dt": [2e-3]}, duration=0.05, metrics="error").isel(dt=0)
    assert float(single.error) == float(
        shared.error.sel(stiffness=200.0, dt=2e-3, precision="double")
    )


@pytest.mark.parametrize("step", [{"dt": 1e-3}, {"rtol": 1e-3}])
def test_the_impulse_is_that_of_the_run_over_all_spheres(step):
    scene = BALL.replace(spheres=[*BALL.spheres, BALL.spheres[0].replace(center=(0.2, -0.3, 0.3))])
    result = sweep(scene, duration=0.4, metrics="impulse", **step)
    impulse = np.sum(cs.simulate(scene, 0.4, **step).report["impulse"], axis=0)
    assert impulse[1] < -0.1
    np.testing.assert_allclose([float(result[f"impulse_{k}"]) for k in "xyz"], impulse, rtol=1e-14)
    assert float(result.impulse) == pytest.approx(np.linalg.norm(impulse), rel=1e-14)
    assert result.impulse.attrs["units"] == "N s"
    assert (
        float(sweep(scene.replace(spheres=()), duration=0.01, dt=1e-3, metrics="impulse").impulse)
        == 0
    )


def mean_height(run):
    return run.x[..., 1].mean(axis=(1, 2))


def ends(run):
    return {"first": run.t[0], "last": run.t[-1], "steps": run.report["steps"]}


def test_functions_of_the_run():
    metrics = {"height": mean_height, "stable": "stable", "ends": ends}
    result = sweep(SMALL, {"mass": [1.0, 2.0]}, duration=0.2, dt=1e-3, every=0.05, metrics=metrics)
    run = cs.simulate(SMALL.replace(cloth=SMALL.cloth.replace(mass=2.0)), 0.2, dt=1e-3, every=0.05)
    assert result.height.dims == ("mass", "height_0")
    assert np.array_equal(result.height[1], mean_height(run))
    assert result.ends_steps.values.tolist() == [200, 200] and float(result.ends_last[0]) == 0.2


# Which members there are, and their labels


def test_coordinates_have_units():
    result = sweep(SMALL, {"stiffness": np.array([1e3, 2e3]), "dt": (1e-3,)}, duration=0.01)
    assert result.stable.dims == ("stiffness", "dt") and result.sizes == {"stiffness": 2, "dt": 1}
    assert result.stiffness.attrs == {"long_name": "stiffness", "units": "N/m"}
    assert result.dt.attrs["units"] == "s" and result.largest_stretch.attrs["units"] == "1"
    assert result.sel(stiffness=2e3, dt=1e-3).stable
    variables = {"status", "max_stable_dt", "unstable_step", "unstable_time", "message"}
    assert set(result.data_vars) == variables | {"stable", "energy_drift", "largest_stretch"}


def test_shapes_of_many_sizes():
    shapes = [(4, 5), (6, 3)]
    scene = cs.Scene(cs.Cloth(mass=1.0, stiffness=100.0, damping=0.1))
    result = sweep(
        scene,
        {"shape": shapes},
        duration=0.05,
        dt=1e-3,
        metrics={"tip": lambda run: run.x[-1, -1, -1]},
    )
    assert result["shape"].values.tolist() == ["4x5", "6x3"]
    assert result.rows.values.tolist() == [4, 6] and result.columns.values.tolist() == [5, 3]
    for k, shape in enumerate(shapes):
        run = cs.simulate(scene.replace(cloth=scene.cloth.replace(shape=shape)), 0.05, dt=1e-3)
        assert np.array_equal(result.tip[k], run.x[-1, -1, -1])
    with pytest.raises(
        ValueError, match="metric 'last' must give every member an array of one shape"
    ):
        sweep(
            scene,
            {"shape": shapes},
            duration=0.05,
            dt=1e-3,
            metrics={"last": lambda run: run.x[-1]},
        )


def test_zipped_lists_and_labelled_values():
    over = {
        ("stiffness", "dt"): [(1e3, 1e-3), (4e3, 5e-4)],
        "sphere_motion": {"still": None, "up": cs.Linear((0, 1, 0))},
    }
    result = sweep(BALL, over, duration=0.05, metrics=["stable", ends])
    assert result.stable.dims == ("stiffness_dt", "sphere_motion")
    assert result.stiffness.dims == result.dt.dims == ("stiffness_dt",)
    assert result.sphere_motion.values.tolist() == ["still", "up"]
    assert result.ends_steps.values.tolist() == [[50, 50], [100, 100]]


def test_given_samples():
    samples = [{"mass": 1.0, "dt": 1e-3}, {"mass": 2.0, "dt": 2e-3}, {"mass": 3.0, "dt": 1e-3}]

    class Table:
        def to_dict(self, kind):
            assert kind == "records"
            return samples

    for table in (samples, Table()):
        result = sweep(SMALL, table, duration=0.05, metrics=ends)
        assert result.ends_steps.dims == ("sample",)
        assert result.ends_steps.values.tolist() == [50, 25, 50]
        assert result.mass.values.tolist() == [1, 2, 3]


@pytest.mark.parametrize("given", [{}, {"integrator": "velocity_verlet"}], ids=str)
def test_without_a_step_a_member_is_the_run_of_simulate(given):
    result = sweep(SMALL, {"stiffness": [1e3, 1e5]}, duration=0.2, metrics=ends, **given)
    for k, stiffness in enumerate((1e3, 1e5)):
        scene = SMALL.replace(cloth=SMALL.cloth.replace(stiffness=stiffness))
        run = cs.simulate(scene, 0.2, **given)
        assert result.ends_steps[k] == run.report["steps"]
        assert run.report["tolerance"]["asked"] > 0


@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
def test_sag_is_that_of_the_rest_state():
    scene = cs.Scene(
        cs.Cloth((2, 2), mass=4.0, stiffness=500.0, springs=("structural",), pins=[(0, 0), (0, 1)]),
        gravity=(0, 0, 10),
    )
    result = sweep(scene, {"stiffness": [250.0, 500.0]}, duration=0.01, dt=1e-3, metrics="sag")
    assert result.sag.values == pytest.approx(
        [10 / 250, 10 / 500], abs=1e-7
    )  # m g / K of the two lower points
    falls = sweep(
        scene.replace(cloth=scene.cloth.replace(pins=())),
        {"stiffness": [500.0]},
        duration=0.01,
        dt=1e-3,
        metrics="sag",
    )
    assert np.isnan(falls.sag.values).all()


def test_an_impossible_member_of_a_large_grid_is_found():
    over = {"stiffness": np.linspace(1, 2, 100), "mass": [*np.linspace(1, 2, 99), -1.0]}
    with pytest.raises(ValueError, match="mass=-1.0"):
        sweep(SMALL, over, duration=1.0)


def test_metric_names_are_documented():
    for name in {*METRICS}.union(*(metric.variables for metric in METRICS.values())):
        assert re.search(rf"\b{name}\b", cs.sweep.__doc__)
