"""The scenes of hashes.txt: each row's name says what it computes.

Only operations that IEEE 754 defines make these scenes, so that every machine has the same bits.
The edge kernel begins with the processor's estimate of a reciprocal root where its instruction set
has one: its hashes are those of a vendor.
"""

import hashlib
import re
from pathlib import Path

import clothsim as cs
import numpy as np

FILE = Path(__file__).parent / "hashes.txt"
# kernel and precision, integrator, contact, feature, motion of a sphere, shape, springs
COLUMNS = (
    ("edge double", "edge single", "gather double", "gather single"),
    ("rk4", "explicit_euler", "velocity_verlet", "pefrl", "dop853", "implicit_midpoint"),
    ("free", "reflect", "ray", "printed"),
    ("pins", "driven", "force", "mass", "drag"),
    ("still", "linear", "keyframes"),
    ("9x20", "16x16", "21x13"),
    ("structural", "structural+shear", "structural+shear+bend"),
)
# Each is computed by 1, 2 and 3 threads.
OF_THREADS = [
    f"{kernel} double rk4 ray mass linear 40x32 structural+shear+bend"
    for kernel in ("edge", "gather")
]
SPACING = 3 / 64, 4 / 64  # diagonals of 5 / 64
# Contact as a force: spheres, or a plane with friction. "batch" is a batch of two members.
OF_LAYERS = [
    "edge double rk4 penalty pins keyframes 9x20 structural+shear+bend",
    "edge single rk4 penalty mass linear 16x16 structural+shear",
    "gather double rk4 penalty drag keyframes 9x20 structural+shear",
    "gather single rk4 penalty force linear 21x13 structural+shear+bend",
    "edge double rk4 floor mass still 21x13 structural+shear",
    "edge single rk4 floor driven keyframes 9x20 structural+shear+bend",
    "gather double rk4 floor pins linear 16x16 structural",
    "gather single rk4 floor drag still 9x20 structural",
    "edge double rk4 penalty batch linear 9x20 structural+shear",
    "gather single rk4 penalty batch keyframes 21x13 structural",
    "edge double dop853 penalty force still 21x13 structural+shear",
    "gather double dop853 floor driven linear 9x20 structural",
    "edge double velocity_verlet penalty driven keyframes 9x20 structural+shear+bend",
    "gather single velocity_verlet floor mass linear 16x16 structural+shear+bend",
    "edge double implicit_midpoint penalty pins linear 16x16 structural+shear",
]
STIFFNESS = {"structural": 900.0, "shear": 350.0, "bend": 130.0}
DAMPING = {"structural": 0.5, "shear": 0.25, "bend": 0.125}


def key(row, isa):
    """Return what the bits of a row depend on."""
    kernel, precision = row.split()[:2]
    if kernel == "gather":
        return "any"
    if isa in ("avx2", "sse2") and precision == "double":  # this root is exact
        return isa
    vendor = re.search(r"vendor_id\s*: *(\S+)", Path("/proc/cpuinfo").read_text())
    return f"{isa}/{vendor[1] if vendor else 'unknown'}"


def golden():
    """Return the stored hashes of each row, by key."""
    lines = (
        line.rsplit(": ", 1) for line in FILE.read_text().splitlines() if line and line[0] != "#"
    )
    return {row: dict(pair.split("=") for pair in hashes.split()) for row, hashes in lines}


