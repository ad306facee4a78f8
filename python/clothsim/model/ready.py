"""Ready scenes: the scenes of Kim et al., and two scenes with a solution in closed form.

The paper's scenes take its Table 2, which are the defaults of `Cloth`. The 3,906 springs are
structural and shear; section 2 of the paper also describes bend springs. The cloth starts flat and
level, pinned at the two ends of the side x = 0, and swings down about z (section 6).
"""

from __future__ import annotations

from collections.abc import Iterable

from ..base import check
from ..typing import Family, Numbers, Offset, Response, Shape
from .cloth import Cloth
from .motion import Reciprocate
from .obstacle import RESPONSES, Sphere
from .scene import Scene

PAPER_DT = 5e-6
"""Time step of Table 2 of Kim et al. [s]."""


@check.check_names
def paper_static(
    response: Response = "ray",
    bend: bool = False,
    offset: Offset | float = "edge",
    as_printed: bool = False,
) -> Scene:
    """Return the cloth that swings down on to a sphere at rest (Kim et al., section 6, Table 3).

    Parameters
    ----------
    response : {"ray", "reflect", "penalty"}, default "ray"
        "ray" is the paper's method 2, "reflect" its method 1. The restitution is 1 for each but
        "penalty", which has none.
    bend : bool, default False
        True adds the 1,920 bend springs.
    offset : {"edge", "cell", "none"} or float, default "edge"
        See `Sphere`.
    as_printed : bool, default False
        True takes the paper's collision response as printed; see `Sphere`.

    Examples
    --------
    >>> cs.scenes.paper_static("reflect", bend=True).cloth.spring_count()
    5826
    """
    sphere = _paper_sphere((0.5, -0.5, 0.5), None, response, offset, as_printed)
    return paper_swing(bend).replace(spheres=sphere)


@check.check_names
def paper_moving(
    response: Response = "ray",
    bend: bool = False,
    offset: Offset | float = "edge",
    as_printed: bool = False,
    *,
    period: float = 4.2,
    phase: float = 0.05,
    deceleration: float = 7.0,
) -> Scene:
    """Return the cloth that swings down on to a moving sphere (Kim et al., section 6, Table 4).

    The sphere of radius 0.25 m travels one metre along x about (0, -0.5, 0.5), the centre of the
    hanging cloth. The paper prints neither its period nor its start. Here it touches the cloth
    three times within five seconds, as the paper's frames 200, 1300 and 3100 show
    (docs/reproduction.md).

    Parameters
    ----------
    response, bend, offset, as_printed
        As for `paper_static`.
    period, phase, deceleration : float
        As for `Reciprocate`.

    Examples
    --------
    >>> sphere = cs.scenes.paper_moving(period=2.0, phase=0.0).spheres[0]
    >>> sphere.center_at([0.0, 1.0]).tolist()
    [[-0.5, -0.5, 0.5], [0.5, -0.5, 0.5]]
    """
    motion = Reciprocate((1.0, 0.0, 0.0), 1.0, period, deceleration, phase)
    sphere = _paper_sphere((0.0, -0.5, 0.5), motion, response, offset, as_printed)
    return paper_swing(bend).replace(spheres=sphere)


def _paper_sphere(
    center: Numbers,
    motion: Reciprocate | None,
    response: Response,
    offset: Offset | float,
    as_printed: bool,
) -> Sphere:
    check.choice("response", response, RESPONSES)
    restitution = None if response == "penalty" else 1.0
    return Sphere(
        center, 0.25, motion, response, offset, restitution=restitution, as_printed=as_printed
    )


@check.check_names
def paper_swing(bend: bool = False) -> Scene:
    """Return the paper's cloth that swings down without a sphere (Kim et al., Table 2).

    Parameters
    ----------
    bend : bool, default False
        As for `paper_static`.

    Examples
    --------
    >>> cs.scenes.paper_swing().spheres
    ()
    """
    return Scene(Cloth() if check.boolean("bend", bend) else Cloth(springs=("structural", "shear")))


