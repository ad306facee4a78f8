"""The gate of the live viewer: who may connect to it, and which messages pass.

viser checks neither. Any page in the user's browser could therefore open a WebSocket to the viewer, and any client could
replace parts of the server's controls. The gate stands between the library `websockets` and viser. It refuses handshakes
of other pages, and it makes each message anew of values that it has checked. docs/dev/pages.md has the reasons.
"""

from __future__ import annotations

import hashlib
import ipaddress
import math
import secrets
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from hmac import compare_digest
from threading import Lock
from typing import Any
from urllib.parse import parse_qs, urlsplit

from ..base.extras import needed

LARGEST_MESSAGE = 65_536  # bytes; the messages that pass have a few hundred
LOOPBACK = ("localhost", "127.0.0.1", "::1")

_serving = Lock()  # held while viser takes its server from `websockets`


class BadMessage(ValueError):
    """A message that no page of the viewer sends; its client is dropped."""


class Gate:
    """Checks of handshakes and messages for a viewer that serves at the address `host`.

    `token` is a secret in the address of the page; clients without it are refused. `public`: other machines can reach the
    address.
    """

    def __init__(self, host: str) -> None:
        self.token = secrets.token_urlsafe(16)
        # A name for each viewer: browsers send cookies to all ports of a host.
        self._cookie = f"clothsim-{hashlib.sha256(self.token.encode()).hexdigest()[:8]}"
        found = {entry[4][0] for entry in socket.getaddrinfo(host or None, 0, type=socket.SOCK_STREAM)}
        self.public = not all(ipaddress.ip_address(str(one).partition("%")[0]).is_loopback for one in found)
        self._names = {*LOOPBACK, host.lower()} | ({socket.gethostname().lower()} if self.public else set())
        self._controls: dict[str, Callable[[Any], bool]] = {}
        self._handles: set[str] = set()
        self._served = False

    def admit(self, controls: dict[str, Callable[[Any], bool]], handles: set[str]) -> None:
        """Let values of these controls (by uuid, with the check of a value) and drags of these handles pass."""
        self._controls, self._handles = controls, handles

    # Handshakes.

    @contextmanager
    def before(self) -> Iterator[None]:
        """Put the gate before the viser server that the block makes."""
        server = needed("websockets.asyncio.server", "the live viewer", "view")
        with _serving:
            original = server.serve
            server.serve = lambda handler, *arguments, **options: original(
                *self._checked(handler), *arguments, **self._options(handler, options)
            )
            try:
                yield
            finally:
                server.serve = original
        if not self._served:
            raise RuntimeError("this version of viser takes its server from elsewhere, so its clients cannot be checked")

    def _checked(self, handler: Any) -> tuple[Any]:
        if not _of_viser(handler):
            return (handler,)
        self._served = True

        async def checked(connection: Any) -> None:
            await handler(_Checked(connection, self))

        return (checked,)

    def _options(self, handler: Any, options: dict[str, Any]) -> dict[str, Any]:
        if not _of_viser(handler):
            return options
        page = options["process_request"]

        def process_request(connection: Any, request: Any) -> Any:
            refusal = self.refusal(request)
            if refusal:
                return connection.respond(403, f"{refusal}\n")
            response = page(connection, request)
            if response is not None:
                response.headers["Set-Cookie"] = f"{self._cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict"
                response.headers["Referrer-Policy"] = "no-referrer"
            return response

        return {**options, "process_request": process_request, "max_size": LARGEST_MESSAGE}

    def refusal(self, request: Any) -> str:
        """The reason for which a request is refused, or an empty text."""
        headers = request.headers
        hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
        if len(hosts) != 1 or not self._is_own(hosts[0]):
            return "The host is not that of this viewer."
        own = [f"{scheme}://{hosts[0].lower()}" for scheme in ("http", "https")]
        needs_origin = bool(headers.get_all("Upgrade"))
        if (needs_origin or origins) and (len(origins) != 1 or origins[0].lower() not in own):
            return "The origin is not this viewer."
        if not any(compare_digest(given.encode(errors="replace"), self.token.encode()) for given in self._tokens(request)):
            return "The token is missing. Open the address that clothsim has printed, from ? to its end too."
        return ""

    def _is_own(self, host: str) -> bool:
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        if name in self._names:
            return True
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return self.public  # a page of another site cannot make a browser send an address in place of its name

    def _tokens(self, request: Any) -> Iterator[str]:
        yield from parse_qs(urlsplit(request.path).query).get("token", [])
        for cookies in request.headers.get_all("Cookie"):
            for cookie in cookies.split(";"):
                name, _, value = cookie.strip().partition("=")
                if name == self._cookie:
                    yield value

    # Messages.

    def passed(self, raw: Any) -> dict[str, Any] | None:
        """The message with checked values alone, None for a message to be ignored, or a BadMessage."""
        msgpack = needed("msgspec.msgpack", "the live viewer", "view")
        try:
            message = msgpack.decode(raw) if isinstance(raw, bytes) else None
        except Exception as error:  # of msgspec; RecursionError too
            raise BadMessage(str(error)) from None
        if not isinstance(message, dict) or not isinstance(message.get("type"), str):
            raise BadMessage("a message must be a mapping with a type")
        kind = message["type"]
        take = {
            "GuiUpdateMessage": self._update,
            "TransformControlsUpdateMessage": self._drag,
            "TransformControlsDragStartMessage": self._drag,
            "TransformControlsDragEndMessage": self._drag,
            "ViewerCameraMessage": _camera,
            "ScenePointerMessage": _click,
        }.get(kind)
        fields = take(message) if take else None  # pages send other messages, which nothing here needs
        return None if fields is None else {"type": kind, **fields}

    def _update(self, message: dict[Any, Any]) -> dict[str, Any] | None:
        uuid, updates = message.get("uuid"), message.get("updates")
        if not isinstance(uuid, str) or not isinstance(updates, dict) or set(updates) != {"value"}:
            raise BadMessage("an update must have a uuid and a value alone")
        accepts = self._controls.get(uuid)
        if accepts is None or not accepts(updates["value"]):
            return None
        return {"uuid": uuid, "updates": {"value": updates["value"]}}

    def _drag(self, message: dict[Any, Any]) -> dict[str, Any] | None:
        name = message.get("name")
        if not isinstance(name, str):
            raise BadMessage("a drag must name its handle")
        fields: dict[str, Any] = {"name": name, "owner": ""}
        if message["type"] == "TransformControlsUpdateMessage":
            fields |= {"wxyz": _numbers(message.get("wxyz"), 4), "position": _numbers(message.get("position"), 3)}
        return fields if name in self._handles and message.get("owner", "") == "" else None