def scene_of(row):
    """Return a crumpled sheet, nowhere symmetric, that falls on one sphere or two."""
    _, _, _, contact, feature, motion, shape, springs = row.split()
    rows, columns = shape = tuple(map(int, shape.split("x")))
    springs = springs.split("+")
    noise = (
        np.frombuffer(hashlib.shake_256(row.encode()).digest(10 * rows * columns), np.int8).reshape(
            10, rows, columns
        )
        / 128
    )
    noise = np.moveaxis(noise, 0, -1)
    pins = {(0, 0): None, (-1, -1): None, (rows // 2, 1): None}
    if feature == "driven":
        pins[0, 0] = cs.Linear((0.5, 1.0, -0.25))
        pins[-1, -1] = cs.Keyframes(
            (0, 1 / 64, 1 / 16), offsets=((0, 0, 0), (1 / 128, 0, 1 / 64), (0, -1 / 64, 0))
        )
    undamped = feature in ("drag", "force")
    cloth = cs.Cloth(
        shape,
        size=tuple(h * (n - 1) for h, n in zip(SPACING, shape, strict=True)),
        mass=(1.5 + noise[..., 9]) / 16 if feature == "mass" else rows * columns / 8,
        stiffness={family: STIFFNESS[family] for family in springs},
        damping=0.0 if undamped else {family: DAMPING[family] for family in springs},
        drag=0.5 if feature == "drag" else 0.0,
        springs=springs,
        pins=pins,
    )
    velocity = noise[..., 3:6] / 2 - (0.0, 2.0, 0.0)
    velocity[cloth.pinned] = 0.0
    for pin, pin_motion in cloth.driven.items():
        velocity[pin] = pin_motion.velocity_at(0.0)
    return cs.Scene(
        cloth,
        _spheres(contact, motion, cloth),
        gravity=(0.25, -9.8125, 0.75),
        position=cloth.rest_positions + noise[..., :3] / 128,
        velocity=velocity,
        force=noise[..., 6:9] if feature == "force" else None,
    )


def _spheres(contact, motion, cloth):
    if contact == "free":
        return ()
    length, width = cloth.size
    place = x, y, z = (width / 4, -0.203125, length / 2)
    moves = {
        "still": None,
        "linear": cs.Linear((0.25, 1.0, -0.5)),
        "keyframes": cs.Keyframes(
            (0, 1 / 64, 1 / 16), centers=(place, (x, y + 1 / 64, z - 1 / 128), place)
        ),
    }
    if contact == "floor":
        moves["keyframes"] = cs.Keyframes(
            (0, 1 / 64, 1 / 16), offsets=((0, 0, 0), (0, 1 / 64, -1 / 128), (0, 0, 0))
        )
        return cs.Plane((x, -3 / 128, z), (1 / 64, 1.0, -1 / 128), moves[motion], friction=0.25)
    if contact == "penalty":
        first = cs.Sphere(place, 3 / 16, moves[motion], friction=0.25 * (motion == "still"))
        second = first.replace(center=(3 * x, y, z), motion=None, friction=0.5)
        return (first, second) if cloth.columns >= 20 else first
    first = cs.Sphere(
        place,
        3 / 16,
        moves[motion],
        "reflect" if contact == "printed" else contact,
        "edge",
        restitution=0.0 if motion == "still" else 0.5,
        friction=0.25,
        as_printed=contact == "printed",
    )
    second = first.replace(center=(3 * x, y, z), motion=None)
    return (first, second) if cloth.columns >= 20 else first


def arithmetic(kernel):
    return {"kernel": kernel}


def digest(row, threads=1, scene=None):
    """Hash of the state after 300 steps, 100 of an implicit method, on the instruction set of
    CLOTHSIM_ISA.
    """
    kernel, precision, integrator = row.split()[:3]
    scene = scene or scene_of(row)
    members = [scene, scene.replace(velocity=None)] if " batch " in row else [scene]
    dt = 2.0**-14 if integrator == "explicit_euler" else 2.0**-12
    steps = 100 if integrator == "implicit_midpoint" else 300
    x, v = (
        np.stack([getattr(member, f"initial_{name}") for member in members])
        for name in ("position", "velocity")
    )
    x, v = cs.step(
        members, x, v, dt, steps, 0.0, integrator, precision, threads, **arithmetic(kernel)
    )
    return hashlib.sha256(x.tobytes() + v.tobytes()).hexdigest()[:16]
