"""Helpers that know nothing of cloth: checks of arguments, extras, files, progress."""

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
