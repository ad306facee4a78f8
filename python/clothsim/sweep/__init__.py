"""Sweeps: thousands of cloths, labelled, resumable, on one machine or a cluster.

One concept a file: `fields` says what can be swept, `grid` which members there are, `member` what
one is; `batch` runs those that share a call, `task` those that one worker does in one go;
`session` does a whole sweep, for which `planning` cuts it into tasks and `engine` has them done;
`metrics`, `reference` and `contact` measure; `results`, `store` and `dataset` keep and label;
`plots` and `accessor` draw.
"""

from typing import TYPE_CHECKING, Any

from .api import sweep

if TYPE_CHECKING:
    from .dataset import open_sweep
    from .metrics import METRICS

__all__ = ["METRICS", "open_sweep", "sweep"]


def __getattr__(name: str) -> Any:
    """What importing clothsim does without."""
    if name == "open_sweep":
        from .dataset import open_sweep as value
    elif name == "METRICS":
        from .metrics import METRICS as value
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return value
