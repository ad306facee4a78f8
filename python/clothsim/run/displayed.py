"""Pictures and pages of a run, as methods of `Run`. The room `viewing` draws them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from .result import Run


class DisplayedRun:
    """Methods of `Run` that draw the run."""

    def picture(
        self,
        frame: int | None = None,
        t: float | None = None,
        path: str | Path | None = None,
        *,
        camera: Any = None,
        width: int = 640,
        color: Any = "faces",
        limits: tuple[float, float] | None = None,
        label: bool = False,
        ground: bool | float = True,
    ) -> Any:
        """Draw a stored frame; see `clothsim.picture`.

        All frames of a run are drawn from one view, so that two pictures can be compared.

        Parameters
        ----------
        frame : int, optional
            Index of the stored frame, negative from the end. Default: the last.
        t : float, optional
            Time [s], in place of `frame`. The nearest stored frame is drawn.
        path : path-like, optional
            File to write as well; see `Picture.save`.
        camera, width, color, limits, label, ground
            As for `clothsim.picture`. The view, the colour scale and the ground are those of all frames. An array as
            `color` has shape (rows, columns) or (frames, rows, columns).

        Returns
        -------
        Picture

        Raises
        ------
        ValueError, TypeError
            If an argument is not as above.

        Examples
        --------
        >>> import clothsim as cs
        >>> run = cs.simulate(cs.scenes.paper_static(), 0.02, dt=1e-3, every=10)
        >>> run.picture(t=0.01, width=200)
        <Picture of 200 x 141 pixels>
        """
        from ..viewing.picture import picture_of_run

        style = camera, width, color, limits, label, ground
        return picture_of_run(self, frame, t, path, *style)

    def plot(self, path: str | Path | None = None, *, log: bool = False) -> Any:
        """Draw energy, largest stretch, penetration and contacts over the stored frames.

        Penetration and contacts are drawn where the scene has a sphere. A contact is a mass point
        closer to a sphere than the contact radius and 1/32 of the spacing.

        Parameters
        ----------
        path : path-like, optional
            File to write as well, of a format that matplotlib knows.
        log : bool, default False
            Logarithmic axes of values, of four decades. An axis with smaller values is linear below them.

        Returns
        -------
        matplotlib.figure.Figure
            A notebook shows it.

        Raises
        ------
        ImportError
            Without matplotlib (extra "plot").
        ValueError, TypeError
            If the folder of `path` is missing, or `log` is not as above.

        Examples
        --------
        >>> import clothsim as cs
        >>> run = cs.simulate(cs.scenes.paper_static(), 0.1, dt=1e-3, fps=50)
        >>> [axes.get_ylabel() for axes in run.plot().axes]
        ['energy [J]', 'largest stretch [%]', 'penetration [mm]', 'points in contact']
        """
        from ..viewing.plots import plot_run

        return plot_run(self, path, log=log)

    def animate(
        self,
        path: str | Path,
        fps: float = 30.0,
        *,
        speed: float = 1.0,
        camera: Any = None,
        width: int = 640,
        color: Any = "faces",
        limits: tuple[float, float] | None = None,
        label: bool = False,
        ground: bool | float = True,
    ) -> Path:
        """Write a film of the run.

        Each picture shows the stored frame that is nearest in time. Run `simulate` with ``every=speed / fps`` to store
        the frames that a smooth film needs.

        Parameters
        ----------
        path : path-like
            Ends in ".gif", ".webp" (both by Pillow, extra "plot") or ".mp4" (H.264, by the program ffmpeg or the extra
            "film").
        fps : float, default 30
            Pictures a second, > 0, at most 240, of a GIF at most 50: browsers slow down more.
        speed : float, default 1.0
            Simulated seconds in a second of the film, > 0.
        camera, width, color, limits, label, ground
            As for `clothsim.picture`. The view, the colour scale and the ground are fixed and hold every frame. An array
            as `color` has shape (rows, columns) or (frames, rows, columns).

        Returns
        -------
        pathlib.Path
            The file written.

        Raises
        ------
        ValueError, TypeError
            If an argument is not as above, or the run has fewer than 3 frames.
        ImportError
            Without Pillow.
        RuntimeError
            Without ffmpeg, or if ffmpeg fails.

        Examples
        --------
        >>> import tempfile, clothsim as cs
        >>> run = cs.simulate(cs.scenes.paper_swing(), 0.1, dt=1e-3, fps=50)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     run.animate(folder + "/swing.gif", fps=25, width=64).name
        'swing.gif'
        """
        from ..viewing.animation import animate

        style = camera, width, color, limits, label, ground
        return animate(self, path, fps, speed, *style)

    def to_html(self, path: str | Path, *, title: str | None = None) -> Path:
        """Write one self-contained page that plays the run in a browser.

        The page makes no request. It plays, seeks, turns by mouse, and colours by stretch, speed or
        depth below a sphere. Curves show energy, stretch, penetration and contacts. Positions are
        rounded to 1/65535 of the run's extent on each axis. 300 frames of 32 x 32 take 1.1 MB.

        Parameters
        ----------
        path : path-like
            File to write.
        title : str, optional
            Heading of the page. Default: the name of a ready scene, or the shape of the cloth and the responses of its
            spheres.

        Returns
        -------
        pathlib.Path
            The file written.

        Raises
        ------
        ValueError, TypeError
            If the folder is missing, or `path` is no path.

        See Also
        --------
        clothsim.compare : plays several runs side by side.

        Examples
        --------
        >>> import tempfile, clothsim as cs
        >>> run = cs.simulate(cs.scenes.paper_static(), 0.1, dt=1e-3, every=5)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = run.to_html(folder + "/run.html")
        ...     path.name, path.stat().st_size < 500_000
        ('run.html', True)
        """
        from ..viewing.page import run_to_html

        return run_to_html(cast("Run", self), path, title)

    def show(self, *, height: int = 760) -> Any:
        """Play the run in a notebook: the page of `to_html` in a frame of the cell.

        The notebook keeps the frames when it is saved, and plays them where it is trusted.

        Parameters
        ----------
        height : int, default 760
            Height of the frame [pixels], 300 to 4000.

        Returns
        -------
        object
            A notebook displays it.

        Raises
        ------
        ValueError, TypeError
            If `height` is not as above.

        Examples
        --------
        >>> import clothsim as cs
        >>> run = cs.simulate(cs.scenes.paper_swing(), 0.1, dt=1e-3, fps=50)
        >>> frame = run.show(height=500)  # the last line of a notebook's cell
        """
        from ..viewing.page import run_to_frame

        return run_to_frame(cast("Run", self), height)

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        """The lines of `print`, and a picture of the last frame, for a notebook."""
        from ..viewing.notebook import run_bundle

        return run_bundle(cast("Run", self))
