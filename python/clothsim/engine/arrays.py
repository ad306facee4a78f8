"""Checks of the arguments of every call: scenes, states, arrays for results, time of the start."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base import check
from ..model.scene import Scene

# float32 or float64, as the caller gave it: a state that is stepped stays of its type.
FloatArray = npt.NDArray[Any]


def scenes_of(scene: Scene | Sequence[Scene]) -> list[Scene]:
    """`scene` as a list of scenes of one shape."""
    if isinstance(scene, Scene):
        return [scene]
    accepted = "a Scene or a non-empty sequence of Scene of one shape"
    if not isinstance(scene, Sequence) or isinstance(scene, (str, bytes)):
        raise TypeError(f"scene must be {accepted}, got {check.shown(scene)}")
    for k, one in enumerate(scene):
        if not isinstance(one, Scene):
            raise TypeError(f"scene must be {accepted}, got {type(one).__name__} at index {k}")
    shapes = {one.cloth.shape for one in scene}
    if len(shapes) != 1:
        raise ValueError(f"scene must be {accepted}, got the shapes {sorted(shapes)}")
    return list(scene)


def state_array(name: str, value: Any, scenes: list[Scene], batched: bool) -> FloatArray:
    """`value` as a finite, C-contiguous float32 or float64 array, copied only where necessary.

    Its shape is (rows, columns, 3), or (B, rows, columns, 3). If the scenes came as a sequence (`batched`), B is their
    number, else B is free.
    """
    shape = (*scenes[0].cloth.shape, 3)
    shapes = f"({len(scenes)}, {shape[0]}, {shape[1]}, 3)" if batched else f"{shape} or (B, {shape[0]}, {shape[1]}, 3)"
    accepted = f"an array of shape {shapes} of finite numbers"
    given = check.as_array(name, value, accepted)
    members = given.shape[0] if given.ndim == 4 else 0
    fits = given.shape[-3:] == shape and (members == len(scenes) if batched else given.ndim == 3 or members > 0)
    if not fits:
        raise ValueError(f"{name} must be {accepted}, got shape {given.shape}")
    dtype = np.float32 if given.dtype == np.float32 else np.float64
    result = np.require(given, dtype, ("C", "A"))
    check.check_all(name, result, np.isfinite(result), accepted, points=True)
    return result


def refuse_none(**states: Any) -> None:
    """Raise a TypeError where a state is None: only a `Stepper` takes the scene's own state then."""
    for name, value in states.items():
        if value is None:
            own = {"x": "scene.initial_position", "v": "scene.initial_velocity"}[name]
            raise TypeError(f"{name} must be an array, got None; the scene's own state is {own}")


def state_arrays(x: Any, v: Any, scenes: list[Scene], batched: bool) -> tuple[FloatArray, FloatArray]:
    """`x` and `v` checked, of one shape and dtype (the wider of the two)."""
    x, v = state_array("x", x, scenes, batched), state_array("v", v, scenes, batched)
    if x.shape != v.shape:
        raise ValueError(f"x and v must have one shape, got {x.shape} and {v.shape}")
    dtype = np.result_type(x, v)
    return x.astype(dtype, copy=False), v.astype(dtype, copy=False)


def checked_state(x: Any, v: Any, scenes: list[Scene], batched: bool, precision: str) -> tuple[FloatArray, FloatArray]:
    """As `state_arrays`, and check that the numbers are in the range of the precision."""
    x, v = state_arrays(x, v, scenes, batched)
    if precision == "single":
        largest = float(np.finfo(np.float32).max)
        for name, array in (("x", x), ("v", v)):
            if max(array.max(), -array.min()) <= largest:
                continue
            accepted = f"at most {largest:.3g} in size with precision 'single'"
            check.check_all(name, array, np.abs(array) <= largest, accepted)
    return x, v


def out_arrays(out: Any, shape: tuple[int, ...], dtype: np.dtype[Any]) -> tuple[FloatArray, FloatArray]:
    """`out` checked to be two arrays that can hold the results; new arrays if it is None."""
    if out is None:
        return np.empty(shape, dtype), np.empty(shape, dtype)
    x, v = out if type(out) is tuple and len(out) == 2 else check.items("out", out, 2, "arrays (x, v)")
    out_array("out[0]", x, shape, dtype)
    out_array("out[1]", v, shape, dtype)
    if x is v or (np.may_share_memory(x, v) and np.shares_memory(x, v)):
        raise ValueError("out must be two arrays that share no memory, got arrays that overlap")
    return x, v


