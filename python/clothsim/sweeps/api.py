"""`sweep`: many cloths from one call."""

from __future__ import annotations

import inspect
import os
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..base.keywords import suggests
from ..model.scene import Scene
from ..typing import Every, Integrator, Kernel, Precision
from .metrics import DEFAULT_METRICS, listing
from .session import run_sweep

if TYPE_CHECKING:
    import xarray


@suggests
def sweep(
    scene: Scene,
    over: Mapping[Any, Any] | Sequence[Mapping[str, Any]] | None = None,
    *,
    duration: float = 1.0,
    metrics: str | Callable[..., Any] | Sequence[Any] | Mapping[str, Any] = DEFAULT_METRICS,
    dt: float | None = None,
    integrator: Integrator | None = None,
    precision: Precision = "double",
    rtol: float | None = None,
    atol: float | None = None,
    every: Every | None = None,
    frames: bool = False,
    store: str | os.PathLike[str] | None = None,
    resume: bool = True,
    executor: Any = None,
    threads: int | None = None,
    progress: bool = True,
    kernel: Kernel = "auto",
    strict: bool = False,
    sampling: int = 32,
    task_seconds: float | None = None,
) -> xarray.Dataset:
    """Run a scene once for every combination of values, and label the results.

    A member's result has the same bits as `simulate` gives for it alone. One that diverges is
    marked and harms no other.

    Parameters
    ----------
    scene : Scene
        Values that are not swept.
    over : mapping, or sequence of mappings
        ``{name: values}`` is a grid: one dimension per name, every combination a member.
        ``{(name, name): [(value, value), ...]}`` are zipped lists, one dimension for both.
        ``{name: {label: value}}`` labels values that are no numbers. A sequence of mappings (or a
        table with ``to_dict("records")``) are given samples, with the dimension "sample".

        Names are the arguments of `Cloth` and `Scene`; those of `Sphere` with "sphere_" in front
        (of every sphere) or "sphere1_" (of the one with index 1); parts of them such as
        "stiffness_shear", "damping_bend", "gravity_y", "sphere_center_x"; "sphere_speed" [m/s] and
        the other arguments of a sphere's motion; "scene"; and "dt", "rtol", "atol", "duration",
        "integrator", "precision", "kernel" and "strict". `sweepable` lists them all.
    duration : float, default 1.0
        Simulated time [s], > 0.
    metrics : sequence, mapping, name or function
        {metrics}.
        docs/sweeps.md describes them. A function
        takes a `Run`, with the frames of `every`, and returns a number, an array, or a mapping of
        them. It must pickle to run in another process. Default: "stable", "energy_drift" and
        "largest_stretch".
    dt : float, optional
        Time step [s], where it is not swept. Default: half of `max_stable_dt`, of each member.
    integrator, precision, kernel, strict
        As for `step`, where they are not swept. The default of `integrator` is "rk4"; "auto", the
        default with `rtol` or `atol`, chooses as `simulate` does.
    rtol, atol : float, optional
        Error control in place of `dt`, as for `simulate`, where it is not swept. Where a tolerance is swept beside dt
        (zipped, or as samples), None marks the value that a member does without.
    every : int, float or "step", optional
        Frames, as for `simulate`; seconds if they are stored and dt is swept.
    frames : bool, default False
        True stores the frames too: position and velocity, shape (..., time, row, column, 3).
        Smaller cloths are filled up with NaN.
    store : path-like, optional
        Folder of a zarr store. Results are written to it as they come. If a sweep is interrupted, repeat the call: it
        computes the missing members.
    resume : bool, default True
        False refuses a store that exists.
    executor : concurrent.futures.Executor or dask.distributed.Client, optional
        Executor that runs the members. Default: threads of this process.
    threads : int, optional
        Threads of this process; default: one per processor. With an executor: threads of each task; default: 1.
    progress : bool, default True
        Show a bar with members done, their rate and the time left, in a terminal or notebook.
    sampling : int, default 32
        Least number of states at which stretches and depths of triangles are sampled, as in `simulate`.
    task_seconds : float, optional
        Length of a task [s], >= 0.3, where there is enough work. Default: 1.0. Longer tasks reduce the scheduler's work
        on a large cluster. If a worker dies, its present task is lost.

    Returns
    -------
    xarray.Dataset
        One dimension per swept name, with coordinates that have units. Beside the metrics: "status" (0 pending, 1 done,
        2 unstable, 3 failed), "max_stable_dt" [s], "unstable_step", "unstable_time" [s] and "message". Of a member that
        diverged or failed, metrics are NaN ("stable" False). After a contact "error" is NaN too, and the message says
        why. ``ds.clothsim.provenance`` has the provenance of the results. Frames in a `store` are read when they are
        used.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above, a member cannot be made, or the store is of another sweep.
        The message names the difference. Nothing has been run or written then.
    ImportError
        Without xarray, zarr (for `store`) or tqdm (for `progress`): the extra "sweep".
    KeyboardInterrupt
        On Ctrl-C; the store then has all finished members.

    Examples
    --------
    >>> import clothsim as cs
    >>> scene = cs.scenes.hanging(shape=(4, 4))
    >>> result = cs.sweep(scene, {"stiffness": [1e3, 1e5], "dt": [1e-3, 1e-1]}, duration=0.2,
    ...                   progress=False)
    >>> result.stable.values.tolist()
    [[True, False], [True, False]]
    >>> result.stiffness.attrs["units"], result.sizes["dt"]
    ('N/m', 2)
    """
    return run_sweep(
        scene,
        over,
        defaults={name: one.default for name, one in inspect.signature(sweep).parameters.items()},
        duration=duration,
        metrics=metrics,
        dt=dt,
        integrator=integrator,
        precision=precision,
        rtol=rtol,
        atol=atol,
        every=every,
        frames=frames,
        store=store,
        resume=resume,
        executor=executor,
        threads=threads,
        progress=progress,
        kernel=kernel,
        strict=strict,
        sampling=sampling,
        task_seconds=task_seconds,
    )


_INDENT = " " * 8
_LISTED = textwrap.fill(f"Names: {listing()}.", 96, initial_indent=_INDENT, subsequent_indent=_INDENT)
sweep.__doc__ = (sweep.__doc__ or "").replace(f"{_INDENT}{{metrics}}.", _LISTED)