class _Checked:
    """A connection that receives only messages that the gate lets pass."""

    def __init__(self, connection: Any, gate: Gate) -> None:
        self._connection, self._gate = connection, gate
        self._ready = False  # viser knows a client from its first camera on, and ends drags of known clients alone

    def __getattr__(self, name: str) -> Any:
        return getattr(self._connection, name)

    async def recv(self) -> bytes:
        msgpack = needed("msgspec.msgpack", "the live viewer", "view")
        while True:
            raw = await self._connection.recv()
            try:
                message = self._gate.passed(raw)
            except BadMessage as error:
                await self._connection.close(1008, str(error)[:100])
                continue  # the next `recv` says that the connection is closed
            if message is None:
                continue
            self._ready = self._ready or message["type"] == "ViewerCameraMessage"
            if self._ready:
                encoded: bytes = msgpack.encode(message)
                return encoded


def _of_viser(handler: Any) -> bool:
    return str(getattr(handler, "__module__", "")).startswith("viser.")


def accepts(handle: Any) -> Callable[[Any], bool]:
    """The check of values of a control: True to let a value pass, False to ignore it, a BadMessage for other kinds."""
    options = getattr(handle, "options", None)
    if options is not None:
        return lambda value: _is_a(value, str) and value in options
    if isinstance(handle.value, bool):
        return lambda value: _is_a(value, bool)
    # A number above the range is ignored: a page sends it while a user types.
    return lambda value: handle.min <= _numbers([value], 1)[0] <= handle.max


def _is_a(value: Any, kind: type) -> bool:
    if not isinstance(value, kind):
        raise BadMessage(f"a value must be a {kind.__name__}")
    return True


def _numbers(values: Any, count: int) -> list[float]:
    """`values`, checked to be `count` finite numbers."""
    if not isinstance(values, list) or len(values) != count:
        raise BadMessage(f"there must be {count} numbers")
    for value in values:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) < math.inf:
            raise BadMessage("a number must be finite")
    return [float(value) for value in values]


def _click(message: dict[Any, Any]) -> dict[str, Any] | None:
    if message.get("event_type") != "click":
        return None
    ray = {name: _numbers(message.get(name), 3) for name in ("ray_origin", "ray_direction")}
    if not any(ray["ray_direction"]):
        raise BadMessage("a ray must have a direction")
    return {"event_type": "click", **ray, "screen_pos": [[0.0, 0.0]], "modifier": None}


def _camera(message: dict[Any, Any]) -> dict[str, Any]:
    vectors = {"wxyz": 4, "position": 3, "look_at": 3, "up_direction": 3}
    numbers = ("fov", "near", "far", "image_height", "image_width")
    return {
        **{name: _numbers(message.get(name), count) for name, count in vectors.items()},
        **{name: _numbers([message.get(name)], 1)[0] for name in numbers},
    }
