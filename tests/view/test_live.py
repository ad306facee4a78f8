"""The live viewer in headless Chromium."""

import contextlib
import os
import re
import socket
import time

import clothsim as cs
import numpy as np
import pytest

viser = pytest.importorskip("viser", reason="viser is not installed (extra view)")

from viewers import free_port, wait_for  # noqa: E402

pytestmark = pytest.mark.slow  # run by `make test-view`: the browser draws on the processor


@pytest.fixture(scope="module")
def opened_once(browser, served):
    context = browser.new_context(viewport={"width": 900, "height": 480})
    page = context.new_page()
    page.set_default_timeout(120_000)  # without a graphics adapter a busy machine draws a picture in seconds
    page.asked, page.failed = [], []
    page.on("request", lambda request: page.asked.append(request.url))
    page.on("pageerror", lambda error: page.failed.append(str(error)))
    page.on("console", lambda m: page.failed.append(m.text) if m.type == "error" else None)
    page.goto(served.url)
    page.get_by_text("stable step").wait_for()
    close_notes(page)
    yield page
    context.close()


@pytest.fixture
def tab(viewer, opened_once):
    return opened_once


def close_notes(page):
    """Close what viser says of a browser without a graphics adapter: it lies over the picture."""
    for _ in range(3):
        note = page.locator(".mantine-Notification-closeButton").first
        if note.count():
            with contextlib.suppress(Exception):  # a note may end by itself
                note.click(timeout=5_000)
        page.wait_for_timeout(200)


def move(page, label, keys, count=1):
    """Press keys in the slider of that label."""
    row = page.locator(f"xpath=//label[contains(., '{label}')]/ancestor::*[.//*[@role='slider']][1]")
    slider = row.get_by_role("slider").first
    slider.focus()
    for _ in range(count):
        slider.press(keys)


def test_the_page_shows_the_running_scene_and_asks_this_machine_only(viewer, tab):
    play = viewer.playground
    tab.get_by_text(re.compile(r"real time x \d")).wait_for()
    text = tab.locator("body").inner_text()
    assert f"stable step {1e6 * play.limit:.4g} us: the damping of structural and shear springs" in text
    assert re.search(r"real time x \d+\.\d\d", text)
    assert all(re.match(rf"(blob:)?{viewer.url.partition('?')[0]}|data:", url) for url in tab.asked)
    tab.wait_for_timeout(500)
    assert tab.failed == []
    shots = [tab.screenshot() for _ in range(2) if tab.wait_for_timeout(400) is None]
    assert shots[0] != shots[1]


def test_a_slider_moves_the_physics_within_a_fifth_of_a_second(viewer, tab, monkeypatch):
    """From the moment in which the browser's message arrives to the changed scene."""
    play = viewer.playground
    gravity = next(handle for handle, _ in viewer.controls.entries if handle.label.startswith("gravity"))
    change, acted = play.change, []
    monkeypatch.setattr(play, "change", lambda **what: (change(**what), acted.append(time.time())))
    move(tab, "gravity", "Home")
    wait_for(lambda: play.scene.gravity[1] == 20.0, what="gravity")
    assert acted[-1] - gravity.update_timestamp < 0.2 * busy()
    wait_for(lambda: play.positions()[..., 1].max() > 0.3, what="the cloth going up")
    move(tab, "radius", "End")
    wait_for(lambda: play.scene.spheres[0].radius == 0.5, what="the radius")


def busy():
    """How many times longer a program takes where others keep the processors busy."""
    return max(1.0, os.getloadavg()[0] / os.cpu_count())


def test_unstable_is_said_and_a_reset_goes_on(viewer, tab):
    play = viewer.playground
    wait_for(lambda: play.time > 0.2)
    play.change(dt=6 * play.limit)
    tab.get_by_text("UNSTABLE at point").wait_for(timeout=60_000)
    assert np.isfinite(play.positions()).all()
    tab.get_by_role("button", name="reset", exact=True).click()
    wait_for(lambda: not play.problem and play.time > 0.1, what="going on")
    tab.get_by_text("UNSTABLE at point").wait_for(state="hidden", timeout=60_000)


