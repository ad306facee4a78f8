"""Calls with arrays in and arrays out. A scene keeps its engines for the next call.

To compile a scene and to build an engine for it costs ten steps of a small cloth. A scene is
immutable, so an engine serves later calls with equal arithmetic and arrays of equal shape.
"""

from __future__ import annotations

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

Waiting = list[State]


def waiting_engines(
    scene: Any, x: Any, v: Any, integrator: Any, precision: Any, threads: Any, kernel: Any, strict: Any, backend: Any = "cpu"
) -> Waiting | None:
    """The list of engines that can serve this call; None if the call needs a new engine or full checks."""
    if not type(x) is type(v) is np.ndarray:
        return None
    shape, dtype = x.shape, x.dtype
    if v.shape != shape or v.dtype is not dtype or x.nbytes > _MOST_BYTES:
        return None
    # Keys are compared by value, and True is 1.
    if type(strict) is not bool or type(threads) not in _THREADS or type(backend) is not str or backend != "cpu":
        return None
    if type(scene) is Scene:
        first, others = scene, None
    elif type(scene) in (list, tuple) and scene and all(type(one) is Scene for one in scene):
        # An engine that waits keeps its scenes, so that no other object has their identity.
        first, others = scene[0], tuple(map(id, scene))
    else:
        return None
    processors = _core.available_threads() if threads is None else 0
    key = (shape, dtype, integrator, precision, threads, kernel, strict, processors, others)
    try:
        waiting: Waiting | None = first.engines.get(key)
    except TypeError:  # an option that is no name
        return None
    if waiting is None:
        if len(first.engines) >= _MOST_KINDS:
            first.engines.pop(next(iter(first.engines)), None)
        waiting = first.engines[key] = []
    return waiting


def take(waiting: Waiting | None) -> State | None:
    """Take an engine from the list; None if the list is empty. Other callers cannot use it until `give_back` returns
    it.
    """
    try:
        return waiting.pop() if waiting else None
    except IndexError:  # another thread was quicker
        return None


def give_back(waiting: Waiting | None, state: State) -> None:
    """Put the engine back for the next call of its kind. Callers do not put it back after an error."""
    if waiting is not None and len(waiting) < _MOST_WAITING:
        waiting.append(state)
