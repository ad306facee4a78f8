"""Calls with arrays in and arrays out: engines wait at their scene for the next call.

To compile a scene and to build an engine for it costs ten steps of a small cloth. A scene is immutable, so
an engine of an earlier call serves the next one that asks for the same arithmetic on arrays of one shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .. import _core
from ..model.scene import Scene
from .state import State

# Larger states are stepped so long that a new engine does not count, and their engines would hold memory.
_MOST_BYTES = 1 << 22
# Engines that wait for one kind of call, so that two threads find one each, and kinds of calls per scene.
_MOST_WAITING, _MOST_KINDS = 2, 8

_THREADS = (int, type(None))


def borrow(
    scene: Scene | Sequence[Scene],
    x: Any,
    v: Any,
    *,
    t: float | None,
    integrator: str,
    precision: str,
    threads: int | None,
    kernel: str,
    strict: bool,
    backend: str = "cpu",
) -> State:
    """The state (x, v) of a scene in an engine, new or of an earlier call; `give_back` after use."""
    options = (integrator, precision, threads, kernel, strict, backend)
    waiting = _waiting(scene, x, v, options)
    if waiting:
        try:
            state = waiting.pop()
        except IndexError:  # another thread was quicker
            pass
        else:
            # What is refused is told by the checks of a new state.
            if state.begin(x, v, t):
                return state
    state = State(
        scene,
        x,
        v,
        t=t,
        integrator=integrator,
        precision=precision,
        threads=threads,
        kernel=kernel,
        strict=strict,
        backend=backend,
    )
    state.waiting = waiting
    return state


def give_back(state: State) -> None:
    """Let the engine wait for the next call of its kind. After an error it is not given back."""
    if state.waiting is not None and len(state.waiting) < _MOST_WAITING:
        state.waiting.append(state)


def _waiting(scene: Any, x: Any, v: Any, options: tuple[Any, ...]) -> list[State] | None:
    """Where engines for such a call wait; None if it needs a new one, or the checks of arguments."""
    if not (type(x) is type(v) is np.ndarray and x.shape == v.shape and x.dtype is v.dtype):
        return None
    threads, strict, backend = options[2], options[4], options[5]
    # Keys are compared by value, and True is 1.
    if type(strict) is not bool or type(threads) not in _THREADS or x.nbytes > _MOST_BYTES:
        return None
    if type(backend) is not str or backend != "cpu":
        return None
    if type(scene) is Scene:
        first, others = scene, None
    elif type(scene) in (list, tuple) and scene and all(type(one) is Scene for one in scene):
        # An engine that waits keeps its scenes, so that no other object has their identity.
        first, others = scene[0], tuple(map(id, scene))
    else:
        return None
    processors = _core.available_threads() if threads is None else 0
    key = (x.shape, x.dtype, options, _core.kernel_environment(), processors, others)
    try:
        waiting: list[State] | None = first.engines.get(key)
    except TypeError:  # an option that is no name
        return None
    if waiting is None:
        if len(first.engines) >= _MOST_KINDS:
            first.engines.pop(next(iter(first.engines)), None)
        waiting = first.engines[key] = []
    return waiting
