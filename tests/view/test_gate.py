"""Who may connect to the live viewer, and what a client may send; clients are made by hand."""

import contextlib
import socket
import time
import warnings

import clothsim as cs
import numpy as np
import pytest

viser = pytest.importorskip("viser", reason="viser is not installed (extra view)")

from clothsim.viewing import gate as gates  # noqa: E402
from msgspec import msgpack  # noqa: E402
from viewers import view, wait_for  # noqa: E402
from websockets.exceptions import ConnectionClosed  # noqa: E402
from websockets.sync.client import connect  # noqa: E402

EVIL = "http://evil.example"


def status(viewer, *, host=None, origin=None, token=None, cookie=None, upgrade=True):
    """The status of the answer to a request that is written by hand."""
    port = viewer.server.get_port()
    lines = [f"GET /{'' if token is None else '?token=' + token} HTTP/1.1", f"Host: {host or f'localhost:{port}'}"]
    if upgrade:
        lines += ["Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13"]
        lines += ["Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", f"Sec-WebSocket-Protocol: viser-v{viser.__version__}"]
    lines += [f"{name}: {value}" for name, value in (("Origin", origin), ("Cookie", cookie)) if value is not None]
    with socket.create_connection(("127.0.0.1", port), timeout=20) as one:
        one.sendall("\r\n".join([*lines, "", ""]).encode())
        return int(one.recv(4096).split()[1])


def test_handshakes_need_the_viewer_s_host_origin_and_token(viewer):
    port, token = viewer.server.get_port(), viewer._gate.token
    own = f"http://localhost:{port}"
    cookie = f"{viewer._gate._cookie}={token}"
    assert f"token={token}" in viewer.url and len(token) >= 20
    accepted = [
        {"origin": own, "token": token},
        {"origin": own, "cookie": cookie},
        {"origin": own, "cookie": f"a=b; {cookie}"},
        {"origin": f"http://127.0.0.1:{port}", "host": f"127.0.0.1:{port}", "token": token},
        {"origin": "http://localhost:9000", "host": "localhost:9000", "token": token},  # through a tunnel of ssh
    ]
    refused = [
        {"origin": EVIL, "token": token},
        {"origin": EVIL, "cookie": cookie},
        {"origin": EVIL, "host": "evil.example", "token": token},  # a name that leads here
        {"origin": f"http://evil.example:{port}", "host": f"evil.example:{port}", "cookie": cookie},
        {"origin": f"http://localhost:{port + 1}", "token": token},  # another program's page on this machine
        {"origin": f"http://localhost:{port}.evil.example", "token": token},
        {"origin": f"http://203.0.113.7:{port}", "host": f"203.0.113.7:{port}", "token": token},
        {"origin": "null", "token": token},
        {"token": token},
        {"origin": own},
        {"origin": own, "token": ""},
        {"origin": own, "token": token[:-1]},
        {"origin": own, "token": "%C3%A9"},
        {"origin": own, "cookie": f"other={token}"},
        {"origin": own, "host": "[::1", "token": token},
        {"origin": own, "host": f"localhost:{port}\r\nHost: evil.example", "token": token},
    ]
    assert [status(viewer, **one) for one in accepted] == [101] * len(accepted)
    for one in refused:
        assert status(viewer, **one) == 403, one
    assert status(viewer, upgrade=False, token=token) == 200
    assert status(viewer, upgrade=False, cookie=cookie) == 200
    for one in ({}, {"token": "x"}, {"token": token, "host": "evil.example"}, {"token": token, "origin": EVIL}):
        assert status(viewer, upgrade=False, **one) == 403, one


def test_two_viewers_have_their_own_tokens(viewer):
    other = view()
    try:
        own = f"http://localhost:{other.server.get_port()}"
        assert status(other, origin=own, token=other._gate.token) == 101
        assert status(other, origin=own, token=viewer._gate.token) == 403
        assert other._gate._cookie != viewer._gate._cookie
    finally:
        other.stop()


def test_other_servers_of_the_library_are_left_alone(viewer):
    from websockets.asyncio import server

    assert server.serve.__module__ == "websockets.asyncio.server"


def test_a_viser_that_is_served_otherwise_is_refused(monkeypatch):
    monkeypatch.setattr(gates, "_of_viser", lambda handler: False)
    stopped, stop = [], viser.ViserServer.stop
    monkeypatch.setattr(viser.ViserServer, "stop", lambda self: (stopped.append(self), stop(self)))
    with pytest.raises(RuntimeError, match="clients cannot be checked"):
        view()
    assert len(stopped) == 1


