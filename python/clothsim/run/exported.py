"""A run as files of other programs; the room `viewing` writes them."""

from __future__ import annotations

import os
from pathlib import Path


class ExportedRun:
    """Methods of `Run` that write files of other programs."""

    def export(self, path: str | os.PathLike[str], fps: float | None = None, z_up: bool = False) -> list[Path]:
        """Write the run as files for other programs, in the format that the suffix names.

        ===================  ====================================================================
        Suffix               Files
        ===================  ====================================================================
        .usdc, .usda         OpenUSD: a mesh with time samples, sphere prims; needs usd-core
        .glb                 Binary glTF: every frame is a morph target, spheres are meshes
        .obj                 A sequence name_0001.obj, ...; the spheres are further objects
        .ply                 A sequence name_0001.ply, ...; name_sphere_0_0001.ply, ... for spheres
        .pvd                 VTK: an index name.pvd, and name_0001.vtp, ... for cloth and spheres
        .pc2                 A point cache, and the mesh of the first frame as .obj beside it
        ===================  ====================================================================

        Vertices of the cloth are the mass points in the order of the array index, ``row * columns + column``.
        Triangles are those of `triangles`: normals of the flat sheet point up. Texture coordinates
        run from 0 to 1: u along the columns, v from the last row to the first. Lengths are in
        metres. The how-to docs/export.md shows how to open the files.

        Parameters
        ----------
        path : path-like
            File to write, in a folder that exists. New files replace files of the same names once
            all are complete. A failed export changes nothing.
        fps : float, optional
            Frames a second [1/s], > 0, at most 1e5. The first frame is the start of the run. Cubic Hermite
            interpolation of positions and velocities gives frames between stored frames.
            Default: the stored frames at their own times.
        z_up : bool, default False
            Whether (x, y, z) is written as (x, -z, y), for programs where z is up. A .glb is
            always y up.

        Returns
        -------
        list of pathlib.Path
            The files written. The first is the file to open.

        Raises
        ------
        ValueError, TypeError
            If an argument is not as above, or stored frames are too far apart to interpolate.
        ImportError
            Without the package that the format needs, naming the extra that brings it.
        OSError
            If a file cannot be written.

        Warns
        -----
        UserWarning
            If interpolation may be wrong by more than a tenth of the grid spacing.

        Notes
        -----
        Stored frames lie h seconds apart. The error of a smooth motion between them is at most
        h^4 / 384 times its largest fourth derivative (de Boor, *A Practical Guide to Splines*).
        An impact that changes a velocity by u adds at most `h |u| / 8`.

        A check interpolates each stored frame from its two neighbours. The gap there is twice as
        long, so the distance to the stored positions overestimates the error. The factor is 16
        where the motion is smooth, and 2 at an impact. The check refuses a distance above the grid
        spacing. It also refuses a run without a stored frame between first and last.

        Examples
        --------
        >>> import tempfile, clothsim as cs
        >>> run = cs.simulate(cs.scenes.paper_static(), 0.1, dt=1e-3, fps=60)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     [file.name for file in run.export(folder + "/cloth.pc2")]
        ['cloth.pc2', 'cloth.obj']
        """
        from ..viewing.exports import export

        return export(self, path, fps, z_up)
