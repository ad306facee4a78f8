"""Helpers that know nothing of cloth: checks of arguments, extras, files, progress, functions of
later rooms.
"""

from importlib.util import find_spec

import numpy as np
import numpy.typing as npt

try:
    from .. import _core  # noqa: F401
except ImportError:
    # Python would name a circular import.
    if find_spec("clothsim._core") is None:
        raise ImportError(
            "the core of clothsim is not built here: run `pip install .` in the clone, "
            "or build it as CONTRIBUTING.md says and put it into python/clothsim"
        ) from None
    raise

Floats = npt.NDArray[np.float64]


def make_read_only(array: np.ndarray) -> np.ndarray:
    """Make `array` read-only, and return it."""
    array.flags.writeable = False
    return array
