"""The live viewer: a `Playground` in the browser, by viser (extra "view").

viser serves the page and keeps it in step over a websocket. One thread here steps and draws 30
times a second. Actions in the browser arrive on other threads and wait for the playground's lock. For a client that
reads slowly, viser keeps the newest value of each thing and drops old pictures.
"""

from __future__ import annotations

import atexit
import math
import socket
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread
from time import perf_counter
from typing import Any

from ..base import check
from ..base.extras import needed
from ..base.keywords import suggests
from ..model.scene import Scene
from ..run.result import Run
from .controls import Controls
from .gate import Gate, accepts
from .playground import Playground
from .stage import Stage

FPS = 30.0  # pictures a second
STEPPING = 0.7  # part of the time between two pictures that stepping may take; drawing needs the rest
CURVE_RATE = 10.0  # entries of a curve in a second of wall time
STATUS_RATE = 5.0  # texts in a second of wall time


class Viewer:
    """A live viewer that runs until `stop`; made by `clothsim.view`.

    Attributes
    ----------
    url : str
        Address of the page, with its token. A browser without the token is refused.
    playground : Playground
        The scene, its stepper and its clock.
    """

    def __init__(self, playground: Playground, host: str, port: int) -> None:
        viser = needed("viser", "the live viewer", "view")
        self.playground, self._gate = playground, Gate(host)
        self.server = _served(viser, self._gate, host, port)
        shown = "localhost" if host in ("127.0.0.1", "0.0.0.0", "::") else f"[{host}]" if ":" in host else host
        self.url = f"http://{shown}:{self.server.get_port()}/?token={self._gate.token}"
        if self._gate.public:
            warnings.warn(
                f"host={host!r} lets other machines reach the live viewer: who has its address with the token can "
                "change the scene, and the connection is not encrypted. host='127.0.0.1' serves this machine alone",
                RuntimeWarning,
                stacklevel=4,
            )
        self._over = Event()
        self.stage = Stage(self.server, playground, self._attempt)
        self.controls = Controls(viser, self.server, playground, self.stage, self._attempt)
        self._gate.admit(
            {handle._impl.uuid: accepts(handle) for handle in self.controls.inputs},
            {handle.name for handle in (*self.stage.gizmos, *self.stage.pin_gizmos)},
        )
        self.server.on_client_disconnect(self.stage.let_go)
        self.server.scene.on_click()(lambda event: self.stage.pick(event.ray_origin, event.ray_direction))
        self._thread = Thread(target=self._loop, name="clothsim view", daemon=True)
        self._thread.start()
        atexit.register(self.stop)  # a thread inside the core must not outlive the interpreter

    def _attempt(self, action: Callable[[], None]) -> bool:
        """Do an action and return whether it succeeded; a refusal is shown in the browser."""
        try:
            action()
        except (ValueError, TypeError, ArithmeticError) as error:
            for client in self.server.get_clients().values():
                client.add_notification("Not possible", str(error), auto_close_seconds=8.0)
            return False
        return True

    def _loop(self) -> None:
        last = perf_counter()
        shown = sampled = -math.inf
        while not self._over.is_set():
            now = perf_counter()
            try:
                self.stage.drag()
                self.playground.tick(now - last, STEPPING / FPS)
                self.controls.settle()
                self.stage.draw()
                if now - sampled >= 1 / CURVE_RATE:
                    sampled = now
                    self.controls.sample()
                if now - shown >= 1 / STATUS_RATE:
                    shown = now
                    self.controls.show_status()
                    self.stage.show_clock()
            except Exception as error:  # a reader of the page has to see why it stands still
                self.playground.problem = f"STOPPED by an error: {type(error).__name__}: {error}"
                self.controls.show_status()
            last = now
            self._over.wait(max(0.0, 1 / FPS - (perf_counter() - now)))

    def recorded(self) -> Run:
        """The recording as a `Run` whose spheres travel as they were dragged."""
        return self.playground.recorded()

    def scene(self) -> Scene:
        """The scene as the controls have made it, with its present state as its start."""
        return self.playground.present()

    def stop(self) -> None:
        """End stepping and serving."""
        if self._over.is_set():
            return
        self._over.set()
        self._thread.join()
        with _quiet():
            self.server.stop()
        atexit.unregister(self.stop)

    def __repr__(self) -> str:
        return f"<Viewer at {self.url}>"


def _served(viser: Any, gate: Gate, host: str, port: int) -> Any:
    """A viser server behind the gate, without viser's public tunnel."""
    server = None
    with _quiet():
        try:
            with gate.before():
                server = viser.ViserServer(host=host, port=port, label="clothsim", verbose=False)
            for name in ("ShareUrlRequest", "ShareUrlDisconnect"):
                server._websock_server.unregister_handler(getattr(viser._messages, name))
        except BaseException:
            if server is not None:
                server.stop()
            raise
    return server


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep back what viser prints: an address without the token at the start, and a line at the end."""
    from rich import get_console

    console = get_console()
    quiet, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = quiet


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
            if family == socket.AF_INET6:  # as asyncio, which viser uses
                trial.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            trial.bind(address)
    except (OSError, UnicodeError) as error:
        raise ValueError(
            f"host must be a name or address of this machine, such as '127.0.0.1' or '0.0.0.0', got {host!r}: {error}"
        ) from None