def out_array(name: str, array: Any, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
    """Check that `array` can be written to in place of a new array."""
    if type(array) is np.ndarray and array.dtype == dtype and array.shape == shape and array.flags.carray:
        return
    accepted = f"a writeable, C-contiguous, aligned {dtype} array of shape {shape}"
    if not isinstance(array, np.ndarray):
        raise TypeError(f"{name} must be {accepted}, got {check.shown(array)}")
    if array.dtype != dtype or array.shape != shape:
        raise ValueError(f"{name} must be {accepted}, got {array.dtype} of shape {array.shape}")
    flags = array.flags
    found = f"writeable {flags.writeable}, C-contiguous {flags.c_contiguous}, aligned {flags.aligned}"
    raise ValueError(f"{name} must be {accepted}, got {found}")


def start_time(t: Any, scenes: Sequence[Scene]) -> float:
    """`t` checked. None means 0, and is refused where a sphere or a pin moves."""
    if type(t) is float and math.isfinite(t):
        return t
    if t is not None:
        return check.number("t", t)
    for scene in scenes:
        moving = [("sphere", f"spheres[{k}]") for k, sphere in enumerate(scene.spheres) if sphere.motion is not None]
        moving += [("pin", f"pins[{pin}]") for pin in scene.cloth.driven]
        if moving:
            raise ValueError(
                f"t must be given where a {moving[0][0]} moves, and {moving[0][1]} has a motion: give "
                "the time of this state in seconds, t=0.0 if it is the start"
            )
    return 0.0


# Rounding of float32 positions, as part of the size of the cloth and of the distance from the origin. Half of it refuses
# float32 states; with twice as much a pin may jump by 2 um on a sheet of a metre.
_PLACE_ROUNDING = 1e-6


def check_driven_pins(scenes: Sequence[Scene], x: FloatArray, t: float, frozen: Sequence[bool] = ()) -> None:
    """Refuse positions in which a driven pin is not where its motion puts it at the time `t`, except in frozen members."""
    for member, scene in enumerate(scenes):
        one = x[member] if x.ndim == 4 else x
        for pins in () if frozen and frozen[member] else scene.driven_pins:
            places = pins.places_at(t)
            off = np.abs(one[pins.rows, pins.columns] - places).max(axis=1)
            bad = off > _PLACE_ROUNDING * (max(scene.cloth.size) + np.abs(places).max(axis=1))
            if bad.any():
                k = int(bad.argmax())
                point = int(pins.rows[k]), int(pins.columns[k])
                raise ValueError(
                    f"x must have the driven pin {point} at its place at t = {t:g} s, {places[k].tolist()}, "
                    f"got {one[point].tolist()}"
                )


def put_driven_pins(scenes: Sequence[Scene], x: FloatArray, v: FloatArray, t: float, frozen: Sequence[bool] = ()) -> None:
    """Write places and velocities of driven pins at the time `t` into a state, except those of frozen members."""
    for member, scene in enumerate(scenes):
        for pins in () if frozen and frozen[member] else scene.driven_pins:
            at = (pins.rows, pins.columns) if x.ndim == 3 else (member, pins.rows, pins.columns)
            x[at] = pins.places_at(t)
            v[at] = pins.motion._velocity(np.array(t))


def check_pins(scenes: Sequence[Scene], x: FloatArray, v: FloatArray, own_x: FloatArray, own_v: FloatArray) -> None:
    """Refuse a state that would move a pin or change its velocity."""
    for member, scene in enumerate(scenes):
        one = member if x.ndim == 4 else ...
        size = max(scene.cloth.size)
        for name, given, own, scale in (("x", x[one], own_x[one], size), ("v", v[one], own_v[one], 0.0)):
            off = np.abs(given - own) > _PLACE_ROUNDING * (scale + np.abs(own))
            bad = np.argwhere(off.any(axis=-1) & scene.cloth.pinned)
            if bad.size:
                point = tuple(int(n) for n in bad[0])
                raise ValueError(
                    f"{name} must be {own[point].tolist()} at the pin {point}, got {given[point].tolist()}; "
                    "driven pins move: Cloth(pins={(row, column): cs.Linear(velocity)})"
                )


def sphere_targets(centers: Any, scenes: Sequence[Scene]) -> dict[int, npt.NDArray[np.float64]]:
    """`centers` of `Stepper.advance` checked."""
    if not isinstance(centers, Mapping):
        raise TypeError(f"centers must be a mapping of spheres' indices to centres, got {check.shown(centers)}")
    count = min(len(scene.spheres) for scene in scenes)
    if centers and not count:
        raise ValueError(f"centers must be None for a scene without spheres, got {check.shown(centers)}")
    keys = [check.integer("centers", k, minimum=0, maximum=count - 1) for k in centers]
    return {k: np.array(check.vector(f"centers[{k}]", one)) for k, one in zip(keys, centers.values())}
