"""Names that examples of the documentation take for granted."""

from typing import Any

import clothsim as cs
import numpy as np
import numpy.typing as npt

scene: cs.Scene
cloth: cs.Cloth
sphere: cs.Sphere
run: cs.Run
other: cs.Run
axes: Any
over: dict[str, list[float]]
x: npt.NDArray[np.float64]
v: npt.NDArray[np.float64]
integrator: str
stiffness: npt.NDArray[np.float64]
dt: float
duration: float
times: Any
positions: Any
