"""The whole state of a simulation at one moment, in memory and in a file."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..base import check
from ..base import files as _files
from ..base.build import build_config
from ..model.scene import Scene
from .options import Options

SCHEMA = 5
_FIELD = "snapshot_"  # prefix of the arrays that are fields of the core


@dataclass(frozen=True, eq=False, repr=False)
class Snapshot:
    """A simulation at one moment, to be continued bit for bit.

    It has the scene, the options and the whole state, the compensation of "single" included.
    `Stepper.restore` continues it. Two snapshots are equal only if they are the same object.

    Examples
    --------
    >>> one = cs.Stepper(cs.scenes.paper_swing(), precision="single")
    >>> one.advance(10, 1e-4)
    >>> other = cs.Stepper.restore(one.snapshot())
    >>> one.advance(10, 1e-4); other.advance(10, 1e-4)
    >>> bool((one.x == other.x).all())
    True
    """

    scene: Scene | Sequence[Scene]  # scene, or scenes of a batch
    options: Options
    shape: tuple[int, ...]
    dtype: str
    core: dict[str, Any]
    forced: bool = False  # whether a function acts, which is no data

    @property
    def time(self) -> float:
        """Time of the state [s]."""
        return float(self.core["time"])

    def __repr__(self) -> str:
        size = " x ".join(map(str, self.shape[:-1]))
        options = self.options
        return (
            f"<Snapshot of {size} mass points at t = {self.time:g} s ({options.integrator}, "
            f"{options.precision})>"
        )

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the snapshot to a .npz file that `load` reads.

        Parameters
        ----------
        path : path-like
            Ends in ".npz", which is added if there is no suffix. An existing file is replaced.

        Examples
        --------
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     cs.Stepper(cs.scenes.paper_swing()).snapshot().save(folder + "/start").name
        'start.npz'
        """
        return _files.write_npz(_files.npz_path(path), snapshot_to_arrays(self))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Snapshot:
        """Read a snapshot that `save` wrote. Nothing in the file is executed.

        Parameters
        ----------
        path : path-like

        Examples
        --------
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     start = cs.Stepper(cs.scenes.oscillator()).snapshot()
        ...     cs.Snapshot.load(start.save(folder + "/start")).time
        0.0
        """
        arrays = _files.read_npz(path, "snapshot", ("snapshot",))
        with _files.explain_unreadable_file(path, "snapshot"):
            return snapshot_from_arrays(arrays)


def snapshot_to_arrays(snapshot: Snapshot) -> dict[str, Any]:
    """Return the arrays of a file: the text "snapshot" (JSON), and the fields of the core.

    The name of each field begins with "snapshot_".
    """
    scene = snapshot.scene
    header = {
        "schema": SCHEMA,
        "version": build_config()["version"],
        "scene": scene.to_dict() if isinstance(scene, Scene) else [s.to_dict() for s in scene],
        "arguments": asdict(snapshot.options),
        "shape": list(snapshot.shape),
        "dtype": snapshot.dtype,
        "forced": snapshot.forced,
    }
    return {"snapshot": json.dumps(header)} | {
        _FIELD + name: value for name, value in snapshot.core.items()
    }


def snapshot_from_arrays(arrays: dict[str, np.ndarray]) -> Snapshot:
    """Make a snapshot from the arrays that `snapshot_to_arrays` returned."""
    header = json.loads(str(arrays["snapshot"]))
    if header["schema"] != SCHEMA:
        raise ValueError(f"its schema must be {SCHEMA}, got {header['schema']!r}")
    data = header["scene"]
    scene = list(map(Scene.from_dict, data)) if isinstance(data, list) else Scene.from_dict(data)
    core = {
        name.removeprefix(_FIELD): value
        for name, value in arrays.items()
        if name.startswith(_FIELD)
    }
    if "time" not in core:
        raise ValueError("it lacks the fields of the state")
    for name in {"positions", "velocities"} & set(core):
        check.check_all(name, core[name], np.isfinite(core[name]), "finite numbers")
    return Snapshot(
        scene=scene,
        options=Options(**header["arguments"]),
        shape=tuple(header["shape"]),
        dtype=str(header["dtype"]),
        core=core,
        forced=bool(header["forced"]),
    )


def make_snapshot(
    state: Any, scene: Scene | Sequence[Scene], options: Options, core: dict[str, Any] | None = None
) -> Snapshot:
    """Make a snapshot of a state, or of the member whose fields are `core`."""
    return Snapshot(
        scene=scene,
        options=options,
        shape=state.shape if core is None else state.shape[-3:],
        dtype=state.dtype.str,
        core=state.core.snapshot() if core is None else core,
        forced=state.forced,
    )


def fields_of_members(core: dict[str, Any], scenes: Sequence[Scene]) -> list[dict[str, Any]]:
    """Split the fields of a batch into those that each member would have on its own."""
    parts = []
    spheres = contacts = 0
    for k, scene in enumerate(scenes):
        part = {
            name: value[k : k + 1].copy() if isinstance(value, np.ndarray) else value
            for name, value in core.items()
        }
        # Three fields have an entry for each obstacle of each member.
        end = spheres + len(scene.spheres)
        for name in ("impulses", "normals"):
            part[name] = core[name][spheres:end].copy()
        spheres = end
        end = contacts + len(scene.spheres) * scene.has_layers
        part["contacts"] = core["contacts"][contacts:end].copy()
        contacts = end
        parts.append(part)
    return parts
