"""Names of what can be swept or fitted: every argument of Cloth, Sphere, Scene and the run, and
parts of them.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from typing import Any

from ..base import Floats, check
from ..base.text import format_count
from .cloth import FAMILIES, Cloth
from .motion import MOTIONS
from .obstacle import Plane, Sphere
from .scene import Scene
from .wind import Wind

NUMERICS = ("dt", "rtol", "atol", "integrator", "precision", "kernel")
"""Names that change how a cloth is computed, not which cloth."""

RUN = (*NUMERICS, "duration")

_UNITS = {
    name: unit
    for unit, names in {
        "m": (
            "size",
            "position",
            "center",
            "centers",
            "offsets",
            "radius",
            "offset",
            "point",
            "distance",
            "amplitude",
            "thickness",
            "atol",
        ),
        "s": ("period", "times", "dt", "duration"),
        "Hz": ("frequency",),
        "m/s": ("velocity", "slip_speed"),
        "1": (
            "direction",
            "normal",
            "tangential",
            "deceleration",
            "phase",
            "restitution",
            "friction",
            "rtol",
        ),
        "kg": ("mass",),
        "kg/m^3": ("density",),
        "s/m": ("dissipation",),
        "N/m": ("stiffness",),
        "N s/m": ("damping", "drag"),
        "N": ("force",),
        "m/s^2": ("gravity",),
    }.items()
    for name in names
}

_COMPONENTS = {"x": 0, "y": 1, "z": 2}


def _argument_names(cls: type) -> tuple[str, ...]:
    return tuple(f.name for f in dataclasses.fields(cls))


_CLOTH = _argument_names(Cloth)
_SPHERE_ALONE = ("radius", "offset", "as_printed")  # what no plane has
_SPHERE = _argument_names(Sphere)
_PLANE = _argument_names(Plane)
_SCENE = tuple(name for name in _argument_names(Scene) if name not in ("cloth", "spheres"))
_MOTION = tuple(dict.fromkeys(name for cls in MOTIONS.values() for name in _argument_names(cls)))
_FAMILY_PARTS = tuple(
    f"{name}_{family}" for name in ("stiffness", "damping") for family in FAMILIES
)
_SPHERE_PARTS = (*_SPHERE, *(f"center_{c}" for c in _COMPONENTS), *_MOTION)
_PLANE_PARTS = (*_PLANE, *(f"{n}_{c}" for n in ("point", "normal") for c in _COMPONENTS), *_MOTION)

_WIND = _argument_names(Wind)
_WIND_PARTS = (*_WIND, *(f"velocity_{c}" for c in _COMPONENTS), *_MOTION)

NAMES = (
    "scene",
    *_CLOTH,
    *_FAMILY_PARTS,
    *_SCENE,
    *(f"gravity_{c}" for c in _COMPONENTS),
    *(f"pin0_{c}" for c in _COMPONENTS),
    *(f"wind_{name}" for name in _WIND_PARTS),
    *(f"sphere_{name}" for name in _SPHERE_PARTS),
    *(f"plane_{name}" for name in _PLANE_PARTS),
    *RUN,
)
"""Every name that can be swept; those of one sphere or plane, by its index in `spheres`
("sphere1_radius", "plane0_point_y"), and of other pins ("pin1_x") come on top.
"""

_OBSTACLE_NAME = re.compile(r"(sphere|plane)(\d*)_(\w+)")
_PIN_NAME = re.compile(r"pin(\d+)_([xyz])")


def check_sweep_name(name: Any) -> str:
    """Return `name` if it can be swept, else raise an error that suggests the nearest name."""
    text = name if isinstance(name, str) else ""
    field = name
    if obstacle := _OBSTACLE_NAME.fullmatch(text):
        field = f"{obstacle[1]}_{obstacle[3]}"
    elif pin := _PIN_NAME.fullmatch(text):
        field = f"pin0_{pin[2]}"
    if isinstance(field, str) and field in NAMES:
        return str(name)
    hint = check.nearest_name_hint(field, NAMES)
    raise ValueError(
        f"over must have names that can be swept, got {name!r}{hint}; clothsim.sweepable() "
        "lists them"
    )


def sweepable() -> dict[str, str]:
    """Return every name that `sweep` takes in ``over``, with its unit.

    Returns
    -------
    dict of str to str
        Units are "" where values have none. Each `sphere_` and `plane_` name also works with an
        index into `Scene.spheres`, for example "sphere1_radius". "pin0_x" is the initial place of
        the first of the cloth's `pins`, "pin1_x" that of the next.

    Examples
    --------
    >>> names = cs.sweepable()
    >>> names["stiffness_shear"], names["gravity_y"], names["integrator"]
    ('N/m', 'm/s^2', '')
    """
    return {name: unit_of_name(name) for name in NAMES}


def unit_of_name(name: str) -> str:
    """Return the unit of a swept name; "" where its values have none."""
    if _PIN_NAME.fullmatch(name):
        return "m"
    match = _OBSTACLE_NAME.fullmatch(name)
    name = match[3] if match else name.removeprefix("wind_")
    for part in (*FAMILIES, *_COMPONENTS):
        name = name.removesuffix(f"_{part}")
    return _UNITS.get(name, "")


def change_scene(scene: Scene, values: Mapping[str, Any]) -> Scene:
    """Return a copy of `scene` with the named values.

    Whole arguments are set before parts of them, whatever the order of `values`.
    """
    if not values:
        return scene
    if values.keys() <= set(_CLOTH):
        return scene.replace(cloth=scene.cloth.replace(**values))
    values = dict(values)
    scene = values.pop("scene", scene)
    check.instance("scene", scene, Scene)
    cloth = {name: values.pop(name) for name in _CLOTH if name in values}
    parts = {name: values.pop(name) for name in _FAMILY_PARTS if name in values}
    changes = {name: values.pop(name) for name in _SCENE if name in values}
    gravity = {c: values.pop(f"gravity_{c}") for c in _COMPONENTS if f"gravity_{c}" in values}
    if gravity:
        changes["gravity"] = _vector_with_components(changes.get("gravity", scene.gravity), gravity)
    pins = {name: values.pop(name) for name in [*values] if _PIN_NAME.fullmatch(name)}
    air = {name: values.pop(name) for name in [*values] if name.startswith("wind_")}
    if air:
        changes["wind"] = _change_wind(changes.get("wind", scene.wind), air)
    if values:
        changes["spheres"] = _change_spheres(scene.spheres, values)
    if parts:
        cloth |= _family_values_with_parts(scene.cloth.replace(**cloth), parts)
    if cloth:
        changes["cloth"] = scene.cloth.replace(**cloth)
    scene = scene.replace(**changes)
    return scene.replace(position=_position_with_pins(scene, pins)) if pins else scene


def _position_with_pins(scene: Scene, values: Mapping[str, float]) -> Floats:
    position = scene.initial_position.copy()
    pins = [*scene.cloth.pins]
    for name, value in values.items():
        # The name has passed check_sweep_name.
        index, component = _PIN_NAME.fullmatch(name).groups()  # type: ignore[union-attr]
        if int(index) >= len(pins):
            raise ValueError(
                f"{name} needs a pin with the index {index}; the cloth has "
                f"{format_count(len(pins), 'pin')}"
            )
        position[pins[int(index)]][_COMPONENTS[component]] = check.number(name, value)
    return position


def _vector_with_components(vector: Any, components: Mapping[str, Any]) -> tuple[float, ...]:
    result = list(vector)
    for component, value in components.items():
        result[_COMPONENTS[component]] = value
    return tuple(result)


def _family_values_with_parts(
    cloth: Cloth, parts: Mapping[str, Any]
) -> dict[str, dict[str, float]]:
    changed: dict[str, dict[str, float]] = {}
    for name, value in parts.items():
        argument, _, family = name.rpartition("_")
        if family not in cloth.springs:
            raise ValueError(f"{name} needs a cloth with {family} springs, got {cloth.springs}")
        values = cloth.family_stiffness if argument == "stiffness" else cloth.family_damping
        changed.setdefault(argument, dict(values))[family] = value
    return changed


def _change_wind(wind: Wind | None, values: Mapping[str, Any]) -> Wind:
    if wind is None:
        raise ValueError(f"{next(iter(values))} needs a scene with wind")
    parts = {name.removeprefix("wind_"): value for name, value in values.items()}
    velocity = {c: parts.pop(f"velocity_{c}") for c in _COMPONENTS if f"velocity_{c}" in parts}
    arguments = {name: parts.pop(name) for name in _WIND if name in parts}
    if velocity:
        arguments["velocity"] = _vector_with_components(
            arguments.get("velocity", wind.velocity), velocity
        )
    wind = wind.replace(**arguments)
    for part, value in parts.items():
        if wind.motion is None or part not in _argument_names(type(wind.motion)):
            raise ValueError(f"wind_{part} needs a wind whose motion has it, got {wind.motion!r}")
        wind = wind.replace(motion=wind.motion.replace(**{part: value}))
    return wind


def _change_spheres(
    spheres: tuple[Sphere | Plane, ...], values: Mapping[str, Any]
) -> list[Sphere | Plane]:
    parts = {}
    for name in values:
        # The name has passed check_sweep_name.
        kind, number, part = _OBSTACLE_NAME.fullmatch(name).groups()  # type: ignore[union-attr]
        index = int(number) if number else None
        parts[name] = kind, index, part
        _check_obstacle(name, kind, index, part, spheres)
    result = []
    for k, sphere in enumerate(spheres):
        own = {
            name: part
            for name, (kind, index, part) in parts.items()
            if index in (None, k) and _has_part(sphere, kind, part)
        }
        # Whole arguments are replaced first and together; a part is then a part of the new whole.
        arguments = _argument_names(type(sphere))
        sphere = sphere.replace(
            **{part: values[name] for name, part in own.items() if part in arguments}
        )
        for name in [name for name, part in own.items() if part not in arguments]:
            sphere = _change_part(sphere, name, own[name], values[name])
        result.append(sphere)
    return result


def _has_part(obstacle: Sphere | Plane, kind: str, part: str) -> bool:
    """Return whether a name of this kind and part means the sphere or plane."""
    return obstacle._kind == kind or (kind == "sphere" and part not in _SPHERE_ALONE)


def _check_obstacle(
    name: str, kind: str, index: int | None, part: str, spheres: tuple[Sphere | Plane, ...]
) -> None:
    """Refuse a name that means nothing in these `spheres`."""
    if (index or 0) >= len(spheres):
        needed = f"a {kind}" if index is None else f"a {kind} with the index {index}"
        raise ValueError(
            f"{name} needs {needed}; the scene has {format_count(len(spheres), 'sphere')}"
        )
    places = range(len(spheres)) if index is None else [index]
    if not any(_has_part(spheres[k], kind, part) for k in places):
        other = "plane" if kind == "sphere" else "sphere"
        raise ValueError(f"{name} needs a {kind}, and spheres[{places[-1]}] is a {other}")


def _change_part(sphere: Sphere | Plane, name: str, part: str, value: Any) -> Sphere | Plane:
    vector_name, _, component = part.rpartition("_")
    if part == "center":
        return sphere.replace(**{sphere._place_name: value})
    if vector_name in ("center", "point", "normal"):
        argument = sphere._place_name if vector_name == "center" else vector_name
        vector = _vector_with_components(getattr(sphere, argument), {component: value})
        return sphere.replace(**{argument: vector})
    if sphere.motion is None or part not in _argument_names(type(sphere.motion)):
        raise ValueError(
            f"{name} needs a {sphere._kind} whose motion has it, got {sphere.motion!r}"
        )
    return sphere.replace(motion=sphere.motion.replace(**{part: value}))
