"""The shader of a scene: its features, and pipelines that contain only these features."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from ..model.cloth import FAMILIES
from ..model.scene import Scene
from .device import Device, translated
from .parameters import shared_numbers
from .springs import spring_energies, springs

STAGES = (1, 2, 3, 4)
RESPONSES = ("reflect", "ray", "continuous")  # of contact.wgsl and continuous.wgsl


@dataclass(frozen=True)
class SphereFeatures:
    """Features of a sphere's response."""

    response: str
    as_printed: bool
    rough: bool


@dataclass(frozen=True)
class Features:
    """Features of a scene; scenes of equal features share pipelines and dispatches."""

    families: tuple[str, ...]
    spring_damping: bool
    drag: bool
    mass_per_point: bool
    pinned: bool
    moving: bool
    spheres: tuple[SphereFeatures, ...]

    @classmethod
    def of(cls, scene: Scene) -> Features:
        cloth = scene.cloth
        return cls(
            families=cloth.families,
            spring_damping=any(cloth.family_damping.values()),
            drag=cloth.drag > 0,
            mass_per_point=not cloth.uniform_mass,
            pinned=bool(cloth.pinned.any()),
            moving=any(sphere.motion is not None for sphere in scene.spheres),
            spheres=tuple(SphereFeatures(s.response, s.as_printed, s.friction > 0) for s in scene.spheres),
        )

    def constants(self, strict: bool) -> dict[str, float]:
        """Values of the shader's override constants."""
        switches: dict[str, bool] = {family: family in self.families for family in FAMILIES}
        for name in ("spring_damping", "drag", "mass_per_point", "pinned", "moving"):
            switches[name] = getattr(self, name)
        return {name: float(on) for name, on in {**switches, "strict": strict}.items()}

    @property
    def continuous(self) -> tuple[int, ...]:
        """Places of the spheres whose response is continuous."""
        return tuple(k for k, s in enumerate(self.spheres) if s.response == "continuous")

    def after_contacts(self) -> str:
        """WGSL of the collision pass: spheres with "reflect" or "ray" in their order, then the continuous spheres."""

        def word(flag: bool) -> str:
            return "true" if flag else "false"

        lines = [
            "fn after_contacts(body: Body, before: Body, id: vec3<u32>) -> Body {",
            "    var result = body;",
            "    if (!is_pinned(id)) {",
        ]
        for k, s in enumerate(self.spheres):
            if k not in self.continuous:
                flags = ", ".join(map(word, (s.response == "ray", s.as_printed, s.rough)))
                met = f"met(result, contact_of(id.z, {k}u), id.z, {flags})"
                lines.append(f"        result = {met};")
        lines.append("    }")
        if self.continuous:
            lines.append("    result = after_continuous(result, before, id);")
        lines += ["    return result;", "}"]
        if self.continuous:
            lines += _choice("continuous_spheres", "swept_sphere", self.continuous)
        return "\n".join(lines)


def _choice(count: str, name: str, places: tuple[int, ...]) -> list[str]:
    """WGSL with the number of spheres of a kind, and a function that returns the k-th of them."""
    return [
        f"const {count} = {len(places)}u;",
        f"fn {name}(member: u32, k: u32) -> Swept {{",
        *(f"    if (k == {n}u) {{ return swept_of(member, {place}u); }}" for n, place in enumerate(places[1:], start=1)),
        f"    return swept_of(member, {places[0]}u);",
        "}",
    ]


@cache
def shader_text(name: str) -> str:
    """The text of shaders/`name`.wgsl."""
    return files(__package__).joinpath("shaders", f"{name}.wgsl").read_text(encoding="utf-8")


def arithmetic_file(precision: str, float64: bool) -> str:
    """The file that defines the arithmetic of a precision."""
    if precision == "double":
        return "double"
    return "single" if float64 else "single_f32"


def source(features: Features, precision: str, float64: bool) -> str:
    """The whole WGSL of a step."""
    names = [arithmetic_file(precision, float64), "layout", "contact", "step", "check"]
    written = [shared_numbers(), springs(), features.after_contacts()]
    if features.continuous:
        names += ["continuous", "left_over"]
        written.append(spring_energies())
    return "\n".join([*map(shader_text, names), *written])


class Pipelines:
    """Compiled pipelines for given features: the four stages of a step, the contact passes and the check."""

    def __init__(self, device: Device, features: Features, precision: str, strict: bool) -> None:
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

            constants = features.constants(strict)
            self.stages = [pipeline("advance", {**constants, "stage": k}) for k in STAGES]
            self.check = pipeline("check", {})
            self.settle = None
            if features.continuous:
                self.settle = pipeline("settle", {**constants, "stage": 4})


def pipelines(device: Device, features: Features, precision: str, strict: bool) -> Pipelines:
    """Pipelines of `features`, compiled at most once for a device."""
    key = (features, precision, strict)
    if key not in device.pipelines:
        device.pipelines[key] = Pipelines(device, features, precision, strict)
    found: Pipelines = device.pipelines[key]
    return found
