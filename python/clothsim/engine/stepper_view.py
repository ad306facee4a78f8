"""The read-only half of a `Stepper`: its state, its options and its text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt

from ..base.record import frozen
from ..model.scene import Scene
from ..model.wording import cloth_text, counted, spheres_text
from ..typing import Kernel
from .arrays import FloatArray
from .options import Options
from .state import State

if TYPE_CHECKING:
    from .stepper import Stepper


class StepperView:
    """Properties of a `Stepper` that only read."""

    _state: State
    _scene: Scene | Sequence[Scene]
    _options: Options

    @property
    def frozen(self) -> npt.NDArray[np.bool_]:
        """True for members that take no further steps, shape (B,); see `freeze`."""
        return np.array(self._state.core.frozen)

    def __setattr__(self, name: str, value: Any) -> None:
        # A new attribute such as `dt` would change nothing, in silence.
        if not name.startswith("_"):
            raise AttributeError(
                f"{name} of a Stepper cannot be set: set_state changes positions, velocities and the time, "
                "set_scene changes the scene, and advance takes the time step"
            )
        super().__setattr__(name, value)

    def _arrays(self) -> tuple[FloatArray, FloatArray]:
        x, v = (np.empty(self._state.shape, self._state.dtype) for _ in "xv")
        self._state.store(x, v)
        return x, v

    @property
    def positions(self) -> FloatArray:
        """Positions [m], a read-only copy, of the shape and dtype that the state was given in.

        `set_state` changes the state.
        """
        x = np.empty(self._state.shape, self._state.dtype)
        self._state.store(x, None)
        return frozen(x)

    @property
    def velocities(self) -> FloatArray:
        """Velocities [m/s], a read-only copy, of the shape and dtype of the state."""
        v = np.empty(self._state.shape, self._state.dtype)
        self._state.store(None, v)
        return frozen(v)

    @property
    def scene(self) -> Scene | Sequence[Scene]:
        """The scene, or the scenes of a batch; `set_scene` changes it."""
        return self._scene

    @property
    def time(self) -> float:
        """Time of the state [s]."""
        return float(self._state.core.time)

    @property
    def threads(self) -> int:
        """Threads used; 1 with the backend "gpu"."""
        return self._state.threads

    @property
    def kernel(self) -> Kernel:
        """Kernel used, "gather" or "edge"."""
        return cast("Kernel", self._state.kernel)

    @property
    def instruction_set(self) -> str:
        """Instruction set of the kernels used, or the graphics adapter."""
        return str(self._state.instruction_set)

    @property
    def backend(self) -> str:
        """Backend used, "cpu" or "gpu"."""
        return self._options.backend

    @property
    def impulses(self) -> npt.NDArray[np.float64]:
        """Impulse on each sphere since the stepper was made [N s], shape (spheres, 3).

        An impulse is the sum over the steps of minus the momentum that responses of this sphere gave to the cloth. Moves of
        points without velocity, such as `push_out_speed`, give none. Pinned points take no momentum.

        A batch has one row per member, shape (B, spheres, 3), NaN where a member has fewer spheres. `set_state` and
        `set_scene` keep the sums, and so do snapshots. With the backend "gpu" all are NaN.

        Examples
        --------
        A cloth without gravity gives its momentum to the sphere that it falls on:

        >>> import clothsim as cs
        >>> cloth = cs.Cloth(mass=2.0, stiffness=100.0, damping=0.1, pins=())
        >>> scene = cs.Scene(cloth, cs.Sphere((0.5, -0.3, 0.5), 0.25), gravity=(0, 0, 0))
        >>> stepper = cs.Stepper(scene, scene.initial_position, scene.initial_velocity + (0, -1, 0))
        >>> stepper.advance(200, 1e-3)
        >>> lost = -2.0 * (stepper.velocities.mean(axis=(0, 1)) + (0, 1, 0))
        >>> bool(abs(stepper.impulses[0] - lost).max() < 1e-12)
        True
        """
        members = [np.reshape(one["impulse"], (-1, 3)) for one in self._state.core.watched]
        if not self._state.batched:
            return members[0]
        impulses = np.full((len(members), max(map(len, members)), 3), np.nan)
        for row, member in zip(impulses, members):
            row[: len(member)] = member
        return impulses

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        """Lines and a picture of the state, for a notebook. For a batch, the picture shows the first member."""
        from ..viewing.notebook import stepper_bundle

        return stepper_bundle(cast("Stepper", self))

    def __repr__(self) -> str:
        return f"<{'; '.join(self._lines())}>"

    def _lines(self) -> list[str]:
        """The scene, the time, and how steps are computed."""
        scenes, shape = self._state.scenes, self._state.shape
        batch = f"a batch of {shape[0]}, each " if len(shape) == 4 else ""
        how = f"{self._state.integrator} in {self._options.precision}, kernel {self.kernel}"
        return [
            f"Stepper of {batch}{cloth_text(scenes[0])}, {spheres_text(scenes)}",
            f"t = {self.time:.6g} s",
            f"{how}, {counted(self.threads, 'thread')}, {self.instruction_set}",
        ]
