"""Predicted and measured stability over stiffness and time step."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..base import Floats, check
from ..base.build import available_thread_count
from ..base.extras import import_from_extra
from ..base.progress import ProgressBar
from ..engine.judge import TIME_STEP
from ..engine.options import Options
from ..engine.state import State
from ..errors import UnstableError
from ..measure import energy
from ..methods.integrators import check_integrator_name
from ..model.scene import Scene
from ..typing import Integrator, Precision
from .limit import max_stable_dt, spectral_limit

if TYPE_CHECKING:
    import xarray


# Steps between two looks. A disturbance that has grown may reach a folded shape, in which it is
# stable, and die away.
_LOOK = 10
_DISTURBANCE = 1e-6  # of the shortest distance of neighbours, per time step
_GROWTH = 1e3  # of the disturbance, that counts as unstable
_ENERGY_ERROR = 0.01  # of kinetic and elastic energy, that an honest run may be off


def is_stable(scene: Scene, x: Floats, v: Floats, dt: float, steps: int, **options: Any) -> bool:
    """Tell whether a run of `steps` steps of `dt` from a slightly disturbed (x, v) gains no energy.

    The equations of motion add no energy to a cloth without moving spheres, so a rise comes from
    the time step. The free points get random velocities, which contain every mode and are far too
    slow to matter for the motion. Above the limit some modes grow exponentially. Spheres are left
    out, because they can do work on the cloth. `options` are `Options`.
    """
    cloth = scene.cloth
    scene = scene.replace(spheres=())
    spacing = min(h for h in cloth.spacing if h > 0)
    speed = _DISTURBANCE * spacing / dt
    noise = speed * np.random.default_rng(0).normal(size=x.shape) * ~cloth.pinned[..., None]
    size = (cloth.mass_per_point[..., None] * noise**2).sum() / 2
    start = energy(scene, x, v + noise)
    settings = Options(**{"threads": 1, **options})
    state = State.from_arguments(scene, x, v + noise, None, settings, quiet=TIME_STEP)
    for begin in range(0, steps, _LOOK):
        try:
            state.advance(min(_LOOK, steps - begin), dt)
        except UnstableError:
            return False
        energies = energy(scene, *state.positions_and_velocities())
        allowed = _GROWTH**2 * size + _ENERGY_ERROR * (energies["kinetic"] + energies["elastic"])
        if not energies["total"] - start["total"] <= allowed:
            return False
    return True


@check.check_names
def stability_map(
    scene: Scene,
    stiffness: npt.ArrayLike,
    dt: npt.ArrayLike,
    integrator: Integrator = "rk4",
    precision: Precision = "double",
    steps: int = 1000,
    threads: int | None = None,
    progress: bool = False,
) -> xarray.Dataset:
    """Map which time steps are stable at which stiffness: predicted, guaranteed, and measured.

    Every cell is a run of `steps` steps from the scene's initial state, slightly disturbed. A cell
    is stable unless its total energy rises. Spheres are left out, so only the time step can raise
    the energy. The prediction comes from the forces linearised at the initial state. A cloth that
    moves far may have a lower limit.

    Parameters
    ----------
    scene : Scene
        The scene of every cell. All spring families take the stiffness of the cell.
    stiffness : array_like
        Stiffnesses K [N/m], > 0, one-dimensional.
    dt : array_like
        Time steps [s], > 0, one-dimensional.
    integrator, precision
        As for `step`.
    steps : int, default 1000
        Steps of each run, >= 1. Just above the limit, growth becomes visible only after hundreds of
        steps.
    threads : int, optional
        Number of simultaneous runs. Default: one per processor.
    progress : bool, default False
        Show a progress bar (tqdm, in the extra "demo").

    Returns
    -------
    xarray.Dataset
        With the dimensions "stiffness" and "dt": "stable" (measured) and "predicted"; with
        "stiffness" alone the predicted "limit" and the "guarantee" [s].

    Examples
    --------
    >>> scene = cs.scenes.oscillator()
    >>> found = cs.stability_map(scene, [100.0, 10_000.0], [0.02, 0.2, 0.3])
    >>> found.stable.values.astype(int).tolist()
    [[1, 1, 0], [1, 0, 0]]
    >>> found.limit.values.round(4).tolist()
    [0.2828, 0.0283]
    """
    xr: Any = import_from_extra("xarray", "stability_map")
    check.instance("scene", scene, Scene)
    integrator = check_integrator_name(Options(integrator, precision).integrator, fixed=True)
    stiffness = _check_positive_values("stiffness", stiffness)
    dt = _check_positive_values("dt", dt)
    steps = check.integer("steps", steps, minimum=1)
    threads = Options(threads=threads).threads or available_thread_count()
    scenes = [
        scene.replace(cloth=scene.cloth.replace(stiffness=float(k)), spheres=()) for k in stiffness
    ]
    x = scene.initial_position
    v = scene.initial_velocity

    def cell_is_stable(place: tuple[int, int]) -> bool:
        return is_stable(
            scenes[place[0]], x, v, dt[place[1]], steps, integrator=integrator, precision=precision
        )

    stable = np.empty((len(stiffness), len(dt)), dtype=bool)
    with (
        ProgressBar(progress, total=stable.size, unit="run") as bar,
        ThreadPoolExecutor(threads) as pool,
    ):
        places = list(np.ndindex(stable.shape))
        for place, result in zip(places, pool.map(cell_is_stable, places)):
            stable[place] = result
            bar.advance()
    limit = np.array([spectral_limit(integrator, member, x, v) for member in scenes])
    guarantee = [max_stable_dt(member, integrator) for member in scenes]
    dimensions = ("stiffness", "dt")
    seconds = {"units": "s"}
    dataset: xarray.Dataset = xr.Dataset(
        {
            "stable": (dimensions, stable),
            "predicted": (dimensions, dt <= limit[:, None]),
            "limit": ("stiffness", limit, seconds),
            "guarantee": ("stiffness", guarantee, seconds),
        },
        {"stiffness": ("stiffness", stiffness, {"units": "N/m"}), "dt": ("dt", dt, seconds)},
        {"integrator": integrator, "precision": precision, "steps": steps},
    )
    return dataset


def _check_positive_values(name: str, value: npt.ArrayLike) -> Floats:
    accepted = "a one-dimensional array of finite numbers > 0"
    numbers = check.array(name, value, kind=accepted)
    if numbers.ndim != 1 or not numbers.size:
        raise ValueError(f"{name} must be {accepted}, got shape {numbers.shape}")
    check.check_all(name, numbers, numbers > 0, accepted)
    return numbers
