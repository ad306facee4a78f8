"""The shader of a scene: its features, and pipelines that contain only these features."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import groupby
from typing import Any

from .. import _core
from ..model.as_core import in_cells
from ..model.cloth import FAMILIES
from ..model.scene import Scene
from .device import Device, translated
from .parameters import shared_numbers

Neighbour = tuple[int, int, str, int]
"""Rows and columns on, family, and the kind of spring, whose coefficients are equal."""


def springs(neighbours: Sequence[Neighbour] = _core.neighbours) -> str:
    """WGSL of the override constants of the families and of a mass point's spring forces, from cpp/model/stencil.hpp.

    The forces add up in the order of `neighbours`, which is part of their bits.
    """
    families = dict.fromkeys(family for _, _, family, _ in neighbours)
    return "\n".join(
        [
            "// From cpp/model/stencil.hpp.",
            *(f"override {family}: bool = true;" for family in families),
            "",
            "fn spring_forces(id: vec3<u32>, x: vec3<real>, v: vec3<real>) -> vec3<real> {",
            "    let first = id.z * constants.parameter_stride + first_spring;",
            "    let columns = constants.columns;",
            "    let at = place(id);",
            "    var a = vec3<real>();",
            *_by_family(neighbours),
            "    return a;",
            "}",
        ]
    )


def _by_family(neighbours: Iterable[Neighbour]) -> list[str]:
    lines = []
    for family, group in groupby(neighbours, lambda neighbour: neighbour[2]):
        lines.append(f"    if ({family}) {{")
        lines += [f"        {_pull(row, column, kind)}" for row, column, _, kind in group]
        lines.append("    }")
    return lines


def _pull(row: int, column: int, kind: int) -> str:
    inside = [*_inside("id.y", row, "constants.rows"), *_inside("id.x", column, "columns")]
    place = f"at{_offset(row, 'columns')}{_offset(column)}"
    return f"if ({' && '.join(inside)}) {{ a = pulled(a, x, v, {place}, first + {3 * kind}u); }}"


def _inside(coordinate: str, way: int, end: str) -> list[str]:
    """Whether the neighbour is in the cloth, along one axis."""
    if way > 0:
        return [f"{coordinate} + {way}u < {end}"]
    return [f"{coordinate} >= {-way}u"] if way else []


def _offset(way: int, stride: str = "") -> str:
    if not way:
        return ""
    size = stride if stride and abs(way) == 1 else f"{abs(way)}u{f' * {stride}' if stride else ''}"
    return f" {'+' if way > 0 else '-'} {size}"


STAGES = (1, 2, 3, 4)
ROUNDS = (5, 6, 7)  # stages of `raise`: from b to a, from a to b, and the last, from b to the state


@dataclass(frozen=True)
class SphereFeatures:
    """Features of a sphere's response."""

    response: str
    as_printed: bool
    rough: bool


@dataclass(frozen=True)
class Features:
    """Features of a scene; all members of a batch have equal features, so that a dispatch serves all of them."""

    families: tuple[str, ...]
    spring_damping: bool
    drag: bool
    mass_per_point: bool
    pinned: bool
    moving: bool
    cells: bool
    spheres: tuple[SphereFeatures, ...]

    @classmethod
    def of(cls, scene: Scene) -> Features:
        cloth = scene.cloth
        return cls(
            families=cloth.springs,
            spring_damping=any(cloth.family_damping.values()),
            drag=cloth.drag > 0,
            mass_per_point=not cloth.uniform_mass,
            pinned=bool(cloth.pinned.any()),
            moving=any(sphere.motion is not None for sphere in scene.spheres),
            cells=any(map(in_cells, scene.spheres)),
            spheres=tuple(
                SphereFeatures(s.response, s.as_printed, s.response != "continuous" and s.friction > 0)
                for s in scene.spheres
            ),
        )

    def constants(self) -> dict[str, float]:
        """Values of the shader's override constants."""
        switches: dict[str, bool] = {family: family in self.families for family in FAMILIES}
        for name in ("spring_damping", "drag", "mass_per_point", "pinned", "moving", "cells"):
            switches[name] = getattr(self, name)
        return {name: float(on) for name, on in switches.items()}

    def after_contacts(self) -> str:
        """WGSL of the collision pass: the classic responses of spheres in their order, then the continuous one."""
        continuous = [k for k, s in enumerate(self.spheres) if s.response == "continuous"]
        lines = [shader_text("continuous").replace("continuous_sphere", f"{k}u") for k in continuous]
        lines += ["fn after_contacts(body: Body, before: Body, id: vec3<u32>) -> Body {", "    var result = body;"]
        lines.append("    if (!is_pinned(id)) {")
        for k, s in enumerate(self.spheres):
            if k not in continuous:
                flags = ", ".join(str(flag).lower() for flag in (s.response == "ray", s.as_printed, s.rough))
                lines.append(f"        result = respond(result, contact_of(id.z, {k}u, 0u), id.z, {flags});")
        lines += ["    }", *["    result = respond_continuously(result, before, id);"] * len(continuous)]
        return "\n".join([*lines, "    return result;", "}"])


