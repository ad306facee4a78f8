"""The shader of a scene: its features, pipelines that contain only these, and its numbers, rounded
once from double.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .. import _core
from ..model.cloth import FAMILIES
from ..model.scene import Scene
from .device import Device

FIRST_SPRING = 5
FIRST_WEIGHT = FIRST_SPRING + 3 * len(_core.spring_kinds)
CONTACT_SIZE = 28
# The shader notes these of each member, in the order of `results` (layout.wgsl): the first mass
# point that is not finite or too fast, the first pinned one in an obstacle, the first through a
# layer (counted over obstacle after obstacle), and the steps before the first contact with a layer.
FINDINGS = ("bad", "pinned_inside", "passed", "first_contact")


def springs_wgsl(neighbours: Sequence[tuple[int, int, str, int]] = _core.neighbours) -> str:
    """Return the WGSL of the override constants of the families and of a mass point's spring
    forces, from cpp/model/stencil.hpp.

    A neighbour is rows and columns on, family, and kind of spring. The forces add up in this order,
    which is part of their bits.
    """
    lines = ["// From cpp/model/stencil.hpp."]
    lines += [
        f"override {family}: bool = true;"
        for family in dict.fromkeys(family for _, _, family, _ in neighbours)
    ]
    lines += [
        "fn spring_forces(id: vec3<u32>, x: vec3<real>, v: vec3<real>) -> vec3<real> {",
        "    let first = id.z * constants.parameter_stride + first_spring;",
        "    let columns = constants.columns;",
        "    let at = place(id);",
        "    var a = vec3<real>();",
    ]
    for family, group in groupby(neighbours, lambda neighbour: neighbour[2]):
        lines.append(f"    if ({family}) {{")
        for row, column, _, kind in group:
            axes = (("id.y", row, "constants.rows"), ("id.x", column, "columns"))
            inside = [
                f"{at} + {way}u < {end}" if way > 0 else f"{at} >= {-way}u"
                for at, way, end in axes
                if way
            ]
            down, right = ("-" if way < 0 else "+" for way in (row, column))
            place = f"at {down} {abs(row)}u * columns {right} {abs(column)}u"
            lines.append(
                f"        if ({' && '.join(inside)}) "
                f"{{ a = add_spring(a, x, v, {place}, first + {3 * kind}u); }}"
            )
        lines.append("    }")
    return "\n".join([*lines, "    return a;", "}"])


class SphereFeatures(NamedTuple):
    response: str
    as_printed: bool
    rough: bool


@dataclass(frozen=True)
class Features:
    """Features of a scene; all members of a batch have equal features, so that a dispatch serves
    all of them.
    """

    families: tuple[str, ...]
    spring_damping: bool
    drag: bool
    mass_per_point: bool
    pinned: bool
    moving: bool
    spheres: tuple[SphereFeatures, ...]

    @classmethod
    def of_scene(cls, scene: Scene) -> Features:
        cloth = scene.cloth
        return cls(
            families=cloth.springs,
            spring_damping=any(cloth.family_damping.values()),
            drag=cloth.drag > 0,
            mass_per_point=not cloth.uniform_mass,
            pinned=bool(cloth.pinned.any()),
            moving=any(sphere.motion is not None for sphere in scene.spheres),
            spheres=tuple(
                SphereFeatures(s.response, s.as_printed, s.response != "penalty" and s.friction > 0)
                for s in scene.spheres
            ),
        )

    def override_constants(self) -> dict[str, float]:
        """Return values of the shader's override constants."""
        switches = {family: float(family in self.families) for family in FAMILIES}
        names = ("spring_damping", "drag", "mass_per_point", "pinned", "moving")
        return switches | {name: float(getattr(self, name)) for name in names}

    def contacts_wgsl(self) -> str:
        """Return the WGSL of the forces of penalty obstacles and of the responses after a step,
        both in the order of the obstacles.
        """
        lines = [
            "fn add_contacts(force: vec3<real>, x: vec3<real>, v: vec3<real>, id: vec3<u32>) "
            "-> vec3<real> {",
            "    var result = force;",
        ]
        lines += [
            f"    result = add_contact(result, x, v, id, {k}u);"
            for k, s in enumerate(self.spheres)
            if s.response == "penalty"
        ]
        lines += ["    return result;", "}"]
        lines += [
            "fn respond_all(point: PointState, id: vec3<u32>) -> PointState {",
            "    var result = point;",
        ]
        for k, s in enumerate(self.spheres):
            if s.response != "penalty":
                flags = ", ".join(
                    str(flag).lower() for flag in (s.response == "ray", s.as_printed, s.rough)
                )
                lines.append(
                    f"    result = respond(result, contact_of(id.z, {k}u), id.z, {flags});"
                )
        return "\n".join([*lines, "    return result;", "}"])


