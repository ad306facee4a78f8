"""Measured fabrics as springs: a continuum's moduli on a grid of a given spacing.

A sheet of fabric stores the energy per area

    W = Y (e_x^2 + e_y^2) / 2 + G g^2 / 2 + B k^2 / 2

with the strains e along the two directions, the shear angle g and the curvature k. Y [N/m] is the
tensile modulus, G [N/m] the shear modulus and B [N m] the bending rigidity. A grid of springs has a
cell of sides a and b (columns and rows), so that, with d^2 = a^2 + b^2, it stores per area

    structural:  K_s (a/b e_x^2 + b/a e_y^2) / 2
    shear:       K_h ((a^2 e_x + b^2 e_y)^2 + a^2 b^2 g^2) / (a b d^2)
    bend:        2 K_b (a/b e_x^2 + b/a e_y^2)                              stretched
                 2 K_b (1 - cos(t/2))^2 (a/b or b/a)                        bent by t per spacing

The first two expand the lengths of a cell's springs to first order in the strains. The last is the
shortening of the chord over two spacings. Equal energies in shear, in bending by the angle t, and
in the mean of stretching along both directions give K_h, K_b and K_s. Two limits follow. First, a family has one
stiffness, so warp and weft share the mean of their moduli. Second, bend springs resist the bending of a flat sheet only
at fourth order of the curvature. At the angle t the springs have the energy of the fabric; at smaller angles they have
less.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..base import check
from .as_core import core_cloth
from .cloth import Cloth
from .scene import Scene


@dataclass(frozen=True)
class Fabric:
    """Measured properties of a fabric."""

    name: str
    area_density: float  # mass per area [kg/m^2]
    warp: float  # tensile moduli along the two directions [N/m]
    weft: float
    shear: float  # shear modulus [N/m]
    bending: float  # bending rigidity, the mean of warp and weft [N m]
    source: str  # publication of each figure


_WANG = (
    "Wang, O'Brien, Ramamoorthi: Data-driven elastic models for cloth: modeling and measurement, ACM "
    "Trans. Graph. 30(4) 71 (2011), material file {file} of its database. Area density: 'density'. "
    "Tensile and shear: first row of 'stretching' (c11, c12, c22, c33), which the simulator ARCSim of "
    "that group evaluates as W = c11 E11^2 + c22 E22^2 + c33 E12^2 in Green's strain E, so the moduli "
    "are 2 c11, 2 c22 and c33 / 2. Bending: first column of 'bending', mean of warp and weft."
)

FABRICS = {
    "cotton": Fabric(
        "rib knit, 95 % cotton, 5 % spandex",
        0.276,
        2 * 42.871021,
        2 * 65.166023,
        83.175644 / 2,
        (46.237591e-6 + 32.243889e-6) / 2,
        _WANG.format(file="ivory-rib-knit"),
    ),
    "denim": Fabric(
        "11 oz black denim, 99 % cotton, 1 % spandex",
        0.324,
        2 * 205.352005,
        2 * 1013.88629,
        53.387184 / 2,
        (64.196457e-6 + 96.951576e-6) / 2,
        _WANG.format(file="11oz-black-denim"),
    ),
}
"""The fabrics that `clothsim.model.ready` has, by name."""


def spring_stiffness(fabric: Fabric, spacing: tuple[float, float], fold: float) -> dict[str, float]:
    """Stiffness of each spring family [N/m]; see the module's text.

    `spacing` is the distance between rows and between columns [m], and `fold` the angle between neighbouring springs at
    which the bending energies are equal [rad].
    """
    b, a = spacing
    aspect = a / b + b / a
    shear = fabric.shear * (a * a + b * b) / (2 * a * b)
    bent = 2 * (1 - math.cos(fold / 2)) ** 2 * aspect / 2
    bend = fabric.bending / 2 * (fold * fold / (a * b)) * aspect / 2 / bent
    # Twice the mean over both directions of the moduli that shear and bend springs have already.
    others = 2 * shear * (a**3 / b + b**3 / a) / (a * a + b * b) + 4 * bend * aspect
    structural = (fabric.warp + fabric.weft - others) / aspect
    if structural <= 0:
        raise ValueError(
            f"shape and size must give a spacing on which the bending rigidity leaves the structural "
            f"springs a stiffness > 0, got rows {b:.3g} m and columns {a:.3g} m apart for "
            f"{fabric.name}"
        )
    return {"structural": structural, "shear": shear, "bend": bend}


def fabric_scene(
    fabric: Fabric,
    shape: tuple[int, int] = (32, 32),
    size: tuple[float, float] = (1.0, 1.0),
    damping_ratio: float = 0.1,
    fold: float = 1.0,
) -> Scene:
    """A sheet of a fabric, flat and level, pinned at the two ends of the side x = 0.

    The damping is in proportion to the stiffness, c = beta K, with beta = 2 z / omega. At the highest frequency omega
    of the grid the damping ratio is z, which is `damping_ratio`; at lower frequencies it is lower in proportion. This
    is a numerical choice, because the sources measure no damping.
    """
    damping_ratio = check.number("damping_ratio", damping_ratio, minimum=0)
    fold = check.number("fold", fold, minimum=1e-3, maximum=math.pi)
    blank = Cloth(shape, size)
    if min(blank.shape) < 3:
        raise ValueError(f"shape must have at least 3 rows and 3 columns, got {blank.shape}")
    mass = fabric.area_density * blank.size[0] * blank.size[1]
    stiffness = spring_stiffness(fabric, blank.spacing, fold)
    cloth = Cloth(blank.shape, blank.size, mass, stiffness, 0.0)
    square, _ = core_cloth(cloth).mode_bounds
    beta = 2 * damping_ratio / math.sqrt(square)
    return Scene(cloth.replace(damping={f: beta * k for f, k in stiffness.items()}))