def test_an_address_that_others_reach_brings_a_warning():
    with pytest.warns(RuntimeWarning, match="host='0.0.0.0' lets other machines reach the live viewer"):
        viewer = view(host="0.0.0.0")
    try:
        port, token = viewer.server.get_port(), viewer._gate.token
        for name in ("localhost", "203.0.113.7", socket.gethostname()):
            host = f"{name}:{port}"
            assert status(viewer, origin=f"http://{host}", host=host, token=token) == 101
            assert status(viewer, origin=f"http://{host}", host=host) == 403
        assert status(viewer, origin=f"{EVIL}:{port}", host=f"evil.example:{port}", token=token) == 403
    finally:
        viewer.stop()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        view(host="localhost").stop()


# Messages

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0, 0, 0],
    "position": [0, 0, 3.0],
    "look_at": [0, 0, 0],
    "up_direction": [0, 1, 0],
    "fov": 1.0,
    "near": 0.1,
    "far": 100.0,
    "image_height": 300,
    "image_width": 400,
}


@contextlib.contextmanager
def client(viewer, camera=CAMERA):
    port = viewer.server.get_port()
    options = {
        "origin": f"http://localhost:{port}",
        "subprotocols": [f"viser-v{viser.__version__}"],
        "max_size": None,
        "max_queue": None,
    }
    with connect(f"ws://localhost:{port}/?token={viewer._gate.token}", **options) as one:
        before = set(viewer.server.get_clients())
        if camera:
            send(one, camera)
            wait_for(lambda: set(viewer.server.get_clients()) - before, "the client")
        yield one


def send(one, message):
    one.send(msgpack.encode(message))


def closed(one, seconds=20.0):
    """Whether the server closes the connection with the code of a bad message."""
    end = time.monotonic() + seconds
    try:
        while time.monotonic() < end:
            with contextlib.suppress(TimeoutError):
                one.recv(timeout=0.05)
    except ConnectionClosed as error:
        return error.rcvd is not None and error.rcvd.code == 1008
    return False


def control(viewer, label):
    return next(handle for handle in viewer.controls.inputs if handle.label.startswith(label))


def update(viewer, label, value, **more):
    return {"type": "GuiUpdateMessage", "uuid": control(viewer, label)._impl.uuid, "updates": {"value": value, **more}}


def dragged(position, kind="Update", **more):
    message = {"type": f"TransformControls{kind}Message", "name": "/drag/sphere 0", "owner": ""}
    return message | ({"wxyz": [1, 0, 0, 0], "position": position} if kind == "Update" else {}) | more


def clicked(origin, direction, **more):
    message = {"type": "ScenePointerMessage", "event_type": "click", "ray_origin": origin, "ray_direction": direction}
    return {**message, "screen_pos": [[0.5, 0.5]], "modifier": None, **more}


def test_values_pass(viewer):
    play = viewer.playground
    with client(viewer) as one:
        send(one, update(viewer, "gravity", 3.0))
        wait_for(lambda: play.scene.gravity[1] == -3.0, "gravity")
        send(one, update(viewer, "response", "reflect"))
        wait_for(lambda: play.scene.spheres[0].response == "reflect", "the response")
        send(one, update(viewer, "pause", True))
        wait_for(lambda: play.paused, "the pause")
        t = play.time
        send(one, update(viewer, "one step", True))
        wait_for(lambda: play.time > t, "the step")
        assert play.time == pytest.approx(t + play.dt)
        send(one, update(viewer, "pause", False))
        send(one, update(viewer, "integrator", "pefrl"))
        wait_for(lambda: play.options["integrator"] == "pefrl", "the integrator")
        send(one, update(viewer, "real time x", 0.25))
        wait_for(lambda: play.speed == 0.25, "slow motion")
        send(one, update(viewer, "step follows machine", True))
        wait_for(lambda: play.follows, "following")
        send(one, update(viewer, "color", "speed"))
        wait_for(lambda: viewer.stage.scale is not None and viewer.stage.scale.unit == "m/s", "colours")
        for kind in ("DragStart", "Update", "DragEnd"):
            send(one, dragged([0.5, -0.4, 0.5], kind))
        wait_for(lambda: abs(play.centers()[0, 1] + 0.4) < 1e-6, "the drag")
    assert not play.problem


def through(point, play):
    """A click from 2 m above a mass point, at a slant."""
    x, origin = play.positions()[point], play.positions()[point] + (0.3, 2.0, 0.4)
    return clicked(origin.tolist(), (3.0 * (x - origin)).tolist())


