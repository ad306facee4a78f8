"""Errors of a computation, as against errors of its arguments."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np


class ContactWarning(UserWarning):
    """A sphere with response "continuous" starts on the cloth, or has run into a pinned point."""


class ContactError(ArithmeticError):
    """Spheres with response "continuous" have closed on a mass point and left it no place.

    All arguments are keyword-only and become attributes.

    Parameters
    ----------
    step : int
        The step, counted from 1 at the start of the call, that could not be done.
    time : float
        Time of the scene at its end [s].
    point : tuple of int
        (row, column) of the first mass point concerned.
    x, v : numpy.ndarray
        The state before that step: positions [m] and velocities [m/s], shape (rows, columns, 3).
    member : int, optional
        Index into the batch, None for a single cloth.

    Examples
    --------
    >>> import clothsim as cs
    >>> print(cs.ContactError(step=3, time=0.5, point=(1, 2), x=None, v=None))
    no place left at step 3 (t = 0.5 s) for mass point (1, 2): the spheres have shut it in; keep \
them further apart, or make them smaller
    """

    def __init__(
        self,
        *,
        step: int,
        time: float,
        point: tuple[int, int],
        x: np.ndarray | None,
        v: np.ndarray | None,
        member: int | None = None,
    ) -> None:
        self.step = step
        self.time = time
        self.point = point
        self.x = x
        self.v = v
        self.member = member
        which = "" if member is None else f" of batch member {member}"
        super().__init__(
            f"no place left at step {step} (t = {time:g} s) for mass point {point}{which}: the "
            "spheres have shut it in; keep them further apart, or make them smaller"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        names = ("step", "time", "point", "x", "v", "member")
        return partial(type(self), **{name: getattr(self, name) for name in names}), (), self.__dict__


class UnstableError(ArithmeticError):
    """The state of the cloth stopped being finite or grew beyond bounds.

    Raised while stepping, most often because the time step is above the stability limit of the
    integrator. All arguments are keyword-only and become attributes.

    Parameters
    ----------
    step : int
        The step, counted from 0 at the start of the call, after which it was found.
    time : float
        Time of the scene at the end of that step [s].
    point : tuple of int, optional
        (row, column) of the first mass point concerned.
    dt : float
        Time step [s].
    max_stable_dt : float, optional
        Estimate of the largest stable time step [s].
    x, v : numpy.ndarray, optional
        The last finite state: positions [m] and velocities [m/s], shape (rows, columns, 3).
    member : int, optional
        Index into the batch, None for a single cloth.

    Examples
    --------
    >>> import clothsim as cs
    >>> error = cs.UnstableError(step=12, time=0.13, point=(3, 4), dt=0.01, max_stable_dt=0.0016)
    >>> error.point, error.dt > error.max_stable_dt
    ((3, 4), True)
    >>> print(error)
    unstable at step 12 (t = 0.13 s), first at mass point (3, 4): the time step dt = 0.01 s is \
above the stability limit, about 0.0016 s; take a dt below it, or less stiffness or damping, or \
more mass
    """

    def __init__(
        self,
        *,
        step: int,
        time: float,
        point: tuple[int, int] | None = None,
        dt: float,
        max_stable_dt: float | None = None,
        x: np.ndarray | None = None,
        v: np.ndarray | None = None,
        member: int | None = None,
    ) -> None:
        self.step = step
        self.time = time
        self.point = point
        self.dt = dt
        self.max_stable_dt = max_stable_dt
        self.x = x
        self.v = v
        self.member = member
        super().__init__(self._message())

    def _message(self) -> str:
        where = "" if self.point is None else f", first at mass point {self.point}"
        which = "" if self.member is None else f" of batch member {self.member}"
        limit = self.max_stable_dt
        if limit is None:
            cause = f"dt = {self.dt:g} s"
            remedy = "take a smaller dt, or look for values too large in the initial state"
        elif self.dt > limit:
            cause = (
                f"the time step dt = {self.dt:g} s is above the stability limit, about {limit:g} s"
            )
            remedy = "take a dt below it, or less stiffness or damping, or more mass"
        else:
            cause = (
                f"though the time step dt = {self.dt:g} s is within the estimated stability "
                f"limit, {limit:g} s"
            )
            remedy = (
                "look for points that coincide or values too large in the initial state, "
                "else take a smaller dt"
            )
        return (
            f"unstable at step {self.step} (t = {self.time:g} s){where}{which}: {cause}; {remedy}"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        names = ("step", "time", "point", "dt", "max_stable_dt", "x", "v", "member")
        values = {name: getattr(self, name) for name in names}
        return partial(type(self), **values), (), self.__dict__
