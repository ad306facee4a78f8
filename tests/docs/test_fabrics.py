"""The springs that docs/runs.md gives a fabric have its moduli at any resolution."""

import re
from pathlib import Path

import clothsim as cs
import numpy as np
import pytest
from tables import each

PAGE = (Path(__file__).parents[2] / "docs" / "runs.md").read_text(encoding="utf8")
TENSILE, SHEAR, STRAIN = 261.0, 105.0, 1e-6  # N/m; small, so that rotations do not count


def sheet(points):
    """Return the page's fabric without damping or pins."""
    section = PAGE.partition("## Real fabrics")[2]
    names = {"cs": cs}
    exec(re.search(r"```python\n(.*?)```", section, re.DOTALL)[1], names)  # of this repository
    assert names["cotton"].mass == 0.15
    cloth = names["fabric"](0.15, TENSILE, SHEAR, 0.0, points)
    return cs.Scene(cloth.replace(pins=()), gravity=(0.0, 0.0, 0.0))


def edge_force(scene, deformation):
    """Return the force that the last column's edge has to bear, of a square metre [N]."""
    x = scene.cloth.rest_positions @ (np.eye(3) + deformation).T
    force = scene.cloth.mass_per_point[..., None] * cs.acceleration(scene, x, np.zeros_like(x))
    return -force[:, -1].sum(axis=0)


@each("points", [3, 32, 100])
def test_a_stretched_and_a_sheared_fabric_have_the_stated_moduli(points):
    scene = sheet(points)
    stretch_force = edge_force(scene, STRAIN * np.outer([1, 0, 0], [1, 0, 0])) / STRAIN
    assert stretch_force[0] == pytest.approx(TENSILE + (TENSILE - SHEAR) / (points - 1), rel=1e-5)
    shear_force = edge_force(scene, STRAIN * np.outer([0, 0, 1], [1, 0, 0])) / STRAIN
    assert shear_force[2] == pytest.approx(SHEAR, rel=1e-5)


def test_readme_begins_with_the_cotton_of_the_page():
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf8")
    springs = dict(sheet(32).cloth.family_stiffness)
    assert (
        f'cotton = {{"structural": {springs["structural"]}, "shear": {springs["shear"]}}}' in readme
    )
