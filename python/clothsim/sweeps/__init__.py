"""Sweeps: thousands of cloths, labelled, resumable, on one machine or a cluster.

Each file has one concept:

- `fields` has the names that can be swept, `grid` the members, `member` a single member.
- `batch` runs members that share a call, `controlled` a member with error control, `task` the members of one task.
- `session` runs a whole sweep: `planning` cuts it into tasks, and `workers` executes them.
- `metrics` and `reference` measure; `results`, `store` and `dataset` keep and label.
- `sweep_plots` and `accessor` draw.
"""

from typing import TYPE_CHECKING

from ..base.on_demand import on_demand

if TYPE_CHECKING:
    from .api import sweep
    from .dataset import open_sweep
    from .metrics import METRICS

__all__ = ["METRICS", "open_sweep", "sweep"]

__getattr__, __dir__ = on_demand(globals(), {"METRICS": ".metrics", "open_sweep": ".dataset", "sweep": ".api"})