def test_a_click_on_a_mass_point_shows_its_values(viewer):
    play = viewer.playground
    with client(viewer) as one:
        play.paused = True
        send(one, through((3, 5), play))
        wait_for(lambda: viewer.stage.picked == (3, 5), "the point")
        send(one, clicked([0.0, 5.0, 0.0], [0.0, 1.0, 0.0]))
        wait_for(lambda: viewer.stage.picked is None, "a click beside the cloth")
        send(one, through((30, 1), play))
        play.paused = False
        wait_for(lambda: "row 30, column 1**: stretch" in viewer.controls._probe.content, "the values")
        wait_for(lambda: all(len(plot.data[0]) > 3 and plot.visible for plot in viewer.controls._probe_plots), "curves")
        play.change(speed=0.01)
        send(one, update(viewer, "reset", True))
        wait_for(lambda: viewer.stage.picked is None, "the reset")


def test_a_point_behind_a_sphere_is_not_picked(viewer):
    play = viewer.playground
    play.paused = True
    (sphere,) = play.scene.spheres
    below = np.array(sphere.center) - (0.0, 2.0, 0.0)
    viewer.stage.pick(below, (0.0, 1.0, 0.0))
    assert viewer.stage.picked is None
    viewer.stage.pick(below + (0.45, 0.0, 0.0), (0.0, 1.0, 0.0))
    assert viewer.stage.picked is not None


def test_files_go_to_the_client_that_asks_and_no_file_is_written_here(viewer, monkeypatch, tmp_path):
    sent = []
    monkeypatch.setattr(
        viser.ClientHandle, "send_file_download", lambda self, *file, **_: sent.append((self.client_id, *file))
    )
    monkeypatch.chdir(tmp_path)
    play = viewer.playground
    with client(viewer), client(viewer) as one:
        asking = max(viewer.server.get_clients())
        send(one, update(viewer, "recording as a page", True))  # without a recording: a refusal is shown
        send(one, update(viewer, "record", True))
        wait_for(lambda: len(play.recorder.frames) > 3, "a recording")
        for label in ("scene, as", "recording as a page", "recording as a file"):
            before = len(sent)
            send(one, update(viewer, label, True))
            wait_for(lambda: len(sent) > before, label)
    assert {who for who, _, _ in sent} == {asking} and list(tmp_path.iterdir()) == []
    for _, name, content in sent:
        (tmp_path / name).write_bytes(content)
    assert [name for _, name, _ in sent] == ["scene.toml", "recording.html", "recording.npz"]
    scene, run = cs.load_scene(tmp_path / "scene.toml"), cs.load_run(tmp_path / "recording.npz")
    assert scene.cloth == run.scene.cloth == play.scene.cloth
    assert np.array_equal(run.x[0], play.recorder.frames[0].x) and len(run) > 3
    assert b"</html>" in (tmp_path / "recording.html").read_bytes()[-200:]


BAD = {
    "a callback": lambda v: update(v, "gravity", 3.0, update_cb=[]),
    "callbacks alone": lambda v: {**update(v, "gravity", 3.0), "updates": {"update_cb": []}},
    "removal": lambda v: {**update(v, "reset", True), "updates": {"removed": True}},
    "a text for a number": lambda v: update(v, "gravity", "3"),
    "a list for a number": lambda v: update(v, "gravity", [3.0]),
    "no number": lambda v: update(v, "gravity", None),
    "NaN": lambda v: update(v, "time step", float("nan")),
    "infinity": lambda v: update(v, "time step", float("inf")),
    "a number for a choice": lambda v: update(v, "response", 1),
    "a text for a switch": lambda v: update(v, "pause", "yes"),
    "a number for a button": lambda v: update(v, "reset", 1),
    "no uuid": lambda v: {"type": "GuiUpdateMessage", "updates": {"value": 1.0}},
    "a drag of 2 numbers": lambda v: dragged([0.0, 0.0]),
    "a drag of 4 numbers": lambda v: dragged([0.0] * 4),
    "a drag of texts": lambda v: dragged(["0", "0", "0"]),
    "a drag to NaN": lambda v: dragged([0.0, float("nan"), 0.0]),
    "a rotation of 3 numbers": lambda v: dragged([0.0] * 3, wxyz=[1.0, 0.0, 0.0]),
    "a drag without a name": lambda v: dragged([0.0] * 3, name=None),
    "a camera of texts": lambda v: {**CAMERA, "position": "here"},
    "a number for an integrator": lambda v: update(v, "integrator", 4),
    "a text for a speed": lambda v: update(v, "real time x", "fast"),
    "a text for following": lambda v: update(v, "step follows machine", "yes"),
    "a number for a color": lambda v: update(v, "color", 0),
    "a number for saving": lambda v: update(v, "scene, as", "/etc/passwd"),
    "a click of 2 numbers": lambda v: clicked([0.0, 0.0], [0.0, 0.0, 1.0]),
    "a click from NaN": lambda v: clicked([0.0, float("nan"), 0.0], [0.0, 0.0, 1.0]),
    "a click along nothing": lambda v: clicked([0.0] * 3, [0.0] * 3),
    "a click of texts": lambda v: clicked("here", "there"),
    "no type": lambda v: {"uuid": "x"},
    "a type that is a number": lambda v: {"type": 3},
    "a list": lambda v: [1, 2, 3],
    "nesting": lambda v: msgpack.decode(b"\x91" * 900 + b"\xc0"),
}


