"""What a report says about all states of a run: depths, stretches and the first contact.

The reference is a `Stepper` that takes the same steps one by one, and the measures of each state.
"""

import clothsim as cs
import numpy as np
import pytest

CLOTH = cs.Cloth((9, 21), mass=1.0, stiffness=200.0, damping=0.2, pins=((0, 0), (-1, 0), (4, 10)))
PASSAGE = cs.Linear((0.3, 2.0, 0.1))  # motion through the cloth, over its pinned point


def ball(**changes):
    return cs.Sphere(
        **{
            "center": (0.5, -0.35, 0.5),
            "radius": 0.2,
            "response": "ray",
            "offset": "edge",
            "restitution": 1.0,
            **changes,
        }
    )


SCENES = {
    "reflect": ball(response="reflect", motion=PASSAGE),
    "as printed": ball(response="reflect", motion=PASSAGE, as_printed=True, offset="none"),
    "ray": ball(motion=PASSAGE),
    "still": ball(response="reflect", center=(0.7, -0.22, 0.5)),
    "starts on the cloth": ball(center=(0.3, -0.05, 0.4)),
    "penalty": ball(response="penalty", restitution=None, motion=cs.Linear((0.1, 0.5, 0.0))),
}
MIXED = [
    ball(response="reflect", motion=PASSAGE, radius=0.15),
    ball(center=(0.6, -0.3, 0.4), radius=0.1),
    ball(response="penalty", restitution=None, center=(0.2, -0.3, 0.4), radius=0.1),
]
SCENES = {name: cs.Scene(CLOTH, sphere) for name, sphere in SCENES.items()}
SCENES["three of them"] = cs.Scene(CLOTH, MIXED)
STEPS = 130
DT = 2e-3
REPORTED = ("penetration", "stretch", "first_contact")

pytestmark = pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")


def depths(scene, x, t):
    pairs = [cs.penetration(x, sphere, t) for sphere in scene.spheres]
    return np.array([[pair["points"], pair["triangles"]] for pair in pairs]).max(axis=0)


def step_by_step(scene, **options):
    """Measure depths of all states, shape (states, 2), stretches and the step of first contact."""
    stepper = cs.Stepper(scene, **options)
    far = [s.replace(center=(0.0, 1e3, 0.0), motion=None) for s in scene.spheres]
    free = cs.Stepper(scene.replace(spheres=far), **options)
    depths_of_states = []
    stretches = []
    first = np.nan
    for k in range(STEPS + 1):
        if k > 0:
            stepper.advance(1, DT)
            free.advance(1, DT)
        x = stepper.positions
        depths_of_states.append(depths(scene, x, stepper.time))
        stretches.append(cs.largest_stretch(scene, x))
        same = (x == free.positions).all() and (stepper.velocities == free.velocities).all()
        if np.isnan(first) and not same:
            first = stepper.time
    return np.array(depths_of_states), np.array(stretches), first


def extremes(report):
    return {name: report[name] for name in REPORTED}


@pytest.mark.filterwarnings("ignore::clothsim.OrderWarning")
@pytest.mark.parametrize(
    ("name", "integrator", "precision"),
    [(name, "rk4", "double") for name in SCENES]
    + [(name, "rk4", "single") for name in ("reflect", "penalty", "three of them")]
    + [
        (name, other, "double")
        for name in ("three of them", "ray")
        for other in ("velocity_verlet", "pefrl")
    ],
)
def test_measures_over_steps_equal_measures_of_every_state(name, integrator, precision):
    scene = SCENES[name]
    options = {"integrator": integrator, "precision": precision}
    depth_of_states, stretches, first = step_by_step(scene, **options)
    report = cs.simulate(scene, STEPS * DT, DT, threads=1, every=1, **options).report
    depth = report["penetration"]
    exact = {"rel": 1e-12, "abs": 1e-15}
    assert depth["points"] == pytest.approx(depth_of_states[:, 0].max(), **exact)
    assert depth["triangles"] == pytest.approx(depth_of_states.max(), **exact)
    assert report["stretch"] == {"largest": pytest.approx(stretches.max(), rel=1e-12), "reason": ""}
    assert 0 < first <= 0.26 if name != "starts on the cloth" else first == DT
    assert report["first_contact"] == {"time": pytest.approx(first, rel=1e-12), "reason": ""}
    # The contact radius, or the layer, keeps the cloth out of these.
    if name not in ("still", "penalty"):
        assert depth_of_states[:, 0].max() > 1e-3
    # These spheres are deep in the cloth within the run, and out again at its end.
    if name in ("reflect", "as printed"):
        assert depth_of_states[-1, 0] < 0.5 * depth_of_states[:, 0].max()


@pytest.mark.parametrize("name", ["reflect", "three of them", "penalty"])
def test_they_are_the_same_for_every_number_of_threads(name, kernel):
    reports = [
        cs.simulate(SCENES[name], STEPS * DT, DT, threads=n, kernel=kernel).report
        for n in (1, 2, 3)
    ]
    assert extremes(reports[0]) == extremes(reports[1]) == extremes(reports[2])
