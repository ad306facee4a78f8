"""Looking at a cloth: pictures, plots, films, pages and the live viewer."""

from __future__ import annotations

from typing import Any

from ..base.keywords import suggests


@suggests
def view(
    scene: Any,
    block: bool = True,
    *,
    dt: float | None = None,
    integrator: str = "rk4",
    precision: str = "double",
    host: str = "127.0.0.1",
    port: int = 8080,
) -> Any:
    """Step a scene live, in the browser, while you change it.

    The core steps in real time; the page shows how much of it the machine holds. Sliders set the
    stiffness of each family, damping, gravity, the time step, and response, offset, restitution,
    friction and radius of the spheres. Spheres and pins can be dragged: a contact sees the velocity
    of the drag. The page tells the guaranteed stable step and the term that limits it. A run that
    becomes unstable says so and stops.

    Parameters
    ----------
    scene : Scene
    block : bool, default True
        Serve until Ctrl-C. False returns the viewer at once.
    dt : float, optional
        Time step [s]. Default: the paper's 5 us, or the smallest of 10, 20, 50, ... us with which
        the machine keeps up. It is at most half of the guaranteed stable step.
    integrator, precision : str
        As for `clothsim.Stepper`.
    host : str, default "127.0.0.1"
        Address to serve at: this machine alone. "0.0.0.0" serves to every machine that can reach it;
        each of them can then change the scene.
    port : int, default 8080
        Port to serve at; the next free one if it is taken.

    Returns
    -------
    Viewer or None
        With `block` False: ``.url``, ``.recorded()`` (a `Run` of what was recorded) and ``.stop()``.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.
    ImportError
        Without viser (extra "view").

    Examples
    --------
    >>> import clothsim as cs
    >>> viewer = cs.view(cs.scenes.paper_static(), block=False)  # doctest: +SKIP
    >>> run = viewer.recorded()  # doctest: +SKIP
    >>> viewer.stop()  # doctest: +SKIP
    """
    from . import live

    return live.view(scene, block, dt=dt, integrator=integrator, precision=precision, host=host, port=port)
