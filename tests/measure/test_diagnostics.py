"""Energy, penetration depth and the stable time step against formulas in NumPy."""

import clothsim as cs
import numpy as np
import pytest


def test_energy_is_that_of_the_spring_table(crumpled):
    scene, x, v, _ = crumpled()
    scene = scene.replace(force=np.random.default_rng(3).normal(size=x.shape))
    table = scene.cloth.spring_table()
    m = scene.cloth.mass_per_point
    flat = x.reshape(-1, 3)
    stretch = np.linalg.norm(flat[table["j"]] - flat[table["i"]], axis=1) - table["rest_length"]
    expected = {
        "kinetic": (m * (v**2).sum(axis=-1)).sum() / 2,
        "elastic": (table["stiffness"] * stretch**2).sum() / 2,
        "gravity": -(m[..., None] * x * np.array(scene.gravity)).sum(),
        "force": -(scene.force * x).sum(),
        "contact": 0.0,
    }
    result = cs.energy(scene, x, v)
    assert set(result) == {*expected, "total"}
    for name, value in expected.items():
        np.testing.assert_allclose(result[name], value, rtol=1e-12)
    np.testing.assert_allclose(result["total"], sum(expected.values()), rtol=1e-12)


def test_forces_are_the_slope_of_the_energy(double_variant, crumpled):
    scene, x, v, _ = crumpled(damped_by="nothing", pins=())
    scene = scene.replace(force=3.0 * np.random.default_rng(3).normal(size=x.shape))
    v = 0 * v
    a = cs.acceleration(scene, x, v, **double_variant.options)
    way = np.random.default_rng(4).normal(size=x.shape)
    h = 1e-6
    slope = (
        cs.energy(scene, x + h * way, v)["total"] - cs.energy(scene, x - h * way, v)["total"]
    ) / (2 * h)
    power = (scene.cloth.mass_per_point[..., None] * a * way).sum()
    np.testing.assert_allclose(power, -slope, rtol=1e-7)


def distance(corners):
    """From the origin to triangles (n, 3 corners, 3)."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(first, second)
    area2 = (normal * normal).sum(axis=1)
    divisor = np.where(area2 > 0, area2, 1)
    u = -(np.cross(corners[:, 0], second) * normal).sum(axis=1) / divisor
    v = -(np.cross(first, corners[:, 0]) * normal).sum(axis=1) / divisor
    is_inside = (area2 > 0) & (np.stack([1 - u - v, u, v]) >= 0).all(axis=0)
    foot = corners[:, 0] + u[:, None] * first + v[:, None] * second
    distances = [np.where(is_inside, np.linalg.norm(foot, axis=1), np.inf)]
    for k in range(3):
        side = corners[:, (k + 1) % 3] - corners[:, k]
        length2 = (side * side).sum(axis=1)
        part = np.clip(
            -(side * corners[:, k]).sum(axis=1) / np.where(length2 > 0, length2, 1), 0, 1
        )
        distances.append(np.linalg.norm(corners[:, k] + part[:, None] * side, axis=1))
    return np.min(distances, axis=0)


def depths(x, sphere, t=0.0):
    center = sphere.center_at(t)
    points = sphere.radius - np.linalg.norm(x - center, axis=-1).min()
    corners = x.reshape(-1, 3)[cs.triangles(x.shape[:2])]
    triangles = sphere.radius - distance(corners - center).min()
    return max(points, 0.0), max(triangles, 0.0)


@pytest.mark.parametrize("kind", ["wild", "sliver", "line", "point", "edge", "thin"])
def test_penetration_of_one_cell_of_any_kind(kind):
    """Two random triangles at a time: any region of each is nearest somewhere."""
    rng = np.random.default_rng(11)
    regions = set()
    for _ in range(400):
        x = rng.normal(size=(2, 2, 3))
        a = x[0, 0].copy()
        b = x[0, 1].copy()
        if kind == "sliver":
            x[1, 0] = a + 0.6 * (b - a) + 1e-9 * rng.normal(size=3)
        elif kind == "line":
            x[1, 0], x[1, 1] = a + 0.5 * (b - a), a + 2 * (b - a)
        elif kind == "point":
            x[:] = a
        elif kind == "edge":
            x[1, 0] = a
            x[1, 1] = b
        elif kind == "thin":
            x[1] = x[0] + 1e-4 * rng.normal(size=(2, 3))
        sphere = cs.Sphere(tuple(rng.normal(size=3)), 10.0)
        result = cs.penetration(x, sphere)
        points, triangles = depths(x, sphere)
        regions.add(points < triangles - 1e-9)
        np.testing.assert_allclose(result["points"], points, rtol=1e-14)
        bound = 1e-7 if kind == "sliver" else 1e-10
        np.testing.assert_allclose(result["triangles"], triangles, rtol=0, atol=bound)
    assert regions == ({False} if kind == "point" else {False, True})


def test_max_stable_dt_of_the_paper():
    """kappa = 12 with shear: damping decides, 2.785 m / (12 c); undamped sqrt(8 m / (12 K))."""
    scene = cs.scenes.paper_swing()
    np.testing.assert_allclose(cs.max_stable_dt(scene), 2.7852936 * 0.5 / 1200, rtol=1e-4)
    assert cs.max_stable_dt(scene) <= 2.7852936 * 0.5 / 1200
    free = scene.replace(cloth=scene.cloth.replace(damping=0.0))
    np.testing.assert_allclose(cs.max_stable_dt(free), np.sqrt(8 / (12 * 35_000 / 0.5)), rtol=1e-8)