@cache
def shader_text(name: str) -> str:
    """Return the text of shaders/`name`.wgsl."""
    return files(__package__).joinpath("shaders", f"{name}.wgsl").read_text(encoding="utf-8")


_KEEP = {
    "f32": "bitcast<f32>(bitcast<u32>(a) | z)",
    "f64": "bitcast<f64>(bitcast<u64>(a) | u64(z))",
}
_EXPONENT = {
    "f32": ("bitcast<u32>(a)", "0x7f800000u"),
    "f64": ("u32(bitcast<u64>(a) >> 32u)", "0x7ff00000u"),
}


def keep_function_wgsl(word: str, name: str = "keep", zero: str = "constants.zero") -> str:
    """Return the WGSL of a function that returns its argument of type `word`, and hides that from
    the compiler.

    The value passes through integers and a zero from a buffer. So the compiler cannot replace (a +
    b) - a by b, and cannot fuse a product with a sum.
    """
    return f"fn {name}(a: {word}) -> {word} {{ let z = {zero}; return {_KEEP[word]}; }}"


def step_wgsl(features: Features, precision: str, float64: bool) -> str:
    """Return the whole WGSL of a step: `real` is the type of its arithmetic, `wide` that of a
    response.
    """
    real = "f64" if precision == "double" else "f32"
    wide = "f64" if float64 else "f32"
    bits, exponent = _EXPONENT[real]
    lines = [
        f"alias real = {real};",
        f"alias wide = {wide};",
        f"const compensated = {str(precision == 'single').lower()};",
        f"fn is_finite(a: real) -> bool {{ return ({bits} & {exponent}) != {exponent}; }}",
    ]
    for word, prefix in ((real, ""), (wide, "wide_")):
        vector = f"vec3<{word}>"
        multiple = ", ".join(f"{prefix}product(a, b.{k})" for k in "xyz")
        x, y, z = (f"{prefix}product(a.{k}, b.{k})" for k in "xyz")
        lines += [
            keep_function_wgsl(word, f"{prefix}keep"),
            f"fn {prefix}product(a: {word}, b: {word}) -> {word} {{ return {prefix}keep(a * b); }}",
            f"fn {prefix}multiple(a: {word}, b: {vector}) -> {vector} "
            f"{{ return {vector}({multiple}); }}",
            f"fn {prefix}inner(a: {vector}, b: {vector}) -> {word} {{ return ({x} + {y}) + {z}; }}",
        ]
    lines.append(
        "fn keep_all(a: vec3<real>) -> vec3<real> "
        "{ return vec3<real>(keep(a.x), keep(a.y), keep(a.z)); }"
    )
    shared = {
        "first_spring": FIRST_SPRING,
        "first_weight": FIRST_WEIGHT,
        "contact_size": CONTACT_SIZE,
        **{name: k for k, name in enumerate(FINDINGS)},
        "findings": len(FINDINGS),
    }
    lines += [
        f"const {name} = {value}u;"
        for name, value in {"group_size": _core.group_size, **shared}.items()
    ]
    names = ["layout", "contact", "wide" if float64 else "narrow", "penalty", "step", "check"]
    return "\n".join([*lines, springs_wgsl(), *map(shader_text, names), features.contacts_wgsl()])


