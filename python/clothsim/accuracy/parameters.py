"""The numbers of a scene that can vary continuously, by the names of a sweep."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ..base import Floats, check
from ..model.cloth import Cloth
from ..model.fields import change_scene, check_sweep_name, unit_of_name
from ..model.obstacle import Plane, Sphere
from ..model.scene import Scene

# This is the step of a difference over the scale of its parameter. With it, rounding and truncation
# are below 1e-9 of most derivatives.
STEP = 7e-5


class Parameter(NamedTuple):
    """A number of a scene that can vary continuously."""

    name: str  # name in the caller's spelling
    field: str  # name in the spelling of a sweep
    value: float
    scale: float  # size of a change that changes the motion visibly
    least: float
    most: float

    @property
    def only_direction(self) -> int:
        """The only side to which it can vary, else 0."""
        reach = 3 * STEP * self.scale
        return int(self.value - reach <= self.least) - int(self.value + reach >= self.most)


def parameters_of(scene: Scene, names: Any, argument: str) -> list[Parameter]:
    """Return the named parameters with their values in `scene`."""
    if isinstance(names, str) or not isinstance(names, (Sequence, Mapping)) or not names:
        raise TypeError(
            f"{argument} must be a sequence of names such as ('stiffness', 'drag'), got "
            f"{check.value_text(names)}"
        )
    numbers = _numbers_by_name(scene)
    scales = {"m": max(scene.cloth.size), "m/s^2": 9.80665, "1": 1.0}
    scales["N s/m"] = float(scene.cloth.mass_per_point.min())  # Such a drag acts within a second.
    parameters = []
    for name in names:
        field = check_sweep_name(name.replace(".", "_") if isinstance(name, str) else name)
        if field not in numbers:
            raise ValueError(
                f"{argument} must name numbers of the scene, got {name!r}; this one has "
                f"{', '.join(numbers)}"
            )
        value = numbers[field][0]
        if any(other != value for other in numbers[field]):
            raise ValueError(
                f"{argument} must name single numbers, got {name!r}, here {numbers[field]}: "
                "name its parts"
            )
        parameters.append(
            Parameter(
                name=name,
                field=field,
                value=value,
                scale=max(abs(value), scales.get(unit_of_name(field), 0.0)),
                least=-math.inf if field[-2:] in ("_x", "_y", "_z") else 0.0,
                most=1.0 if field.endswith("restitution") else math.inf,
            )
        )
    if len({parameter.field for parameter in parameters}) < len(parameters):
        raise ValueError(f"{argument} must name each parameter once, got {list(names)}")
    return parameters


def scene_with_values(
    scene: Scene, parameters: Sequence[Parameter], values: Sequence[float] | Floats
) -> Scene:
    """Return a copy of `scene` with new values of the parameters."""
    fields: dict[str, Any] = {p.field: float(value) for p, value in zip(parameters, values)}
    if "mass" in fields:  # The masses of the points keep their ratios.
        fields["mass"] *= scene.cloth.mass_per_point / scene.cloth.mass_per_point.sum()
    return change_scene(scene, fields)


def _numbers_by_name(scene: Scene) -> dict[str, list[float]]:
    """Return the numbers of a scene by name: several, where the name stands for several objects."""
    cloth = scene.cloth
    numbers = {"mass": [float(cloth.mass_per_point.sum())], "drag": [cloth.drag]}
    for kind, families in (
        ("stiffness", cloth.family_stiffness),
        ("damping", cloth.family_damping),
    ):
        numbers[kind] = [*families.values()]
        for family, value in families.items():
            numbers[f"{kind}_{family}"] = [value]
    vectors = {"gravity": [scene.gravity]}
    for k, pin in enumerate(cloth.pins):
        vectors[f"pin{k}"] = [scene.initial_position[pin]]
    planes = {f"plane{k}": s for k, s in enumerate(scene.spheres) if s._kind == "plane"}
    for prefix, members in _obstacles_by_prefix("plane", planes).items():
        for part in ("point", "normal"):
            vectors[f"{prefix}_{part}"] = [getattr(plane, part) for plane in members]
        numbers |= _contact_numbers_by_name(prefix, members, cloth)
    obstacles = {f"sphere{k}": sphere for k, sphere in enumerate(scene.spheres)}
    for prefix, members in _obstacles_by_prefix("sphere", obstacles).items():
        numbers |= _contact_numbers_by_name(prefix, members, cloth)
        if all(sphere._kind == "sphere" for sphere in members):
            vectors[f"{prefix}_center"] = [sphere.center for sphere in members]
            numbers[f"{prefix}_radius"] = [sphere.radius for sphere in members]
    if scene.wind:
        vectors["wind_velocity"] = [scene.wind.velocity]
        for name in ("density", "normal", "tangential"):
            numbers[f"wind_{name}"] = [getattr(scene.wind, name)]
    for name, values in vectors.items():
        for k, component in enumerate("xyz"):
            numbers[f"{name}_{component}"] = [float(value[k]) for value in values]
    return {name: values for name, values in numbers.items() if values}


def _obstacles_by_prefix(prefix: str, obstacles: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Return all obstacles under the prefix, and each under its own name."""
    groups = {prefix: [*obstacles.values()]}
    for name, obstacle in obstacles.items():
        groups[name] = [obstacle]
    return groups


def _contact_numbers_by_name(
    prefix: str, obstacles: Sequence[Sphere | Plane], cloth: Cloth
) -> dict[str, list[float]]:
    """Return the numbers of contact of some obstacles, layers as resolved for the cloth."""
    numbers = {f"{prefix}_friction": [obstacle.friction for obstacle in obstacles]}
    if all(obstacle.response == "penalty" for obstacle in obstacles):
        layers = [obstacle.layer(cloth) for obstacle in obstacles]
        for name in ("thickness", "stiffness", "dissipation", "slip_speed"):
            numbers[f"{prefix}_{name}"] = [layer[name] for layer in layers]
    restitutions = [o.restitution for o in obstacles if o.restitution is not None]
    if len(restitutions) == len(obstacles):
        numbers[f"{prefix}_restitution"] = restitutions
    return numbers
