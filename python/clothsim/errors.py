"""Errors and warnings of computations. Wrong arguments give `ValueError` or `TypeError` instead."""

from __future__ import annotations

import sys
import warnings
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any

import numpy as np


class StabilityWarning(UserWarning):
    """The time step is above the guaranteed stable step (`max_stable_dt`).

    A run may be stable all the same. The guarantee holds for all but extreme states. A cloth near
    rest is often stable at twice that step. ``max_stable_dt(scene, integrator, x)`` gives the limit
    at a state.

    The second cause is a gain of energy: before any sphere has responded, the time step has added
    more than half of the kinetic and elastic energy.

    `Stepper` and `simulate` give at most one warning of each cause, `step` one per line of your
    code, which is Python's default. A run that grows further ends with an `UnstableError`.

    Examples
    --------
    >>> import warnings
    >>> with warnings.catch_warnings(record=True) as given:
    ...     cs.Stepper(cs.scenes.paper_swing()).advance(2, 1.5e-3)
    >>> for part in str(given[0].message).split("; "):
    ...     print(part)
    dt = 0.0015 s is above 0.00116 s, up to which rk4 is guaranteed to be stable for this scene
    the damping of structural and shear springs, 100 N s/m, limits it
    below 37.6 N s/m the stiffness would
    """


def warn_caller(message: str, category: type[Warning]) -> None:
    """Give a warning that points to the caller's code, outside this package."""
    frame = sys._getframe(1)
    level = 2
    package = __name__.partition(".")[0]
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] == package:
        frame = frame.f_back
        level += 1
    warnings.warn(message, category, stacklevel=level)


class OrderWarning(UserWarning):
    """The integrator does not keep its order for this scene.

    `step`, `Stepper`, `simulate` and `sweep` give this warning for "pefrl" with damping: its order
    is 4 for forces that depend on positions alone, and 1 for damping.

    Examples
    --------
    >>> import warnings
    >>> with warnings.catch_warnings(record=True) as given:
    ...     stepper = cs.Stepper(cs.scenes.paper_swing(), integrator="pefrl")
    >>> print(given[0].message.args[0].partition(":")[0])
    pefrl is of order 1 for a scene with damping, not of order 4
    """


class ContactWarning(UserWarning):
    """A point or triangle is below the true surface of an obstacle, an obstacle has run into a
    pinned point, or the cloth starts deep in a layer.

    Examples
    --------
    >>> import warnings
    >>> with warnings.catch_warnings(record=True) as given:
    ...     scene = cs.Scene(cs.Cloth((8, 8)), cs.Plane((0, 0, 0), thickness=0.1))
    ...     run = cs.simulate(scene, 0.001, dt=1e-4)
    >>> print(given[0].message.args[0].partition(":")[0])
    mass point (0, 1) starts 0.1 m deep in the layer of spheres[0]
    """


class ToleranceWarning(UserWarning):
    """A run under error control did not reach the error that was asked for, or does not know it.

    `simulate` gives it with the reason. `print(run)` tells the error.

    Examples
    --------
    >>> import warnings
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     run = cs.simulate(cs.scenes.paper_static(), 0.5, rtol=1e-6)
    >>> print(caught[0].message.args[0].partition(":")[0])
    the error at the end is not known
    """


class RunInterrupted(KeyboardInterrupt):
    """Ctrl-C has ended a call of `simulate`; `run` has the run so far.

    Parameters
    ----------
    run : Run, list of Run or None
        The run up to its last complete step, with the state there as its last frame. For several
        scenes, the runs begun so far.

    Examples
    --------
    A callback raises the interrupt here; you press Ctrl-C.

    >>> def interrupt(t, x, v):
    ...     if t >= 0.02:
    ...         raise KeyboardInterrupt
    >>> try:
    ...     run = cs.simulate(cs.scenes.paper_swing(), 60.0, 1e-3, fps=100, callback=interrupt)
    ... except cs.RunInterrupted as interrupted:
    ...     run = interrupted.run
    >>> float(run.t[-1])
    0.02
    """

    def __init__(self, run: Any = None) -> None:
        self.run = run
        last = run[-1] if isinstance(run, list) else run
        super().__init__(
            "" if last is None else f"simulate was interrupted at t = {last.t[-1]:g} s"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.run,)


@dataclass(kw_only=True, eq=False, repr=False)
class _StepError(ArithmeticError):
    """An error at a step of a cloth, or of a member of a batch."""

    step: int
    time: float
    point: tuple[int, int] | None = None
    x: np.ndarray | None = None
    v: np.ndarray | None = None
    member: int | None = None
    run: Any = field(default=None, init=False)
    runs: Any = field(default=None, init=False)

    def __reduce__(self) -> tuple[Any, ...]:
        names = [argument.name for argument in fields(self) if argument.init]
        values = {name: getattr(self, name) for name in names}
        return partial(type(self), **values), (), self.__dict__

    @property
    def _of_member(self) -> str:
        return "" if self.member is None else f" of batch member {self.member}"


