"""Forces on points: in every kernel and method, in energies, files and the reference; changed
between calls.
"""

import clothsim as cs
import numpy as np
import pytest
from variants import FIXED, cases


def forces(scene, seed=5):
    """Return forces in newtons, as large as the springs' of a crumpled sheet."""
    return 3.0 * np.random.default_rng(seed).normal(size=scene.initial_position.shape)


@cases()
def test_steps_agree_with_the_reference(variant, crumpled, relative):
    bound = {"double": 1e-12, "single": 5e-5}[variant.precision]
    for features in (
        {},
        {"mass": "uniform", "damped_by": "both"},
        {"shape": (5, 37), "pins": (), "mass": "uniform"},
    ):
        scene, x, v, dt = crumpled(**features)
        forced = scene.replace(force=forces(scene))
        expected = cs.reference_step(forced, x, v, dt, 50)
        assert relative(cs.step(forced, x, v, dt, 50, **variant.options), expected, x) < bound
        assert relative(expected, cs.reference_step(scene, x, v, dt, 50), x) > 1e-3


@pytest.mark.filterwarnings("ignore::clothsim.OrderWarning")
@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
@pytest.mark.parametrize("integrator", FIXED)
def test_a_force_in_proportion_to_mass_acts_like_gravity(integrator, kernel, crumpled, relative):
    scene, x, v, dt = crumpled(shape=(7, 9))
    extra = np.array([0.7, 2.0, -1.0])
    heavy = scene.replace(gravity=np.array(scene.gravity) + extra)
    forced = scene.replace(force=scene.cloth.mass_per_point[..., None] * extra)
    options = {"steps": 20, "integrator": integrator, "kernel": kernel}
    assert (
        relative(cs.step(forced, x, v, dt, **options), cs.step(heavy, x, v, dt, **options), x)
        < 1e-12
    )


def test_runs_and_the_trusted_solution_know_it(tmp_path, crumpled):
    scene, x, v, _ = crumpled(shape=(5, 6), damped_by="both")
    scene = scene.replace(position=x, velocity=v, force=forces(scene))
    trusted = cs.reference(scene, 0.05)
    run = cs.simulate(scene, 0.05, rtol=1e-9, atol=1e-12, integrator="dop853")
    assert np.abs(run.x[-1] - trusted.x[-1]).max() < 1e-8
    assert np.abs(run.x[-1] - cs.reference(scene.replace(force=None), 0.05).x[-1]).max() > 1e-3
    assert cs.load_scene(cs.save_scene(scene, tmp_path / "scene.toml")) == scene
    assert cs.load_run(run.save(tmp_path / "run.npz")).scene == scene
    assert cs.simulate(scene, 0.02, 1e-4).resume(0.01).report["steps"] == 100
