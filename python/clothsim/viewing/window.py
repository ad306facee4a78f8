"""The function `view`, which opens the live viewer."""

from __future__ import annotations

import socket
from typing import Any

from ..base import check
from ..base.extras import needed
from ..base.keywords import suggests
from ..model.scene import Scene
from .live import Viewer
from .playground import Playground


@suggests
def view(
    scene: Scene,
    block: bool = True,
    *,
    dt: float | None = None,
    integrator: str = "rk4",
    precision: str = "double",
    host: str = "127.0.0.1",
    port: int = 8080,
) -> Any:
    """Step a scene live, in the browser, while you change it.

    The core steps in real time where the machine is fast enough, or in slow motion; the page shows the speed. Controls set
    the integrator, the time step, the cloth, gravity and the spheres. You can drag spheres and pins; a contact includes
    the velocity of the drag. The cloth is coloured by stretch, speed or depth on request, and its parts inside a sphere
    are red. A click on a mass point shows its values. The browser saves the scene, or a recording of it.

    The page shows the guaranteed stable step, the term that limits it, and a time step above it. A run that becomes
    unstable says so and stops.

    Parameters
    ----------
    scene : Scene
    block : bool, default True
        Serve until Ctrl-C. False returns the viewer at once.
    dt : float, optional
        Time step [s]. Default: it follows the machine. It is the paper's 5 us, or the smallest of 10, 20, 50, ... us with
        which the machine keeps up. It is at most half of the guaranteed stable step.
    integrator, precision : str
        As for `clothsim.Stepper`.
    host : str, default "127.0.0.1"
        Address to serve at. The default serves this machine alone. "0.0.0.0" serves every machine that can reach this
        one. Each of them that has the token can change the scene, and the connection is not encrypted.
    port : int, default 8080
        Port to serve at; the next free one if it is taken.

    Returns
    -------
    Viewer or None
        With `block` False, a viewer with ``.url``, ``.recorded()`` (the recording as a `Run`), ``.scene()`` (the scene as
        it is now) and ``.stop()``. The address ends with a token, without which a browser is refused.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.
    ImportError
        Without viser (extra "view").
    RuntimeError
        If this version of viser gives no place to check its clients.

    Warns
    -----
    RuntimeWarning
        If `host` lets other machines reach the viewer.

    Examples
    --------
    >>> import clothsim as cs
    >>> viewer = cs.view(cs.scenes.paper_static(), block=False)  # doctest: +SKIP
    >>> run = viewer.recorded()  # doctest: +SKIP
    >>> viewer.stop()  # doctest: +SKIP
    """
    block = check.boolean("block", block)
    port = check.integer("port", port, minimum=1, maximum=65535)
    if not isinstance(host, str):
        raise TypeError(f"host must be a name or address, got {host!r} ({type(host).__name__})")
    _check_host(host)
    needed("viser", "the live viewer", "view")
    viewer = Viewer(Playground(scene, dt, integrator, precision), host, port)
    if not block:
        return viewer
    print(f"Live at {viewer.url} - Ctrl-C ends it")
    try:
        while True:
            viewer._over.wait(3600.0)
    except KeyboardInterrupt:
        viewer.stop()
    return None


def _check_host(host: str) -> None:
    """Refuse an address at which this machine cannot serve: viser would wait for ever."""
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as trial:
            trial.bind(address)
    except (OSError, UnicodeError) as error:
        raise ValueError(
            f"host must be a name or address of this machine, such as '127.0.0.1' or '0.0.0.0', got {host!r}: {error}"
        ) from None
