"""Numbers, a cloth and its spheres in words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from .scene import Scene


def cloth_text(scene: Scene) -> str:
    rows, columns = scene.cloth.shape
    return f"{rows} x {columns} mass points"


def spheres_text(scenes: Sequence[Scene]) -> str:
    """Number of spheres and their responses; for scenes with different numbers, the total."""
    found = {len(scene.spheres) for scene in scenes}
    if len(found) > 1:
        return f"{min(found)} to {max(found)} spheres"
    spheres = scenes[0].spheres
    if not spheres:
        return "no sphere"
    kinds = Counter(
        f"{'moving, ' if s.motion else ''}response {s.response}{' as printed' if s.as_printed else ''}" for s in spheres
    )
    parts = [kind if n == len(spheres) else f"{n} {kind}" for kind, n in kinds.items()]
    return f"{counted(len(spheres), 'sphere')} ({'; '.join(parts)})"


def joules(energies: Sequence[float]) -> list[str]:
    """Energies with their unit; rounding errors of the largest one print as 0."""
    rounding = 1e-15 * max(map(abs, energies))
    return [quantity(0.0 if abs(one) < rounding else one, "J") for one in energies]


def counted(number: int, noun: str) -> str:
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def quantity(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}"