@cache
def shader_text(name: str) -> str:
    """The text of shaders/`name`.wgsl."""
    return files(__package__).joinpath("shaders", f"{name}.wgsl").read_text(encoding="utf-8")


_KEEP = {"f32": "bitcast<f32>(bitcast<u32>(a) | z)", "f64": "bitcast<f64>(bitcast<u64>(a) | u64(z))"}
_EXPONENT = {"f32": ("bitcast<u32>(a)", "0x7f800000u"), "f64": ("u32(bitcast<u64>(a) >> 32u)", "0x7ff00000u")}


def keep(word: str, name: str = "keep", zero: str = "constants.zero") -> str:
    """WGSL of a function that returns its argument of type `word`, and hides that from the compiler.

    The value passes through integers and a zero from a buffer. So the compiler cannot replace (a + b) - a by b, and
    cannot fuse a product with a sum.
    """
    return f"fn {name}(a: {word}) -> {word} {{ let z = {zero}; return {_KEEP[word]}; }}"


def arithmetic_of(precision: str, float64: bool) -> str:
    """WGSL of the types of a precision and of their products: `real` of a step, `wide` of a response. "single" is
    compensated float32."""
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
        vector, scaled = f"vec3<{word}>", ", ".join(f"{prefix}product(a, b.{k})" for k in "xyz")
        x, y, z = (f"{prefix}product(a.{k}, b.{k})" for k in "xyz")
        lines += [
            keep(word, f"{prefix}keep"),
            f"fn {prefix}product(a: {word}, b: {word}) -> {word} {{ return {prefix}keep(a * b); }}",
            f"fn {prefix}scaled(a: {word}, b: {vector}) -> {vector} {{ return {vector}({scaled}); }}",
            f"fn {prefix}inner(a: {vector}, b: {vector}) -> {word} {{ return ({x} + {y}) + {z}; }}",
        ]
    lines.append("fn keep_all(a: vec3<real>) -> vec3<real> { return vec3<real>(keep(a.x), keep(a.y), keep(a.z)); }")
    return "\n".join(lines)


def source(features: Features, precision: str, float64: bool) -> str:
    """The whole WGSL of a step."""
    names = ["layout", "contact", "wide" if float64 else "narrow", "step", "check"]
    written = [arithmetic_of(precision, float64), shared_numbers(), springs()]
    return "\n".join([*written, *map(shader_text, names), features.after_contacts()])


class Pipelines:
    """Compiled pipelines for given features: the four stages of a step, the rounds of `raise`, and the check."""

    def __init__(self, device: Device, features: Features, precision: str) -> None:
        handle = device.handle
        visible = device.wgpu.ShaderStage.COMPUTE
        kinds = ["uniform", *["storage"] * 5, *["read-only-storage"] * 2, "storage"]
        with translated(device.adapter):
            self.layout = handle.create_bind_group_layout(
                entries=[{"binding": k, "visibility": visible, "buffer": {"type": kind}} for k, kind in enumerate(kinds)]
            )
            layout = handle.create_pipeline_layout(bind_group_layouts=[self.layout])
            code = source(features, precision, device.float64)
            module = handle.create_shader_module(code=code)

            def pipeline(entry_point: str, constants: dict[str, float]) -> Any:
                compute = {"module": module, "entry_point": entry_point, "constants": constants}
                return handle.create_compute_pipeline(layout=layout, compute=compute)

            constants = features.constants()
            self.stages = [pipeline("advance", {**constants, "stage": k}) for k in STAGES]
            self.rounds = [pipeline("raise", {**constants, "stage": k}) for k in ROUNDS if features.cells]
            self.check = pipeline("check", {})


def pipelines(device: Device, features: Features, precision: str) -> Pipelines:
    """Pipelines of `features`, compiled at most once for a device."""
    key = (features, precision)
    if key not in device.pipelines:
        device.pipelines[key] = Pipelines(device, features, precision)
    found: Pipelines = device.pipelines[key]
    return found


def check_scenes(scenes: Sequence[Scene]) -> None:
    """Raise a ValueError if the shader lacks a feature of a scene, or if the features of the scenes differ."""
    first = Features.of(scenes[0])
    for member, scene in enumerate(scenes):
        if scene.cloth.driven:
            pin = next(iter(scene.cloth.driven))
            raise ValueError(f"pins[{pin}] must be None with backend 'gpu', got a motion; backend='cpu' drives pins")
        if scene.force is not None:
            raise ValueError("force must be None with backend 'gpu', got an array; backend='cpu' has it")
        continuous = [k for k, sphere in enumerate(scene.spheres) if sphere.response == "continuous"]
        if len(continuous) > 1:
            raise ValueError(
                "response of at most one sphere can be 'continuous' with backend 'gpu', got "
                f"spheres {continuous}; backend='cpu' has several"
            )
        own = Features.of(scene)
        for name in first.__dataclass_fields__:
            expected, got = getattr(first, name), getattr(own, name)
            if got != expected:
                raise ValueError(
                    f"{name} of all members must be equal with backend 'gpu', where a dispatch serves all members: "
                    f"member 0 has {expected}, got {got} for member {member}; step them apart, or with backend='cpu'"
                )
