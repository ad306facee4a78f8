"""Unknown keyword arguments: an error that suggests the name of clothsim that was likely meant."""

from __future__ import annotations

import difflib
import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])
C = TypeVar("C", bound=type)

OTHER_NAMES: Mapping[str, tuple[str, ...]] = {
    # SciPy's solve_ivp and its likes
    "method": ("integrator", "kind"),
    "solver": ("integrator",),
    "scheme": ("integrator",),
    "t_span": ("duration",),
    "tspan": ("duration",),
    "t_end": ("duration",),
    "t_final": ("duration",),
    "t_max": ("duration",),
    "total_time": ("duration",),
    "time": ("t", "duration"),
    "t0": ("t",),
    "t_eval": ("times", "every"),
    "saveat": ("times", "every"),
    "max_step": ("dt", "dts"),
    "first_step": ("dt", "dts"),
    "step_size": ("dt", "dts"),
    "stepsize": ("dt", "dts"),
    "time_step": ("dt", "dts"),
    "timestep": ("dt", "dts"),
    "h": ("dt", "dts"),
    "y0": ("x", "position"),
    "x0": ("x", "position"),
    "v0": ("v", "velocity"),
    "tol": ("rtol",),
    "tolerance": ("rtol",),
    "n_steps": ("steps",),
    "num_steps": ("steps",),
    "iterations": ("steps",),
    # the state
    "positions": ("x", "position"),
    "velocities": ("v", "velocity"),
    "position": ("x",),
    "velocity": ("v",),
    "pos": ("x", "position"),
    "vel": ("v", "velocity"),
    # the model
    "centre": ("center",),
    "centres": ("centers",),
    "rad": ("radius",),
    "r": ("radius",),
    "k": ("stiffness",),
    "K": ("stiffness",),
    "spring_constant": ("stiffness",),
    "c": ("damping",),
    "m": ("mass",),
    "g": ("gravity",),
    "pinned": ("pins",),
    "fixed": ("pins",),
    "families": ("springs",),
    "resolution": ("shape",),
    "ball": ("sphere", "spheres"),
    # how it is computed
    "dtype": ("precision",),
    "device": ("backend",),
    "workers": ("threads", "executor"),
    "n_jobs": ("threads",),
    "n_threads": ("threads",),
    "num_threads": ("threads",),
    "verbose": ("progress",),
    "filename": ("path",),
    "file": ("path",),
}
"""Names that other packages, books or other spellings use, and how clothsim calls them."""


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
            message = _unknown(function, kwargs) or _missing(function, args, kwargs) if own else None
            if message is None:
                raise
        raise TypeError(message)

    return call  # type: ignore[return-value]


def suggesting(cls: C) -> C:
    """Apply `suggests` to the constructor of the class `cls`."""
    cls.__init__ = suggests(cls.__init__)  # type: ignore[misc]
    return cls


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


def _missing(function: Callable[..., Any], args: tuple[Any, ...], given: Mapping[str, Any]) -> str | None:
    """The message for required arguments that a call lacks; None if it has all."""
    parameters = inspect.signature(function).parameters
    known = [n for n, one in parameters.items() if one.kind not in (one.VAR_POSITIONAL, one.VAR_KEYWORD)]
    have = {*known[: len(args)], *given}
    missing = [repr(n) for n in known if n not in have and parameters[n].default is inspect.Parameter.empty]
    if not missing:
        return None
    name = function.__qualname__.removesuffix(".__init__")
    words = f"argument{'s' * (len(missing) > 1)} {' and '.join(missing)}"
    return f"{name}() needs the {words}; it takes {', '.join(n for n in known if n != 'self')}"


def _suggestion(unknown: str, known: list[str]) -> str:
    for ours in OTHER_NAMES.get(unknown, ()):
        if ours in known:
            return f"; clothsim calls it {ours!r}"
    close = difflib.get_close_matches(unknown.lower(), known, n=1, cutoff=0.6)
    return f" (did you mean {close[0]!r}?)" if close else ""