def test_a_refused_change_is_reported_and_undone(viewer, tab):
    play = viewer.playground
    offset = next(handle for handle, _ in viewer.controls.entries if handle.label == "offset")
    tab.get_by_role("combobox", name="offset").click()
    tab.get_by_role("option", name="face").click()
    tab.get_by_text("offset 'face' needs response").first.wait_for(timeout=20_000)
    wait_for(lambda: offset.value == "edge")
    assert play.scene.spheres[0].offset == "edge" and not play.problem


def choose(tab, label, option):
    tab.get_by_role("combobox", name=label).click()
    tab.get_by_role("option", name=option, exact=True).click()


def test_no_banner_of_the_library_lies_over_the_picture(tab):
    tab.wait_for_timeout(500)
    assert not tab.get_by_text("Software WebGL rendering").first.is_visible()


def test_colours_the_integrator_and_slow_motion_are_chosen_in_the_browser(viewer, tab):
    play = viewer.playground
    choose(tab, "integrator", "velocity_verlet")
    wait_for(lambda: play.options["integrator"] == "velocity_verlet", what="the integrator")
    move(tab, "real time x", "Home")
    wait_for(lambda: play.speed == 0.01, what="slow motion")
    wait_for(lambda: abs(play.factor - 0.01) < 0.005, what="the measured speed")
    choose(tab, "color", "speed")
    bar = tab.get_by_role("img", name="speed from 0 m/s")
    bar.wait_for()
    high = viewer.stage.scale.high
    assert bar.get_attribute("aria-label").endswith(f"{high:.3g} m/s")

    def blue(r, g, b):
        return (b > r + 40) & (b > g + 20)

    wait_for(lambda: share(tab, blue) > 0.01, what="the dark end of the scale")
    choose(tab, "color", "depth")  # a pale yellow where nothing is inside a sphere
    tab.get_by_role("img", name="depth from 0 mm").wait_for()
    wait_for(lambda: share(tab, blue) < 2e-3, what="the light end of the scale")
    assert share(tab, lambda r, g, b: (r > 150) & (b < r - 10) & (g > b)) > 0.005
    choose(tab, "color", "faces")
    tab.get_by_role("img", name="depth from 0 mm").wait_for(state="hidden")


