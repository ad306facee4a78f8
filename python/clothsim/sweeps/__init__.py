"""Sweeps: thousands of cloths, labelled, resumable, on one machine or a cluster.

One concept a file: `fields` says what can be swept, `grid` which members there are, `member` what
one is; `batch` runs those that share a call, `task` those that one worker does in one go;
`session` does a whole sweep, for which `planning` cuts it into tasks and `workers` has them done;
`metrics`, `reference` and `contact` measure; `results`, `store` and `dataset` keep and label;
`plots` and `accessor` draw.
"""

from typing import TYPE_CHECKING

from ..base.on_demand import on_demand

if TYPE_CHECKING:
    from .api import sweep
    from .dataset import open_sweep
    from .metrics import METRICS

__all__ = ["METRICS", "open_sweep", "sweep"]

__getattr__, __dir__ = on_demand(globals(), {"METRICS": ".metrics", "open_sweep": ".dataset", "sweep": ".api"})
