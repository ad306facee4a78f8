"""Error against cost of methods over their settings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..base import check
from ..base.extras import needed
from ..base.progress import ProgressBar
from ..model.scene import Scene
from ..typing import Precision
from .measured import Bench, Measured, dataset
from .methods import Method, chosen_methods
from .order import solution_for
from .solution import Reference

if TYPE_CHECKING:
    import xarray


def work_precision(
    scene: Scene,
    duration: float,
    methods: Sequence[str | Method] | None = None,
    *,
    precisions: Sequence[Precision] = ("double",),
    dts: Sequence[float] | None = None,
    rtols: Sequence[float] | None = None,
    threads: int | None = None,
    windows: int = 5,
    longest: float = 10.0,
    reference: Reference | None = None,
    progress: bool = False,
) -> xarray.Dataset:
    """Error against cost of methods over their steps or tolerances.

    Errors are distances from the trusted solution at the end. The time is that of the steps alone,
    and the least of several runs. The methods take turns, in another order each round, so a slow
    spell of the machine affects all of them.

    Parameters
    ----------
    scene : Scene
        Without contact up to `duration`.
    duration : float
        Simulated time [s], > 0.
    methods : sequence, optional
        Names of `clothsim.integrators`, run at fixed steps; "NAME adaptive", run at tolerances;
        or objects of the protocol `clothsim.accuracy.Method`. Default: "semi_implicit_euler", "velocity_verlet", "rk4",
        "dopri5 adaptive" and "dop853 adaptive".
    precisions : sequence of {"double", "single"}, default ("double",)
        Precisions of the methods that are given by name.
    dts : sequence of float, optional
        Time steps [s] of fixed-step methods. Default: seven steps. The first is 0.95 of the guaranteed stable step (8
        times that of RK4 for an implicit method). Each next step is half as long.
    rtols : sequence of float, optional
        Tolerances of adaptive methods, over the cloth's longer side. `simulate` takes them for the
        error at the end; the cost leaves out its error estimate.
        Default: 1e-3, 1e-4, ..., 1e-13.
    threads : int, optional
        Threads of every method. Default: as in `simulate`.
    windows : int, default 5
        Timed runs of each method and setting.
    longest : float, default 10.0
        Once a run takes longer than this [s], the finer settings of its method are left out.
    reference : Reference, optional
        Default: `reference(scene, duration)`.
    progress : bool, default False
        True shows a progress bar in a terminal or notebook (tqdm, in the extra "demo").

    Returns
    -------
    xarray.Dataset
        Dimensions "solver" and "level" (the number of the setting, the coarsest first).
        Coordinates of "solver": its label, "integrator", "precision", "library", "threads" (0: the
        library's choice) and "control" ("dt" or "rtol"). Variables, NaN where a solver has no
        such level: "setting" (dt [s] or rtol), "rms_error" and "max_error" [m], infinite where
        unstable; "force_evaluations"; "wall_time" per simulated second [s/s]; "energy_drift" [J],
        the total energy at the end less that of the reference, which is the change of energy
        itself where nothing is damped; "pareto", True where no run of clothsim, and "pareto_all",
        where none at all, is both faster and more accurate. The attributes tell scene, duration,
        reference error, machine and version.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.
    ImportError
        Without xarray, naming the extra that brings it.

    Examples
    --------
    >>> import clothsim as cs
    >>> scene = cs.scenes.oscillator(damping=1.0)
    >>> data = cs.work_precision(scene, 0.5, ["rk4"], dts=[0.02, 0.01])
    >>> data.sizes["level"], bool(data.rms_error[0, 1] < data.rms_error[0, 0] / 10)
    (2, True)
    """
    xarray = needed("xarray", "work_precision")
    duration = check.number("duration", duration, minimum=0, exclusive=True)
    windows = check.integer("windows", windows, minimum=1)
    longest = check.number("longest", longest, minimum=0, exclusive=True)
    chosen = chosen_methods(scene, methods, precisions, threads)
    levels = [_settings(one, scene, duration, dts, rtols) for one in chosen]
    jobs = [(m, n) for m, settings in enumerate(levels) for n in range(len(settings))]
    results: dict[tuple[int, int], Measured] = {}
    with ProgressBar(progress, total=len(jobs) * (1 + windows), unit="run") as bar:
        bar.say("reference")
        bench = Bench(scene, solution_for(scene, duration, reference))
        bar.say("methods")
        for m, n in jobs:
            if n and ((m, n - 1) not in results or results[m, n - 1].once > longest):
                bar.advance(1 + windows)
                continue
            results[m, n] = bench.first(chosen[m], levels[m][n])
            bar.advance(1 if results[m, n].stable else 1 + windows)
        for _ in bench.time(list(results.values()), windows):
            bar.advance(1)
    return dataset(xarray, bench, chosen, results)


def _settings(
    method: Method, scene: Scene, duration: float, dts: Sequence[float] | None, rtols: Sequence[float] | None
) -> list[float]:
    name, given = ("dts", dts) if method.control == "dt" else ("rtols", rtols)
    if given is None:
        return method.settings(scene, duration)
    given = check.items(name, given, None, "numbers > 0", 1)
    values = {check.number(f"{name}[{k}]", value, minimum=0, exclusive=True) for k, value in enumerate(given)}
    return sorted(values, reverse=True)
