"""Predicted and measured stability over stiffness and time step."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .. import _core
from ..base import Floats, check
from ..base.build import available_threads
from ..base.extras import check_installed, needed
from ..base.progress import ProgressBar
from ..engine.options import Options
from ..engine.stepper import SilentStepper
from ..errors import UnstableError
from ..measure.measures import energy
from ..model.scene import Scene
from ..typing import Integrator, Precision
from .limit import max_stable_dt
from .spectrum import spectral_limit

if TYPE_CHECKING:
    import xarray


STEPS = 1000
_CHECKED = 10  # steps; what has grown may find a folded shape, in which it is stable, and die away
_DISTURBANCE = 1e-6  # of the shortest distance of neighbours, per time step
_GROWTH = 1e3  # of the disturbance, that counts as unstable
_ENERGY_ERROR = 0.01  # of kinetic and elastic energy, that an honest run may be off


def is_stable(scene: Scene, x: Floats, v: Floats, dt: float, steps: int = STEPS, **options: Any) -> bool:
    """Whether the total energy does not rise in `steps` steps of `dt` from a disturbed (x, v), measured by a real run.

    Physics adds no energy to a cloth without moving spheres. If the energy of a run rises, the time step has made it. The
    free points get random velocities, which contain every mode and are far too slow to matter for the motion. Above the
    limit some modes grow by a part of themselves each step. Spheres are left out, because they can do work on the cloth.
    `options` are options of `Stepper`.
    """
    cloth = scene.cloth
    scene = scene.replace(spheres=())
    spacing = min(h for h in cloth.spacing if h > 0)
    speed = _DISTURBANCE * spacing / dt
    noise = speed * np.random.default_rng(0).normal(size=x.shape) * ~cloth.pinned[..., None]
    size = (cloth.mass_per_point[..., None] * noise**2).sum() / 2
    start = energy(scene, x, v + noise)
    stepper = SilentStepper(scene, x, v + noise, **{"threads": 1, **options})
    stepper._state.judge.warned_of_dt = True
    for done in range(0, steps, _CHECKED):
        try:
            stepper.advance(min(_CHECKED, steps - done), dt)
        except UnstableError:
            return False
        now = energy(scene, stepper.positions, stepper.velocities)
        allowed = _GROWTH**2 * size + _ENERGY_ERROR * (now["kinetic"] + now["elastic"])
        if not now["total"] - start["total"] <= allowed:
            return False
    return True


@dataclass(frozen=True)
class StabilityMap:
    """Result of `stability_map`, in plain arrays.

    Attributes
    ----------
    stiffness, dt : numpy.ndarray
        Stiffnesses [N/m], shape (K,), and time steps [s], shape (D,).
    stable : numpy.ndarray
        Measured, shape (K, D).
    limit, guarantee : numpy.ndarray
        Per stiffness [s], shape (K,): the limit predicted from the spectrum at the scene's initial state, and the
        guarantee of `max_stable_dt`.
    integrator, precision : str
    steps : int
        Steps of each measured run.
    """

    stiffness: Floats
    dt: Floats
    stable: npt.NDArray[np.bool_]
    limit: Floats
    guarantee: Floats
    integrator: str
    precision: Precision
    steps: int

    @property
    def predicted(self) -> npt.NDArray[np.bool_]:
        """Whether dt is within the predicted limit, shape (K, D)."""
        return self.dt <= self.limit[:, None]

    @classmethod
    def from_xarray(cls, data: xarray.Dataset) -> StabilityMap:
        """The map that `to_xarray` turned into `data`."""
        names = (one.name for one in fields(cls))
        values: dict[str, Any] = {name: data[name].values if name in data else data.attrs[name] for name in names}
        return cls(**values)

    def to_xarray(self) -> xarray.Dataset:
        """See `clothsim.stability_map`.

        Raises
        ------
        ImportError
            Without xarray, naming the extra that brings it.
        """
        xr = needed("xarray", "stability_map")
        both = ("stiffness", "dt")
        dataset: xarray.Dataset = xr.Dataset(
            {
                "stable": (both, self.stable),
                "predicted": (both, self.predicted),
                "limit": ("stiffness", self.limit, {"units": "s"}),
                "guarantee": ("stiffness", self.guarantee, {"units": "s"}),
            },
            {"stiffness": ("stiffness", self.stiffness, {"units": "N/m"}), "dt": ("dt", self.dt, {"units": "s"})},
            {"integrator": self.integrator, "precision": self.precision, "steps": self.steps},
        )
        return dataset


def measure_map(
    scene: Scene,
    stiffness: npt.ArrayLike,
    dt: npt.ArrayLike,
    integrator: Integrator = "rk4",
    precision: Precision = "double",
    steps: int = STEPS,
    threads: int | None = None,
    progress: bool = False,
) -> StabilityMap:
    """`clothsim.stability_map` in plain arrays, without xarray."""
    check.instance("scene", scene, Scene)
    integrator = Options(integrator, precision).integrator
    stiffness, dt = _positive("stiffness", stiffness), _positive("dt", dt)
    steps = check.integer("steps", steps, minimum=1)
    if threads is None:
        threads = available_threads()
    threads = check.integer("threads", threads, minimum=1, maximum=_core.most_threads)
    scenes = [scene.replace(cloth=scene.cloth.replace(stiffness=float(k)), spheres=()) for k in stiffness]
    x, v = scene.initial_position, scene.initial_velocity

    def cell(place: tuple[int, int]) -> bool:
        return is_stable(scenes[place[0]], x, v, dt[place[1]], steps, integrator=integrator, precision=precision)

    places = [(i, j) for i in range(len(stiffness)) for j in range(len(dt))]
    stable = []
    with ProgressBar(progress, total=len(places), unit="run") as bar, ThreadPoolExecutor(threads) as pool:
        for one in pool.map(cell, places):
            stable.append(one)
            bar.advance()
    return StabilityMap(
        stiffness,
        dt,
        np.array(stable).reshape(len(stiffness), len(dt)),
        np.array([spectral_limit(integrator, one, x, v) for one in scenes]),
        np.array([max_stable_dt(one, integrator) for one in scenes]),
        integrator,
        precision,
        steps,
    )


def stability_map(
    scene: Scene,
    stiffness: npt.ArrayLike,
    dt: npt.ArrayLike,
    integrator: Integrator = "rk4",
    precision: Precision = "double",
    steps: int = STEPS,
    threads: int | None = None,
    progress: bool = False,
) -> xarray.Dataset:
    """Which time steps are stable at which stiffness: predicted, guaranteed, and measured.

    Every cell is a run of `steps` steps from the scene's initial state, slightly disturbed. A cell is stable unless its
    total energy rises (`clothsim.stability.map`). Spheres are left out, so only the time step can raise the energy.
    The prediction comes from the forces linearised at the initial state. A cloth that moves far may have a lower limit.

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
        Steps of each run, >= 1. Just above the limit, growth becomes visible only after hundreds of steps.
    threads : int, optional
        Number of simultaneous runs. Default: one per processor.
    progress : bool, default False
        True shows a progress bar in a terminal or notebook (tqdm, in the extra "demo").

    Returns
    -------
    xarray.Dataset
        With the dimensions "stiffness" and "dt": "stable" (measured) and "predicted"; with
        "stiffness" alone the predicted "limit" and the "guarantee" [s].
        ``clothsim.stability.measure_map`` gives these results as plain arrays.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.
    ImportError
        Without xarray, which is in the extra "sweep".

    Examples
    --------
    >>> import clothsim as cs
    >>> from clothsim.stability import measure_map
    >>> scene = cs.scenes.oscillator()
    >>> found = measure_map(scene, [100.0, 10_000.0], [0.02, 0.2, 0.3])
    >>> found.stable.astype(int).tolist()
    [[1, 1, 0], [1, 0, 0]]
    >>> found.limit.round(4).tolist()
    [0.2828, 0.0283]
    """
    check_installed("xarray", "stability_map")  # before the runs, not after them
    return measure_map(scene, stiffness, dt, integrator, precision, steps, threads, progress).to_xarray()


def _positive(name: str, value: npt.ArrayLike) -> Floats:
    accepted = "a one-dimensional array of finite numbers > 0"
    given = check.as_array(name, value, accepted)
    if given.ndim != 1 or not given.size:
        raise ValueError(f"{name} must be {accepted}, got shape {given.shape}")
    result = given.astype(np.float64)
    check.check_all(name, result, np.isfinite(result) & (result > 0), accepted)
    return result
