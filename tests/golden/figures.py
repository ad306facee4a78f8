"""Figures beside golden rows: error control, stable steps, a sweep, errors of methods, pictures."""

import functools
import json
from pathlib import Path

import clothsim as cs
import numpy as np
from golden.rows import arithmetic, scene_of
from pairwise import pairwise

FOLDER = Path(__file__).parent
FILE, REFERENCES = FOLDER / "figures.json", FOLDER / "references.npz"
DURATION = 0.125
ALWAYS = "structural+shear+bend"

# Largest relative difference of a figure. Those that are not named are equal up to rounding.
TOLERANCES = {
    "evaluations": 0.1,
    "estimate": 0.2,
    "error": 0.2,
    "rms_error": 0.2,
    "max_error": 0.2,
    "error_rms": 0.2,
    # The limit at a state settles to 1e-3; where it stops depends on the rounding of NumPy's BLAS.
    "here": 1e-4,
}
ROUNDING = 1e-5
# Smaller differences of errors are rounding [m].
LEAST_ERROR = 1e-9

# rtol and integrator, contact, feature, motion, shape, springs
ERROR_CONTROL = (
    (
        "default -",
        "1e-3 -",
        "1e-6 -",
        "1e-9 -",
        "1e-6 dopri5",
        "1e-4 rk4",
        "1e-8 dop853",
        "1e-4 velocity_verlet",
    ),
    ("free", "ray", "free", "penalty"),
    ("pins", "driven", "force", "mass", "drag"),
    ("still", "linear", "keyframes"),
    ("6x7", "8x5"),
    ("structural", "structural+shear", ALWAYS),
)


def error_control(rtol, integrator, *scene):
    reference = references()[" ".join(("error_control", rtol, integrator, *scene))]
    tolerance = None if rtol == "default" else float(rtol)
    integrator = None if integrator == "-" else integrator
    run = cs.simulate(
        _scene(*scene), DURATION, rtol=tolerance, integrator=integrator, **arithmetic("gather")
    )
    report = run.report
    estimate = run.report["error_estimate"]
    return {
        "asked": report["tolerance"]["asked"],
        "reached": report["tolerance"]["reached"],
        "told": not estimate["reason"],
        "estimate": estimate["rms"],
        "error": float(np.sqrt(((run.x[-1] - reference) ** 2).sum(-1).mean())),
        "evaluations": report["force_evaluations"],
    }


@functools.cache
def references():
    return dict(np.load(REFERENCES)) if REFERENCES.exists() else {}


def solution(*arguments):
    """Positions at the end, of small steps where a sphere is met."""
    scene = _scene(*arguments)
    if not scene.spheres:
        return cs.reference(scene, DURATION).x[-1]
    dt = 2.0**-18
    return cs.step(
        scene, scene.initial_position, scene.initial_velocity, dt, round(DURATION / dt), 0.0
    )[0]


def max_stable_dt(integrator):
    scenes = [_scene("free", feature, "still", "6x7", ALWAYS) for feature in ("drag", "mass")]
    return {
        "at rest": [cs.max_stable_dt(scene, integrator) for scene in scenes],
        "here": [cs.max_stable_dt(scene, integrator, x=scene.initial_position) for scene in scenes],
    }


def sweep(contact):
    metrics = [
        "stable",
        "energy_drift",
        "energy_gained",
        "largest_stretch",
        "penetration",
        "sag",
        "first_contact",
    ]
    metrics.append("error" if contact == "free" else "impulse")
    over = {"stiffness_structural": [450.0, 900.0], "dt": [2.0**-12, 2.0**-5]}
    scene = _scene(contact, "pins", "linear", "8x5", ALWAYS)
    return _numbers(cs.sweep(scene, over, duration=DURATION, metrics=metrics, progress=False))


def work_precision():
    methods = ["rk4", "velocity_verlet", "dop853 adaptive"]
    scene = _scene("free", "pins", "linear", "8x5", ALWAYS)
    settings = {
        "precisions": ["double", "single"],
        "dts": [2.0**-8, 2.0**-9],
        "rtols": [1e-3, 1e-4],  # 1e-5 is partly rounding in single
    }
    data = cs.work_precision(scene, DURATION, methods, **settings, windows=1)
    return _numbers(data[["setting", "rms_error", "max_error", "force_evaluations"]])


def _numbers(data):
    return {
        str(name): values.values.tolist()
        for name, values in data.items()
        if values.dtype.kind in "bif"
    }


def _scene(contact, feature, motion, shape, springs):
    return scene_of(f"- - - {contact} {feature} {motion} {shape} {springs}")


KINDS = {f.__name__: f for f in (error_control, max_stable_dt, sweep, work_precision)}
ROWS = [
    *(" ".join(("error_control", *row)) for row in pairwise(*ERROR_CONTROL)),
    *(f"max_stable_dt {name}" for name in ("rk4", "velocity_verlet", "pefrl", "dop853")),
    "sweep free",
    "sweep ray",
    "work_precision",
]


def compute(row):
    kind, *arguments = row.split()
    return KINDS[kind](*arguments)


@functools.cache
def golden():
    return json.loads(FILE.read_text())


PICTURES = {
    "faces": {},
    "stretch": {"color": "stretch", "camera": "top"},
    "speed": {"color": "speed", "camera": (1, 0.5, 2)},
    "depth": {"color": "depth", "camera": "top"},
    "label": {"label": True, "width": 320},
    "orthographic": {"camera": cs.Camera((0, 0, 1), (0.5, -0.1, 0.5), 1.2, 0.6), "ground": False},
}


def picture(name):
    """Pixels of a sheet upon two spheres; 3 mm lower, so that it is red in places."""
    scene = _scene("ray", "force", "linear", "16x20", ALWAYS)
    x, v = cs.step(scene, scene.initial_position, scene.initial_velocity, 2.0**-11, 150, 0.0)
    return cs.picture(
        scene, x - (0, 0.003, 0), 150 / 2**11, v=v, **{"width": 160, **PICTURES[name]}
    )
