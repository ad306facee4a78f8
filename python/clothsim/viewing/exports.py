"""`Run.export`: write a run as files for other programs."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..base import check, files
from ..base.extras import needed
from ..base.on_demand import module_of
from ..base.progress import ProgressBar
from .clip import Clip

# Module of `formats`, and the package that it needs beyond NumPy.
_FORMATS: dict[str, tuple[str, str | None]] = {
    ".usdc": ("usd", "pxr"),
    ".usda": ("usd", "pxr"),
    ".glb": ("gltf", None),
    ".obj": ("sequences", None),
    ".ply": ("sequences", None),
    ".pvd": ("vtk", None),
    ".pc2": ("caches", None),
}
SUFFIXES = tuple(_FORMATS)
MOST_FPS = 1e5  # frames/s


@dataclass(frozen=True)
class Target:
    """The target of an export, checked before any work."""

    path: Path
    module: Any
    z_up: bool
    fps: float | None

    @classmethod
    def of(cls, scene: Any, path: Any, fps: float | None, z_up: bool, name: str = "path") -> Target:
        """Check the arguments of an export of a run of `scene`; `name` names the argument of `path` in messages."""
        path = check.path(name, path, "a file name")
        suffix = path.suffix.lower()
        if suffix not in _FORMATS:
            raise ValueError(f"{name} must end in one of {', '.join(SUFFIXES)}, got {str(path)!r}")
        if not path.parent.is_dir():
            raise ValueError(f"{name} must be in an existing folder, got {str(path)!r}")
        if fps is not None:
            fps = check.number("fps", fps, minimum=0, exclusive=True, maximum=MOST_FPS)
        z_up = check.boolean("z_up", z_up)
        if z_up and suffix == ".glb":
            raise ValueError("z_up must be False for .glb, where y is always up: importers turn it, Blender's too")
        if min(scene.cloth.shape) < 2:
            raise ValueError(
                f"{name} {str(path)!r} needs a surface, a cloth of at least 2 x 2 mass points, got shape {scene.cloth.shape}"
            )
        module, package = _FORMATS[suffix]
        if package is not None:
            needed(package, f"export to {suffix}", "export")
        return cls(path, module_of(f"clothsim.viewing.formats.{module}"), z_up, fps)


def export(
    run: Any, path: str | os.PathLike[str], fps: float | None = None, z_up: bool = False, progress: bool = False
) -> list[Path]:
    """`Run.export`: the files, moved to their places once all are complete. With `progress`, a bar counts frames."""
    target = Target.of(run.scene, path, fps, z_up)
    clip = Clip(run, target.fps, target.z_up)
    with (
        ProgressBar(progress, total=len(clip), unit="frame", desc="export") as bar,
        files.folder_beside(target.path) as folder,
    ):
        clip.advance = bar.advance
        return files.put(target.module.write(clip, folder / target.path.name), target.path.parent)