class Pipelines:
    """Compiled pipelines for given features: the four stages of a step, and the check."""

    def __init__(self, device: Device, features: Features, precision: str) -> None:
        handle = device.handle
        visible = device.wgpu.ShaderStage.COMPUTE
        kinds = ["uniform", *["storage"] * 5, *["read-only-storage"] * 2, "storage"]
        entries = [
            {"binding": k, "visibility": visible, "buffer": {"type": kind}}
            for k, kind in enumerate(kinds)
        ]
        self.layout = handle.create_bind_group_layout(entries=entries)
        layout = handle.create_pipeline_layout(bind_group_layouts=[self.layout])
        module = handle.create_shader_module(code=step_wgsl(features, precision, device.float64))

        def pipeline(entry_point: str, constants: dict[str, float]) -> Any:
            compute = {"module": module, "entry_point": entry_point, "constants": constants}
            return handle.create_compute_pipeline(layout=layout, compute=compute)

        constants = features.override_constants()
        self.stages = [pipeline("advance", {**constants, "stage": k}) for k in (1, 2, 3, 4)]
        self.check = pipeline("check", constants)


pipelines = cache(Pipelines)  # compiling is slow


def check_scenes(scenes: Sequence[Scene]) -> None:
    """Raise a ValueError if the shader lacks a feature of a scene, or if the features of the scenes
    differ.
    """
    first = Features.of_scene(scenes[0])
    for member, scene in enumerate(scenes):
        for pin in scene.cloth.driven:
            raise ValueError(
                f"pins[{pin}] must be None with backend 'gpu', got a motion; backend='cpu' "
                "drives pins"
            )
        if scene.force is not None:
            raise ValueError(
                "force must be None with backend 'gpu', got an array; backend='cpu' has it"
            )
        for force in scene.core_forces:
            if force.name != "drag":
                raise ValueError(
                    f"{force.name} must be left out with backend 'gpu', whose shader has no such "
                    "force; backend='cpu' has it"
                )
        own = Features.of_scene(scene)
        for name, got in vars(own).items():
            expected = getattr(first, name)
            if got != expected:
                raise ValueError(
                    f"{name} of all members must be equal with backend 'gpu', where a dispatch "
                    f"serves all members: member 0 has {expected}, got {got} for member {member}; "
                    "step them apart, or with backend='cpu'"
                )


def rest_length_of_kinds(scene: Scene) -> list[float]:
    """Return rest lengths of the kinds of springs [m]."""
    height, width = scene.cloth.spacing
    along = [(columns * width, rows * height) for _, rows, columns in _core.spring_kinds]
    return [math.sqrt(c * c + r * r) for c, r in along]


def scene_parameters(scene: Scene, speed_limit: float, dtype: npt.DTypeLike) -> np.ndarray:
    """Return the entry of `parameters` for one member (layout.wgsl), with the speed above which its
    state has run away [m/s].
    """
    cloth = scene.cloth
    # 1/mass is folded into the coefficients where it is uniform, as in the core.
    scale = 1 / float(cloth.mass_per_point[0, 0]) if cloth.uniform_mass else 1.0
    numbers = [*scene.gravity, cloth.drag * scale, min(speed_limit, float(np.finfo(dtype).max))]
    for (family, *_), rest_length in zip(
        _core.spring_kinds, rest_length_of_kinds(scene), strict=True
    ):
        stiffness, damping = (
            values.get(family, 0.0) for values in (cloth.family_stiffness, cloth.family_damping)
        )
        numbers += [stiffness * scale, rest_length, damping * scale]
    weights = np.where(cloth.pinned, 0.0, 1 / cloth.mass_per_point)
    with np.errstate(over="ignore", under="ignore"):
        return np.concatenate([numbers, weights.ravel()]).astype(dtype)
