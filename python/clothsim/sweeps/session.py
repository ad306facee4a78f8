"""A sweep from checked arguments to a labelled dataset; `api` documents the arguments."""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import check
from ..base.extras import check_installed, needed
from ..machine.build import build_config
from ..machine.origin import provenance
from ..methods.integration import integrator_name, warn_of_order
from ..model.scene import Scene
from ..run.frames import checked_every
from .bar import Bar
from .dataset import open_sweep, to_dataset
from .fields import RUN
from .grid import Grid, make_grid
from .member import Members, Settings
from .metrics import choose_metrics, describe
from .plain import plain
from .planning import SHORTEST, Planner
from .results import Results
from .store import SCHEMA, Store
from .task import TaskResult
from .workers import Workers, run_all

if TYPE_CHECKING:
    import xarray

_CHECKED = 2048  # members that are made before anything is run, to find what cannot be


def run_sweep(
    scene: Scene,
    over: Mapping[Any, Any] | Sequence[Mapping[str, Any]] | None,
    *,
    defaults: Mapping[str, Any],
    store: str | os.PathLike[str] | None,
    resume: bool,
    executor: Any,
    threads: int | None,
    progress: bool,
    task_seconds: float | None,
    **settings_given: Any,
) -> xarray.Dataset:
    """Run a sweep with the arguments of `sweep`; `settings_given` are fields of `Settings`, `defaults` those of `sweep`."""
    _check_packages(store, progress)
    if not isinstance(scene, Scene):
        raise TypeError(f"scene must be a Scene, got {check.shown(scene)}")
    grid = make_grid(over)
    settings = _checked_settings(**settings_given)
    _check_frames(grid, settings)
    _check_twice(grid, settings, defaults)
    members = _checked_members(scene, grid, settings)
    if task_seconds is not None:
        task_seconds = check.number("task_seconds", task_seconds, minimum=SHORTEST)
    workers = Workers(executor, threads)
    try:
        identity = _identity(scene, grid, settings)
        session = _provenance()
        results: Results
        if store is None:
            results = Results(grid, settings, scene)
        else:
            where = check.path("store", store)
            results = Store(where, grid, settings, scene, identity, session, check.boolean("resume", resume))
        _run(workers, members, results, session, progress, task_seconds)
    finally:
        workers.close()
    _warn_of_failures(results)
    if store is not None and settings.frames:
        return open_sweep(store)
    sessions = results.attrs["sessions"] if isinstance(results, Store) else [session]
    return to_dataset(results, {"schema": SCHEMA, "identity": identity, "sessions": sessions})


def _check_packages(store: Any, progress: Any) -> None:
    """Import the packages that are needed at the end, so that an ImportError comes before the runs."""
    needed("xarray", "sweep")
    if store is not None:
        needed("zarr", "store=...")
    if check.boolean("progress", progress):
        check_installed("tqdm", "progress=True")


def _checked_settings(
    *,
    duration: Any,
    dt: Any,
    integrator: Any,
    strict: Any,
    every: Any,
    frames: Any,
    sampling: Any,
    metrics: Any,
    **others: Any,
) -> Settings:
    return Settings(
        duration=check.number("duration", duration, minimum=0, exclusive=True),
        dt=None if dt is None else check.number("dt", dt, minimum=0, exclusive=True),
        integrator=None if integrator is None else integrator_name(integrator, "auto"),
        strict=check.boolean("strict", strict),
        every=checked_every(every),
        frames=check.boolean("frames", frames),
        sampling=check.integer("sampling", sampling, minimum=1),
        metrics=choose_metrics(metrics),
        **others,
    )


def _run(
    workers: Workers, members: Members, results: Results, session: dict[str, Any], progress: bool, task_seconds: float | None
) -> None:
    start = time.perf_counter()
    pending = results.pending
    grid = results.grid
    planner = Planner(members, pending, workers.count, task_seconds, workers.shortest_task)
    planner.threads = workers.threads_of(planner.expected_tasks)
    weights = planner.weights
    bar = Bar(progress, grid.size, grid.size - len(pending), float(weights[pending].sum()))

    def record(result: TaskResult) -> None:
        for one in result.records:
            results.record(one)
        session["wall_time"] = time.perf_counter() - start
        session["tasks"] += 1
        session["task_seconds"] += result.seconds
        for name in ("host", "instruction_set"):
            known = session[f"{name}s"]
            if getattr(result, name) not in known:
                known.append(getattr(result, name))
        results.flush()
        unstable = sum(one.unstable_step >= 0 for one in result.records)
        cost = float(weights[[one.index for one in result.records]].sum())
        bar.advance(len(result.records), unstable, cost)

    try:
        run_all(workers, planner, record, results.prepare)
    finally:
        session["wall_time"] = time.perf_counter() - start
        bar.close()
        try:
            results.flush(final=True)
        finally:
            results.close()


def _check_twice(grid: Grid, settings: Settings, defaults: Mapping[str, Any]) -> None:
    """Refuse an argument that the values of the sweep would replace."""
    for axis in grid.axes:
        for name in axis.names:
            if name in RUN and (given := getattr(settings, name)) != defaults[name]:
                raise ValueError(
                    f"{name} must be left out where over has it, got {name} = {given!r} beside its swept values"
                )


def _check_frames(grid: Grid, settings: Settings) -> None:
    """Check that stored frames have one time axis for all members."""
    if not settings.frames:
        return
    if "duration" in grid.names:
        raise ValueError("frames must be False where duration is swept: the times would differ")
    if isinstance(settings.every, int) and ("dt" in grid.names or settings.dt is None):
        raise ValueError(f"every must be in seconds (a float) to store frames of different dt, got {settings.every} steps")


def _checked_members(scene: Scene, grid: Grid, settings: Settings) -> Members:
    """The members. Enough members are made to check every swept value."""
    members = Members(scene, grid, settings)
    if grid.size <= _CHECKED:
        indices: Sequence[int] = range(grid.size)
    else:
        first = dict.fromkeys(range(len(grid.axes)), 0)
        places = [{**first, k: p} for k, axis in enumerate(grid.axes) for p in range(len(axis))]
        indices = [int(np.ravel_multi_index(tuple(place.values()), grid.shape)) for place in places[:_CHECKED]]
    told = False
    for index in indices:
        try:
            member = members.make(index)
            if not told and member.integrator != "auto":
                told = warn_of_order(member.integrator, member.scene)
        except (ValueError, TypeError) as error:
            values = grid.member(index)
            if not values:
                raise
            which = ", ".join(f"{name}={value!r}" for name, value in values.items())
            raise type(error)(f"over has the member {which} that cannot be run: {error}") from error
    return members


def _identity(scene: Scene, grid: Grid, settings: Settings) -> dict[str, Any]:
    """Identity of a sweep, as JSON can hold it."""
    return {
        "version": build_config()["version"],
        "scene": scene.to_dict(),
        "over": grid.describe(),
        "settings": {
            name: [describe(metric) for metric in settings.metrics] if name == "metrics" else plain(value)
            for name, value in vars(settings).items()
        },
    }


def _provenance() -> dict[str, Any]:
    return {**provenance(), "wall_time": 0.0, "tasks": 0, "task_seconds": 0.0, "hosts": [], "instruction_sets": []}


def _warn_of_failures(results: Results) -> None:
    if failed := results.count("failed"):
        messages = results.variables["message"].values.ravel()
        status = results.variables["status"].values.ravel()
        first = int((status == 3).argmax())
        warnings.warn(
            f"{failed} of {results.grid.size} members failed; the first: {messages[first]}", RuntimeWarning, stacklevel=4
        )