@check.check_names
def hanging(
    shape: Shape = (16, 16),
    size: Numbers = (1.0, 1.0),
    mass: float = 2.56,
    stiffness: float = 1_000.0,
    drag: float = 0.6,
    springs: Iterable[Family] = ("structural",),
) -> Scene:
    """Return a cloth that hangs from its top row and settles under its own weight.

    Row 0 is pinned along y = 0. The other rows start straight below it, unstretched, in the plane z
    = 0. With structural springs only, every column is a chain, whose springs carry the weight of
    the points below them. With m the mass of a point, g gravity and D the rest length, it comes to
    rest at::

        y(row) = -row D - (m g / stiffness) row (2 rows - row - 1) / 2

    With the defaults the lowest row comes to rest 11.8 mm below its start, after about 0.5 s.

    Parameters
    ----------
    shape : (int, int), default (16, 16)
        Rows and columns; (16, 1) is a single chain.
    size : (float, float), default (1.0, 1.0)
        Height and width [m].
    mass : float, default 2.56
        Total mass [kg], 0.01 a point with the default shape.
    stiffness : float, default 1000.0
        Stiffness of each spring [N/m].
    drag : float, default 0.6
        Damping of each point's velocity [N s/m].
    springs : sequence of str, default ("structural",)
        Families present. The formula above holds only for structural springs alone.

    Examples
    --------
    >>> cs.scenes.hanging(shape=(5, 1)).initial_position[:, 0, 1].tolist()
    [0.0, -0.25, -0.5, -0.75, -1.0]
    """
    cloth = Cloth(shape, size, mass, stiffness, 0.0, drag, springs, pins=())
    cloth = cloth.replace(pins=[(0, column) for column in range(cloth.columns)])
    turned = cloth.rest_positions @ [[1, 0, 0], [0, 0, 1], [0, -1, 0]]  # by a quarter, about x
    return Scene(cloth, position=turned)


@check.check_names
def oscillator(
    stiffness: float = 100.0,
    mass: float = 1.0,
    amplitude: float = 0.1,
    length: float = 1.0,
    damping: float = 0.0,
) -> Scene:
    """Return two mass points and one spring along x: the harmonic oscillator, without gravity.

    Point (0, 0) is pinned at the origin; point (0, 1) is let go at x = length + amplitude and
    moves on the x axis. Undamped::

        x(t) = length + amplitude cos(w t),  w = sqrt(stiffness / mass)

    and with g = damping / (2 mass) < w::

        x(t) = length + amplitude exp(-g t) (cos(u t) + (g/u) sin(u t)),  u = sqrt(w^2 - g^2)

    Parameters
    ----------
    stiffness : float, default 100.0
        Stiffness of the spring [N/m].
    mass : float, default 1.0
        Mass of the moving point [kg]. The pinned point has an equal mass, which has no effect.
    amplitude : float, default 0.1
        Stretch at t = 0 [m], `|amplitude| < length`.
    length : float, default 1.0
        Rest length of the spring [m].
    damping : float, default 0.0
        Damping of the spring [N s/m].

    Examples
    --------
    >>> cs.scenes.oscillator(amplitude=0.25).initial_position[0, 1].tolist()
    [1.25, 0.0, 0.0]
    """
    mass = check.number("mass", mass, minimum=0, exclusive=True)
    length = check.number("length", length, minimum=0, exclusive=True)
    amplitude = check.number("amplitude", amplitude)
    if not abs(amplitude) < length:
        raise ValueError(f"amplitude must be smaller than length = {length:g}, got {amplitude!r}")
    cloth = Cloth(
        (1, 2),
        (length, length),
        2.0 * mass,
        stiffness,
        damping,
        springs=("structural",),
        pins=((0, 0),),
    )
    position = cloth.rest_positions.copy()
    position[0, 1, 0] += amplitude
    return Scene(cloth, gravity=(0.0, 0.0, 0.0), position=position)