@dataclass(kw_only=True, eq=False, repr=False)
class ContactError(_StepError):
    """A free mass point has gone through the layer of an obstacle with response "penalty".

    Parameters
    ----------
    step : int
        The failed step, counted from 1 at the start of the call.
    time, point, x, v, member
        As for `UnstableError`, with the state before that step; `run` and `runs` too.
    obstacle : int
        Index of the obstacle in ``Scene.spheres`` that the point has passed.
    remedy : str
        What would hold the point.

    Examples
    --------
    >>> error = cs.ContactError(step=3, time=0.5, point=(1, 2), obstacle=0, remedy="take rtol")
    >>> print(error)
    mass point (1, 2) has gone through the layer of spheres[0] at step 3 (t = 0.5 s); take rtol
    """

    obstacle: int
    remedy: str

    def __post_init__(self) -> None:
        self.args = (
            f"mass point {self.point}{self._of_member} has gone through the layer of "
            f"spheres[{self.obstacle}] at step {self.step} (t = {self.time:g} s); {self.remedy}",
        )


@dataclass(kw_only=True, eq=False, repr=False)
class UnstableError(_StepError):
    """The state of the cloth stopped being finite or grew beyond bounds.

    Raised while stepping, most often because the time step is above the stability limit of the
    integrator. All arguments are keyword-only and become attributes.

    Parameters
    ----------
    step : int
        The step after which it was found, counted from 1 at the start of the call. A runaway energy
        may be found up to 128 steps late in short calls.
    time : float
        Time of the scene at the end of that step [s].
    point : tuple of int, optional
        (row, column) of the first free mass point concerned; None where only a driven pin is not
        finite.
    dt : float
        Time step [s].
    max_stable_dt : float, optional
        The time step guaranteed to be stable [s]; see `clothsim.max_stable_dt`.
    term : str, optional
        The term that limits the time step, in words: stiffness or damping, its springs, and the
        value below which it no longer limits; see `Scene.explain`.
    function : bool, default False
        Whether the argument `force` was given.
    x, v : numpy.ndarray, optional
        The last finite state: positions [m] and velocities [m/s], shape (rows, columns, 3).
    member : int, optional
        Index into the batch, None for a single cloth.

    Attributes
    ----------
    run : Run or None
        From `simulate`: the run up to the state before that step.
    runs : list of Run or None
        From `simulate` of many scenes: the runs of all, of which some may have ended early.

    Examples
    --------
    >>> error = cs.UnstableError(step=12, time=0.13, point=(3, 4), dt=0.01, max_stable_dt=2e-3)
    >>> print(error)
    unstable at step 12 (t = 0.13 s), first at mass point (3, 4): the time step dt = 0.01 s is \
above the stability limit, about 0.002 s; take a dt below it, or less stiffness or damping, or \
more mass
    """

    dt: float
    max_stable_dt: float | None = None
    term: str | None = None
    function: bool = False

    def __post_init__(self) -> None:
        where = "" if self.point is None else f", first at mass point {self.point}"
        limit = self.max_stable_dt
        if limit is None:
            cause = f"dt = {self.dt:g} s"
            remedy = "take a smaller dt, or look for values too large in the initial state"
        elif limit == 0:
            cause = f"no time step is guaranteed to be stable: {self.term}"
            remedy = "take another integrator, such as 'rk4' or 'semi_implicit_euler'"
        elif self.dt > limit:
            cause = (
                f"the time step dt = {self.dt:g} s is above the stability limit, about {limit:g} s"
            )
            remedy = "take a dt below it, or less stiffness or damping, or more mass"
            if self.term:
                cause += f" ({self.term})"
        elif self.function:
            cause = (
                f"the time step dt = {self.dt:g} s is within the limit of springs and drag, "
                f"{limit:g} s, which does not know the function given as force"
            )
            remedy = "take a dt that follows that force, or a smoother or smaller force"
        else:
            cause = (
                f"though the time step dt = {self.dt:g} s is within the estimated stability "
                f"limit, {limit:g} s"
            )
            remedy = (
                "look for points that coincide or values too large in the initial state, "
                "else take a smaller dt"
            )
        self.args = (
            f"unstable at step {self.step} (t = {self.time:g} s){where}{self._of_member}: "
            f"{cause}; {remedy}",
        )
