"""Fixtures of all tests: each kernel this processor runs, scenes that use every feature, and an
oracle in NumPy that shares no code with the core.
"""

import os
import signal
from dataclasses import dataclass

import clothsim as cs
import numpy as np
import pytest
import tables
from clothsim.engine.options import PRECISIONS
from variants import NAMED_KERNELS, NATIVE_VARIANTS


def pytest_configure(config):
    tables.single_rows = bool(config.getoption("keyword"))


def pytest_collection_modifyitems(config, items):
    """Deselect tests that cannot run under the present sanitizer, as their marks say."""
    sanitizer = os.environ.get("CLOTHSIM_TEST_SANITIZER")
    unfit = [
        item
        for item in items
        if any(sanitizer in mark.args for mark in item.iter_markers("unsanitized"))
    ]
    if unfit:
        config.hook.pytest_deselected(items=unfit)
        items[:] = [item for item in items if item not in unfit]


@pytest.fixture(scope="session", autouse=True)
def ctrl_c():
    """Ctrl-C counts, also where the suite runs in the background of a script, which ignores it."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def _chosen(request, monkeypatch):
    monkeypatch.setenv("CLOTHSIM_ISA", request.param.instruction_set)
    return request.param


@pytest.fixture(params=NATIVE_VARIANTS, ids=str)
def variant(request, monkeypatch):
    """Every kernel x precision x arithmetic class of the default instruction set.

    `variants.cases` brings other instruction sets.
    """
    return _chosen(request, monkeypatch)


@pytest.fixture(params=[v for v in NATIVE_VARIANTS if v.precision == "double"], ids=str)
def double_variant(request, monkeypatch):
    """Return the variants that compute in double."""
    return _chosen(request, monkeypatch)


@pytest.fixture(params=NAMED_KERNELS)
def kernel(request):
    """Every kernel, on the instruction set that is used by default."""
    return request.param


@pytest.fixture(params=PRECISIONS)
def precision(request):
    return request.param


@dataclass(frozen=True)
class State:
    scene: cs.Scene
    x: np.ndarray
    v: np.ndarray
    dt: float

    def __iter__(self):
        return iter((self.scene, self.x, self.v, self.dt))


def _state(
    shape=(9, 20),
    springs=("structural", "shear", "bend"),
    damped_by="springs",
    mass="per point",
    pins=None,
    seed=1,
    **scene,
):
    """Return a crumpled, moving sheet, nowhere symmetric, with another coefficient everywhere."""
    rng = np.random.default_rng(seed)
    stiffness = {"structural": 900.0, "shear": 350.0, "bend": 130.0}
    damping = {"structural": 0.5, "shear": 0.3, "bend": 0.2}
    if pins is None:
        pins = [(0, 0), (-1, -1), (shape[0] // 2, shape[1] // 2)] if min(shape) > 2 else [(0, 0)]
    cloth = cs.Cloth(
        shape,
        size=(0.9, 1.3),
        mass=rng.uniform(0.05, 0.15, shape) if mass == "per point" else 0.1 * shape[0] * shape[1],
        stiffness={f: stiffness.get(f, 220.0) for f in springs},
        damping={f: damping.get(f, 0.1) for f in springs}
        if damped_by in ("springs", "both")
        else 0.0,
        drag=0.4 if damped_by in ("points", "both") else 0.0,
        springs=springs,
        pins=pins,
    )
    scene = cs.Scene(cloth, **{"gravity": (0.3, -9.80665, 0.7), **scene})
    spacing = min(h for h in cloth.spacing if h)
    x = cloth.rest_positions + 0.15 * spacing * rng.normal(size=(*shape, 3))
    v = 0.5 * rng.normal(size=(*shape, 3))
    v[cloth.pinned] = 0.0
    return State(scene, x, v, min(0.2 * cs.max_stable_dt(scene), 0.01))


@pytest.fixture
def crumpled():
    """`crumpled(**features)`: a scene, a state without any symmetry, and a stable time step."""
    return _state


class Oracle:
    """Newton's second law for the rows of `Cloth.spring_table`, in NumPy."""

    @staticmethod
    def acceleration(scene, x, v):
        cloth = scene.cloth
        table = cloth.spring_table()
        x = x.reshape(-1, 3)
        v = v.reshape(-1, 3)
        d = x[table["j"]] - x[table["i"]]
        length = np.linalg.norm(d, axis=1)
        n = d / length[:, None]
        rate = ((v[table["j"]] - v[table["i"]]) * n).sum(axis=1)
        pull = table["stiffness"] * (length - table["rest_length"]) + table["damping"] * rate
        force = -cloth.drag * v
        np.add.at(force, table["i"], pull[:, None] * n)
        np.subtract.at(force, table["j"], pull[:, None] * n)
        a = force / cloth.mass_per_point.reshape(-1, 1) + np.array(scene.gravity)
        a[cloth.pinned.ravel()] = 0.0
        return a.reshape(*cloth.shape, 3)

    @classmethod
    def solution(cls, scene, duration):
        """x at the end, by an adaptive method of order 8 with a relative tolerance of 1e-12."""
        from scipy.integrate import solve_ivp

        shape = (2, *scene.cloth.shape, 3)

        def rate(_, y):
            x, v = y.reshape(shape)
            return np.concatenate([v.ravel(), cls.acceleration(scene, x, v).ravel()])

        start = np.concatenate([scene.initial_position.ravel(), scene.initial_velocity.ravel()])
        run = solve_ivp(rate, (0, duration), start, method="DOP853", rtol=1e-12, atol=1e-14)
        assert run.success
        return run.y[:, -1].reshape(shape)[0]


