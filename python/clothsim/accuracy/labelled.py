"""Measured errors and costs as a Dataset."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..machine.build import build_config
from .measured import Bench, Measured
from .methods import OWN, Method

if TYPE_CHECKING:
    import xarray


def pareto(rms: npt.ArrayLike, cost: npt.ArrayLike) -> npt.NDArray[np.bool_]:
    """True at the points that no other point beats in both error and cost (the Pareto front).

    Both arrays have one shape. A point that is not finite in both is beaten.

    >>> pareto([1e-3, 1e-6, 1e-5, 1e-9], [1.0, 2.0, 3.0, 4.0]).tolist()
    [True, True, False, True]
    """
    rms, cost = np.asarray(rms, dtype=float), np.asarray(cost, dtype=float)
    front = np.zeros(rms.shape, dtype=bool)
    best = math.inf
    for k in np.lexsort((rms.ravel(), cost.ravel())):
        at = np.unravel_index(k, rms.shape)
        if np.isfinite(rms[at]) and np.isfinite(cost[at]) and rms[at] < best:
            front[at] = True
            best = float(rms[at])
    return front


def label(method: Method) -> str:
    """Label of a method: its name and precision; for a peer also its number of threads."""
    threads = f", {method.threads} threads" if method.library != OWN and method.threads != 1 else ""
    return f"{method.name} {method.precision}{threads if method.threads else ''}"


def dataset(xr: Any, bench: Bench, methods: list[Method], results: dict[tuple[int, int], Measured]) -> xarray.Dataset:
    """Dataset of `work_precision` returns."""
    shape = len(methods), 1 + max(n for _, n in results)
    duration = bench.duration

    def table(value: Any) -> npt.NDArray[np.float64]:
        array = np.full(shape, np.nan)
        for at, one in results.items():
            array[at] = value(one)
        return array

    rms, wall_time = table(lambda r: r.rms), table(lambda r: r.fastest / duration)
    own = np.array([m.library == OWN for m in methods])
    columns = {
        "setting": (table(lambda r: r.setting), "dt [s] or relative tolerance", ""),
        "rms_error": (rms, "rms distance from the reference at the end", "m"),
        "max_error": (table(lambda r: r.max), "largest distance from the reference", "m"),
        "force_evaluations": (table(lambda r: r.force_evaluations), "force evaluations", "1"),
        "wall_time": (wall_time, "wall time per simulated second", "s/s"),
        "energy_drift": (table(lambda r: r.energy_drift), "total energy less the reference's", "J"),
        "pareto": (pareto(np.where(own[:, None], rms, np.nan), wall_time), "on the front of clothsim's methods", ""),
        "pareto_all": (pareto(rms, wall_time), "on the front of all methods", ""),
    }
    solution = bench.solution
    found: xarray.Dataset = xr.Dataset(
        {
            name: (("solver", "level"), values, {"long_name": text, "units": unit})
            for name, (values, text, unit) in columns.items()
        },
        {
            "solver": [label(m) for m in methods],
            "level": np.arange(shape[1]),
            "integrator": ("solver", [m.name for m in methods]),
            "precision": ("solver", [m.precision for m in methods]),
            "library": ("solver", [m.library for m in methods]),
            "threads": ("solver", [m.threads or 0 for m in methods]),
            "control": ("solver", [m.control for m in methods]),
        },
        {
            "scene": json.dumps(bench.scene.to_dict()),
            "duration": duration,
            "reference_error_estimate_rms": float(solution.error_estimate["rms"][-1]),
            "reference_error_bound_rms": float(solution.error_bound["rms"][-1]),
            "instruction_set": build_config()["instruction_set"],
            "version": build_config()["version"],
        },
    )
    return found