def share(tab, chosen):
    """Part of the picture's pixels that are chosen by their red, green and blue."""
    from io import BytesIO

    from PIL import Image

    pixels = np.asarray(Image.open(BytesIO(tab.screenshot())).convert("RGB")).astype(int)
    return chosen(*np.moveaxis(pixels[:, : pixels.shape[1] // 2], -1, 0)).mean()


def test_what_is_inside_a_sphere_is_red(viewer, tab):
    play = viewer.playground

    def red(r, g, b):
        return (r > 180) & (g < 130) & (b < g)

    play.paused = True
    tab.wait_for_timeout(500)
    before = share(tab, red)  # arrows
    center = play.positions()[16, 16] - (0.0, 0.1, 0.0)
    play.change(radius=0.25, center=tuple(center))
    wait_for(lambda: len(viewer.stage._inside.vertices) > 1000, what="the inside")
    wait_for(lambda: share(tab, red) > before + 0.005, what="red")


def test_a_click_of_the_mouse_shows_the_values_of_a_mass_point(viewer, tab):
    play = viewer.playground
    wait_for(lambda: play.time > 0.1)
    play.paused = True
    for point in ((8, 8), (26, 28)):

        def near(point=point):  # a pixel is a third of a cell where the cloth lies flat
            return viewer.stage.picked is not None and np.abs(np.subtract(viewer.stage.picked, point)).max() <= 1

        tab.mouse.click(*on_screen(viewer, tab, play.positions()[point]))
        wait_for(near, what=f"the values of {point}")
    row, column = viewer.stage.picked
    play.paused = False
    tab.get_by_text(re.compile(f"row {row}, column {column}: stretch .* speed")).wait_for()
    tab.get_by_text("stretch of the point [%]").first.wait_for()


def test_the_browser_saves_the_scene_and_the_recording(viewer, tab, tmp_path):
    tab.get_by_role("checkbox", name="record").check()
    wait_for(lambda: len(viewer.playground.recorder.frames) > 5, what="the recording")
    tab.get_by_text("save", exact=True).click()
    for button, name in (("scene, as it is now", "scene.toml"), ("recording as a file of clothsim", "recording.npz")):
        with tab.expect_download() as download:
            tab.get_by_role("button", name=button).click()
        assert download.value.suggested_filename == name
        download.value.save_as(tmp_path / name)
    assert cs.load_scene(tmp_path / "scene.toml").cloth == viewer.playground.scene.cloth
    assert len(cs.load_run(tmp_path / "recording.npz")) > 5


def test_a_step_above_the_guarantee_is_said(viewer, tab):
    play = viewer.playground
    play.paused = True
    play.change(dt=1.5 * play.limit)
    tab.get_by_text(f"time step {1.5e6 * play.limit:.4g} us is above the stable step").wait_for()


def on_screen(viewer, page, point):
    """Where the browser draws a point of the scene [pixels]."""
    camera = next(iter(viewer.server.get_clients().values())).camera
    box = max((c.bounding_box() for c in page.locator("canvas").all()), key=lambda b: b["width"] * b["height"])
    ahead = camera.look_at - camera.position
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, (0.0, 1.0, 0.0))
    right /= np.linalg.norm(right)
    seen = np.subtract(point, camera.position)
    scale = box["height"] / 2 / np.tan(camera.fov / 2) / (seen @ ahead)
    x, y = scale * (seen @ right), scale * (seen @ np.cross(right, ahead))
    return box["x"] + box["width"] / 2 + x, box["y"] + box["height"] / 2 - y


def drag(viewer, page, place, arrow, by):
    """Take the head of an arrow by the mouse, pull it along itself, and let it go."""
    length = np.linalg.norm(arrow)
    head = place + 0.92 * np.array(arrow)
    (x0, y0), (x1, y1) = (on_screen(viewer, page, p) for p in (head, head + by * np.array(arrow) / length))
    page.mouse.move(x0, y0)
    page.wait_for_timeout(500)
    page.mouse.down()
    for k in range(1, 9):
        page.mouse.move(x0 + (x1 - x0) * k / 8, y0 + (y1 - y0) * k / 8)
        page.wait_for_timeout(60)
    page.mouse.up()


def test_a_sphere_dragged_by_the_mouse_pushes_the_cloth(viewer, tab):
    play = viewer.playground
    wait_for(lambda: play.time > 3.0, what="the cloth hanging in the plane x = 0")
    assert play.positions()[16, 16, 0] > -0.1
    drag(viewer, tab, play.centers()[0], (1.3 * 0.25, 0.0, 0.0), -0.5)
    wait_for(lambda: play.centers()[0, 0] < 0.1, what="the sphere's arrival")
    assert play.centers()[0, 1:] == pytest.approx((-0.5, 0.5), abs=0.02)
    wait_for(lambda: play.positions()[..., 0].min() < -0.15, what="the cloth giving way")
    assert not play.problem
    gizmo = viewer.stage.gizmos[0]
    wait_for(lambda: abs(gizmo.position[0] - play.centers()[0, 0]) < 1e-4, what="the handle")
    assert viewer.stage._dragging == {}


def test_a_pin_dragged_by_the_mouse_moves_and_takes_the_cloth_along(viewer, tab):
    play = viewer.playground
    pin = viewer.stage._pins[0]
    wait_for(lambda: play.time > 1.0)
    drag(viewer, tab, play.positions()[pin], (0.0, 0.12, 0.0), 0.3)
    wait_for(lambda: play.positions()[pin][1] > 0.2, what="the pin's arrival")
    assert play.positions()[pin][[0, 2]] == pytest.approx((0.0, 0.0), abs=0.02)
    wait_for(lambda: play.positions()[pin[0] + 1, 1][1] > 0.05, what="the neighbour")
    assert not play.problem


class Dragged:
    """What viser reports of a handle that a client holds."""

    def __init__(self, phase, position, client_id=7):
        self.phase, self.client_id = phase, client_id
        self.target = type("Target", (), {"position": position})


def test_a_handle_follows_the_scene_again_when_its_client_is_lost(viewer):
    gizmo = viewer.stage.gizmos[0]
    (moved,) = gizmo._impl_aux.update_cb
    for phase, height in (("start", -0.5), ("update", -0.3)):
        with contextlib.suppress(StopIteration):  # playwright's loop runs on this thread
            moved(Dragged(phase, (0.5, height, 0.5))).send(None)
    assert viewer.stage._dragging == {gizmo.name: 7}
    viewer.stage.let_go(type("Client", (), {"client_id": 8}))
    assert viewer.stage._dragging == {gizmo.name: 7}
    viewer.stage.let_go(type("Client", (), {"client_id": 7}))
    wait_for(lambda: abs(float(gizmo.position[1]) + 0.3) < 1e-4, what="the handle")


def client(viewer):
    """A connection that reads nothing: beyond a few messages, what the server sends is stuck on the way."""
    from websockets.sync.client import connect

    own, protocol = viewer.url.partition("/?")[0], f"viser-v{viser.__version__}"
    return connect(viewer.url.replace("http", "ws"), origin=own, subprotocols=[protocol], max_queue=1)


def test_a_client_that_reads_nothing_slows_no_step_and_keeps_no_picture():
    psutil = pytest.importorskip("psutil")
    cloth = cs.Cloth((64, 64), mass=512.0, stiffness=1000.0, damping=5.0)
    viewer = cs.view(cs.Scene(cloth), block=False, dt=1e-3, port=free_port())
    try:
        play, buffer = viewer.playground, viewer.server._websock_server._broadcast_buffer

        def pace(seconds):
            t, begun = play.time, time.process_time()
            time.sleep(seconds)
            return (play.time - t) / (time.process_time() - begun)

        wait_for(lambda: play.time > 0.1)
        alone = pace(2.0)
        with client(viewer):
            wait_for(lambda: stuck(buffer), what="the client's stall")
            kept, memory = len(buffer.message_from_id), psutil.Process().memory_info().rss
            beside = pace(5.0)  # some 150 pictures of 100 kB
            assert stuck(buffer)
            assert len(buffer.message_from_id) <= kept + 5
            assert psutil.Process().memory_info().rss < memory + 8e6
        assert beside > 0.5 * alone
        assert not play.problem
        wait_for(lambda: not viewer.server.get_clients(), what="its end")
    finally:
        viewer.stop()


def stuck(buffer):
    """Whether a client has been sent none of the last hundred messages."""
    return any(buffer.message_counter - cursor > 100 for cursor in buffer.generator_cursors.values())


def test_the_viewer_serves_only_this_machine_by_default(viewer):
    assert viewer.server.get_host() == "127.0.0.1"
    with socket.socket() as other:
        other.settimeout(2)
        address = next((a for a in addresses() if not a.startswith("127.")), None)
        if address is None:
            pytest.skip("this machine has no other address")
        with pytest.raises(OSError):
            other.connect((address, viewer.server.get_port()))


def addresses():
    try:
        return {a[4][0] for a in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    except OSError:
        return set()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"block": 1}, "block must be True or False"),
        ({"port": 0}, "port must be an integer >= 1"),
        ({"dt": -1.0}, "dt must be a finite number > 0"),
        ({"integrator": "rk5"}, "integrator"),
    ],
)
def test_wrong_arguments_are_named(arguments, words):
    with pytest.raises((ValueError, TypeError), match=words):
        cs.view(cs.scenes.paper_static(), **{"block": False, **arguments})
    with pytest.raises(TypeError, match="scene must be a Scene"):
        cs.view("paper_static", block=False)
