"""Unknown keyword arguments: an error that suggests the name of clothsim that was likely meant."""

from __future__ import annotations

import difflib
import functools
import inspect
from collections.abc import Callable, Mapping
from dataclasses import FrozenInstanceError
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])
C = TypeVar("C", bound=type)

OTHER_NAMES = {
    "integrator": "method solver scheme",
    "kind": "method",
    "t": "time t0",
    "duration": "t_span tspan t_end t_final t_max total_time time",
    "times": "t_eval saveat",
    "every": "t_eval saveat",
    "dt": "max_step first_step step_size stepsize time_step timestep h",
    "dts": "max_step first_step step_size stepsize time_step timestep h",
    "rtol": "tol tolerance",
    "steps": "n_steps num_steps iterations",
    "x": "y0 x0 positions position pos",
    "position": "y0 x0 positions pos",
    "v": "v0 velocities velocity vel",
    "velocity": "v0 velocities vel",
    "center": "centre",
    "centers": "centres",
    "radius": "rad r",
    "stiffness": "k K spring_constant",
    "damping": "c",
    "mass": "m",
    "gravity": "g",
    "pins": "pinned fixed",
    "springs": "families",
    "shape": "resolution",
    "sphere": "ball",
    "spheres": "ball",
    "precision": "dtype",
    "backend": "device",
    "threads": "workers n_jobs n_threads num_threads",
    "executor": "workers",
    "progress": "verbose",
    "path": "filename file",
}
"""How clothsim calls an argument, and the names of it in other packages, books and spellings."""

GONE = {
    "damping_model": "damping [N s/m] damps springs and drag [N s/m] damps points; "
    "in place of damping_model='point', damping=c write damping=0.0, drag=c"
}
"""Arguments of earlier versions, and what to write in their place."""


def suggests(function: F) -> F:
    """Wrap `function` so that its error for an unknown keyword argument suggests a known keyword.

    A correct call costs one more function call and nothing else.
    """

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        try:
            return function(*args, **kwargs)
        except TypeError as error:
            # Raised by this very call, not by one inside of it.
            own = error.__traceback__.tb_next is None  # type: ignore[union-attr]
            message = _unknown(function, kwargs) if own else None
            if message is None:
                raise
        raise TypeError(message)

    return call  # type: ignore[return-value]


def suggesting(cls: C) -> C:
    """Apply `suggests` to the constructor of the class `cls`; an assignment to a frozen object names `replace`."""
    cls.__init__ = suggests(cls.__init__)  # type: ignore[misc]
    if hasattr(cls, "replace"):
        cls.__setattr__ = _refuse_assignment  # type: ignore[assignment]
    return cls


def _refuse_assignment(self: Any, name: str, value: Any) -> None:
    kind = type(self).__name__
    if name in inspect.signature(type(self)).parameters:
        raise FrozenInstanceError(f"a {kind} cannot be changed; replace({name}=...) returns a changed copy")
    raise FrozenInstanceError(f"a {kind} cannot be changed, and has no argument {name!r}")


def _unknown(function: Callable[..., Any], given: Mapping[str, Any]) -> str | None:
    """The message for the first keyword that `function` does not have; None if there is none."""
    parameters = inspect.signature(function).parameters
    if any(one.kind is one.VAR_KEYWORD for one in parameters.values()):
        return None
    known = [n for n, one in parameters.items() if n != "self" and one.kind is not one.POSITIONAL_ONLY]
    unknown = next((name for name in given if name not in known), None)
    if unknown is None:
        return None
    name = function.__qualname__.removesuffix(".__init__")
    return (
        f"{name}() got an unknown argument {unknown!r}{_suggestion(unknown, known)}; it takes {', '.join(known) or 'none'}"
    )


def _suggestion(unknown: str, known: list[str]) -> str:
    if unknown in GONE:
        return f"; {GONE[unknown]}"
    for ours, others in OTHER_NAMES.items():
        if ours in known and unknown in others.split():
            return f"; clothsim calls it {ours!r}"
    close = difflib.get_close_matches(unknown.lower(), known, n=1, cutoff=0.6)
    return f" (did you mean {close[0]!r}?)" if close else ""
