"""Measured fabrics as springs: energies against the continuum's, which needs no spring formula."""

import clothsim as cs
import numpy as np
import pytest
from clothsim.model.fabrics import FABRICS, spring_stiffness


def energy_per_area(name, spacing, deform, families, **options):
    """Elastic energy per area of an endless sheet [J/m^2].

    Of n x n cells it is e n^2 + (edges) n + (corners), so the second difference in n is 2 e.
    """
    fabric = FABRICS[name]
    stiffness = spring_stiffness(fabric, spacing, options.get("fold", 1.0))
    total = []
    for cells in (6, 8, 10):
        shape = (cells + 1, cells + 1)
        size = (cells * spacing[0], cells * spacing[1])
        cloth = cs.Cloth(shape, size, stiffness=stiffness, damping=0.0, pins=())
        x = deform(cloth.rest_positions)
        total.append(cs.energy(cs.Scene(cloth), x, 0 * x)["elastic"])
    return (total[2] - 2 * total[1] + total[0]) / (2 * 2**2) / (spacing[0] * spacing[1])


@pytest.mark.parametrize("spacing", [(0.02, 0.02), (0.02, 0.03)])
@pytest.mark.parametrize("name", FABRICS)
def test_uniform_strain_stores_the_energy_of_the_continuum(name, spacing):
    fabric, e = FABRICS[name], 1e-5
    stretched = [energy_per_area(name, spacing, lambda x, k=k: x * (1 + e * np.eye(3)[k]), None) for k in (0, 2)]
    assert sum(stretched) == pytest.approx((fabric.warp + fabric.weft) * e**2 / 2, rel=1e-3)

    def sheared(x):
        x = x.copy()
        x[..., 0] += e * x[..., 2]
        return x

    assert energy_per_area(name, spacing, sheared, None) == pytest.approx(fabric.shear * e**2 / 2, rel=1e-3)


@pytest.mark.parametrize("fold", [0.5, 1.0])
@pytest.mark.parametrize("name", FABRICS)
def test_bending_by_the_angle_stores_the_energy_of_the_continuum(name, fold):
    h = 0.02
    # Chords of a circle that are h long: `fold` is the angle between neighbouring springs.
    radius = h / (2 * np.sin(fold / 2))

    def rolled(x):
        angle = x[..., 0] / h * fold
        return np.stack([radius * np.sin(angle), radius * np.cos(angle), x[..., 2]], -1)

    found = energy_per_area(name, (h, h), rolled, ("bend",), fold=fold)
    assert found == pytest.approx(FABRICS[name].bending * (fold / h) ** 2 / 2, rel=1e-6)


@pytest.mark.parametrize("make", [cs.scenes.cotton, cs.scenes.denim])
def test_the_damping_ratio_is_that_of_the_fastest_waves(make):
    cloth = make((9, 9), (0.3, 0.3), damping_ratio=0.2).cloth
    name = make.__name__
    assert cloth.mass == pytest.approx(FABRICS[name].area_density * 0.09)
    ratios = {f: cloth.family_damping[f] / cloth.family_stiffness[f] for f in cloth.families}
    beta = ratios["structural"]
    assert all(r == pytest.approx(beta) for r in ratios.values())
    # At rest the fastest wave of velocity Verlet's limit 2 / omega, without damping.
    fastest = 2 / cs.max_stable_dt(cs.Scene(cloth.replace(damping=0.0)), "velocity_verlet")
    assert beta * fastest / 2 == pytest.approx(0.2, rel=1e-3)


def test_a_hanging_strip_of_denim_is_as_long_as_its_weight_makes_it():
    """rho g L^2 / (2 Y) longer, with Y of the springs along it; relaxed by damping each point."""
    scene = cs.scenes.denim((17, 3), (0.4, 0.05), damping_ratio=0.0)
    pins = np.zeros((17, 3), bool)
    pins[0] = True
    position = scene.cloth.rest_positions[..., [0, 2, 1]] * [1, -1, 1]
    cloth = scene.cloth.replace(damping=0.0, drag=0.02, pins=pins)
    scene = cs.Scene(cloth, position=position)
    stepper = cs.Stepper(scene)
    stepper.advance(60_000, 0.5 * cs.max_stable_dt(scene))
    fabric, length = FABRICS["denim"], 0.4
    shorter = length + stepper.positions[-1, :, 1].mean()
    modulus = (fabric.warp + fabric.weft) / 2
    expected = fabric.area_density * 9.80665 * length**2 / (2 * modulus)
    # Three columns of springs stand for two cells of width, so the strip is 1.5 times as stiff.
    assert -shorter == pytest.approx(expected / 1.5, rel=0.05)


@pytest.mark.parametrize("bad", [{"damping_ratio": -1.0}, {"fold": 0.0}, {"shape": (2, 9)}])
def test_bad_arguments_are_named(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        cs.scenes.denim(**bad)


def test_sources_name_a_publication():
    for fabric in FABRICS.values():
        assert "ACM Trans. Graph. 30(4) 71 (2011)" in fabric.source