@pytest.fixture
def oracle():
    return Oracle


def _relative(result, expected, start):
    """Largest difference over the largest displacement or speed, of the worse of x and v."""
    (x, v), (x_expected, v_expected) = result, expected
    return max(
        float(np.abs(x - x_expected).max() / np.abs(x_expected - start).max()),
        float(np.abs(v - v_expected).max() / np.abs(v_expected).max()),
    )


@pytest.fixture
def relative():
    return _relative


def _same_bits(result, expected):
    pairs = zip(result, expected, strict=True)
    return all(a.dtype == b.dtype and a.tobytes() == b.tobytes() for a, b in pairs)


@pytest.fixture
def same_bits():
    """Whether two tuples of arrays are equal to the last bit, signs of zero included."""
    return _same_bits


def _overflowing(shape, point, precision, **cloth):
    pins = np.ones(shape, bool)
    pins[point] = False
    springs = {"springs": ("structural",), "damping": 0.0, "stiffness": 1e-3}
    scene = cs.Scene(cs.Cloth(shape, pins=pins, **springs, **cloth))
    v = np.zeros_like(scene.initial_position)
    v[point][2] = 0.9 * float(np.finfo(np.float32 if precision == "single" else np.float64).max)
    return scene, v


@pytest.fixture
def overflowing():
    """Return a scene of which one mass point only can move, and velocities.

    With these it overflows within 5 steps of 0.9 s.
    """
    return _overflowing


@pytest.fixture
def leak():
    """`leak(speed)`: a mass point on its way to a soft plane, through whose layer it goes at 1 m/s,
    and another far away.
    """

    def scene(speed=1.0):
        plane = cs.Plane(thickness=0.1, stiffness=5.0, dissipation=0.0)
        position = np.array([[[0.0, 0.11, 0.0], [50.0, 50.0, 50.0]]])
        velocity = np.array([[[0.0, -speed, 0.0], [0.0, 0.0, 0.0]]])
        cloth = cs.Cloth((1, 2), springs=(), pins=(), mass=2.0, damping=0.0)
        return cs.Scene(cloth, plane, (0, 0, 0), position, velocity)

    return scene