def test_a_bad_client_is_dropped_and_the_scene_goes_on_for_others(viewer):
    play = viewer.playground
    with client(viewer) as other:
        for name, message in BAD.items():
            with client(viewer) as bad:
                send(bad, message(viewer))
                assert closed(bad), name
        for raw in (b"\x00\x01garbage", b"", b"\xc1", b"\xff" * 1000, "a text"):
            with client(viewer) as bad:
                bad.send(raw)
                assert closed(bad), raw
        wait_for(lambda: len(viewer.server.get_clients()) == 1, "their end")
        assert not play.problem and play.scene == play.start and play.dt == play.start_dt
        t = play.time
        wait_for(lambda: play.time > t, "stepping on")
        send(other, update(viewer, "gravity", -2.0))
        wait_for(lambda: play.scene.gravity[1] == 2.0, "the other client's slider")


IGNORED = {
    "a huge step": lambda v: update(v, "time step", 1e302),
    "a tiny step": lambda v: update(v, "time step", 1e-314),
    "a step of nothing": lambda v: update(v, "time step", 0.0),
    "a large gravity": lambda v: update(v, "gravity", 1e6),
    "an unknown choice": lambda v: update(v, "response", "bounce"),
    "an unknown integrator": lambda v: update(v, "integrator", "rk5"),
    "an unknown color": lambda v: update(v, "color", "secret"),
    "a large speed": lambda v: update(v, "real time x", 1e9),
    "a speed of nothing": lambda v: update(v, "real time x", 0.0),
    "a choice of many": lambda v: {**clicked([0.0] * 3, [0.0, 0.0, 1.0]), "event_type": "rect-select"},
    "an unknown control": lambda v: {**update(v, "gravity", 1.0), "uuid": "x"},
    "an unknown handle": lambda v: dragged([0.0] * 3, name="/cloth/front"),
    "a click": lambda v: {"type": "SceneNodeClickMessage", "name": "/cloth/front"},
    "a removal": lambda v: {"type": "RemoveSceneNodeMessage", "name": "/cloth/front"},
    "an upload": lambda v: {"type": "FileTransferStartUpload", "source_component_uuid": "x"},
    "a public address": lambda v: {"type": "ShareUrlRequest"},
}


def test_messages_for_no_control_are_ignored(viewer, monkeypatch):
    play, asked, changes, change = viewer.playground, [], [], viewer.playground.change
    monkeypatch.setattr(viewer.server, "request_share_url", lambda *_: asked.append(1))
    monkeypatch.setattr(play, "change", lambda **values: (changes.append(values), change(**values)))
    with client(viewer) as one:
        for message in IGNORED.values():
            send(one, message(viewer))
        send(one, update(viewer, "gravity", 1.0))
        wait_for(lambda: play.scene.gravity[1] == -1.0, "the last message")
    assert changes == [{"gravity": 1.0}] and play.centers()[0].tolist() == [0.5, -0.5, 0.5]
    assert asked == [] and not play.problem


def test_no_client_can_make_the_process_open_a_public_tunnel(viewer):
    handled = {kind.__name__ for kind in viewer.server._websock_server._incoming_handlers}
    assert "GuiUpdateMessage" in handled  # the list is viser's
    assert not {kind for kind in handled if "Share" in kind}


def test_a_reset_by_a_client_works_after_every_stop(viewer, monkeypatch):
    play = viewer.playground
    with client(viewer) as one:
        for problem in ("unstable", "error"):
            if problem == "unstable":
                play.change(dt=20 * play.limit)
            else:
                broken = monkeypatch.context()
                patch = broken.__enter__()
                patch.setattr(play, "tick", lambda *_, **__: 1 / 0)
            wait_for(lambda: play.problem, problem)
            if problem == "error":
                assert "STOPPED by an error: ZeroDivisionError" in play.problem
                broken.__exit__(None, None, None)
            send(one, dragged([0.0] * 3, "DragStart"))
            send(one, update(viewer, "reset", True))
            wait_for(lambda: not play.problem and play.time > 0, "going on")
    assert play.dt == play.start_dt
    assert np.isfinite(play.positions()).all()


def test_a_client_without_a_camera_holds_no_handle(viewer):
    """viser ends the drags only of clients that have sent a camera."""
    with client(viewer, camera=None) as one:
        send(one, dragged([0.0] * 3, "DragStart"))
        send(one, update(viewer, "gravity", 1.0))
        time.sleep(0.3)
        assert viewer.stage._dragging == {} and viewer.playground.scene == viewer.playground.start
