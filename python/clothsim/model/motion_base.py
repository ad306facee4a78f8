"""Base of all motions: places and velocities at times, and plain data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, TypeVar

import numpy as np
import numpy.typing as npt

from ..base import check
from ..base.record import Record
from ..typing import Numbers

Vectors = npt.NDArray[np.float64]
Self = TypeVar("Self", bound="BaseMotion")


def _times(t: npt.ArrayLike) -> Vectors:
    accepted = "t must be a finite number or an array of finite numbers"
    given = check.as_array("t", t, accepted.removeprefix("t must be "))
    if given.dtype.kind not in "iuf":
        raise TypeError(f"{accepted}, got {check.shown(t)}")
    if not np.isfinite(given).all():
        raise ValueError(f"{accepted}, got {check.shown(t)}")
    return given.astype(np.float64)


class BaseMotion(Record):
    kind: ClassVar[str]

    def center_at(self, t: npt.ArrayLike, center0: Numbers) -> Vectors:
        """Centre of the sphere at the time `t`.

        Parameters
        ----------
        t : float or array_like
            Time [s]; any shape, negative times too.
        center0 : sequence of 3 floats
            The ``center`` of the sphere [m].

        Returns
        -------
        numpy.ndarray
            Positions [m], the shape of `t` with 3 appended.

        Examples
        --------
        >>> import clothsim as cs
        >>> cs.Linear(velocity=(0, 1, 0)).center_at(0.5, (0, 0, 0))
        array([0. , 0.5, 0. ])
        """
        return self._center(_times(t), np.array(check.vector("center0", center0)))

    def velocity_at(self, t: npt.ArrayLike) -> Vectors:
        """Velocity of the sphere at the time `t`; at a kink of the path, the velocity just after the kink.

        Parameters
        ----------
        t : float or array_like
            Time [s]; any shape, negative times too.

        Returns
        -------
        numpy.ndarray
            Velocities [m/s], the shape of `t` with 3 appended.

        Examples
        --------
        >>> import clothsim as cs
        >>> cs.Linear(velocity=(0, 1, 0)).velocity_at(0.5)
        array([0., 1., 0.])
        """
        return self._velocity(_times(t))

    def kinks(self, begin: float, end: float) -> list[float]:
        """Times at which the velocity jumps, or one of its components turns from rising to falling or back.

        Steps of error control end there. Between two of them a step sees the whole motion: each component of the velocity
        lies between its values at both ends.

        Parameters
        ----------
        begin, end : float
            Only times between these two count [s].

        Returns
        -------
        list of float
            Times [s], increasing.

        Examples
        --------
        >>> import clothsim as cs
        >>> cs.Keyframes([0.0, 1.0, 3.0], [(0, 0, 0), (1, 0, 0), (1, 4, 0)]).kinks(0.0, 2.0)
        [1.0]
        """
        return []

    def _center(self, t: Vectors, center0: Vectors) -> Vectors:
        raise NotImplementedError

    def _velocity(self, t: Vectors) -> Vectors:
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """Plain data as JSON and TOML can hold them, with the motion's name under "kind".

        Returns
        -------
        dict

        Examples
        --------
        >>> import clothsim as cs
        >>> cs.Linear(velocity=(0, 1, 0)).to_dict()
        {'kind': 'linear', 'velocity': [0.0, 1.0, 0.0]}
        """
        return {"kind": self.kind, **super().to_dict()}

    @classmethod
    def from_dict(cls: type[Self], data: Mapping[str, Any]) -> Self:
        """The motion that `data` (as from ``to_dict``) describes.

        Parameters
        ----------
        data : mapping
            "kind", the name of this motion, and its arguments.

        Returns
        -------
        instance of this class

        Raises
        ------
        ValueError
            For an unknown or missing key, another motion's "kind", or a refused value.
        TypeError
            If `data` is no mapping.

        Examples
        --------
        >>> import clothsim as cs
        >>> cs.Linear.from_dict({"kind": "linear", "velocity": [0, 1, 0]}).velocity
        (0.0, 1.0, 0.0)
        """
        arguments = cls._arguments(data, "kind")
        check.choice(f"{cls.__name__} kind", arguments.pop("kind"), (cls.kind,))
        return cls(**arguments)
