"""The live viewer in headless Chromium."""

import os
import re
import socket
import time

import clothsim as cs
import numpy as np
import pytest

pytest.importorskip("viser", reason="viser is not installed (extra view)")

from clothsim.viewing import live

pytestmark = pytest.mark.slow  # run by `make test-view`: the browser draws on the processor


@pytest.fixture
def viewer():
    made = cs.view(cs.scenes.paper_static(), block=False, dt=2e-4, port=free_port())
    yield made
    made.stop()


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def wait_for(condition, seconds=60.0, what="the condition"):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return
        time.sleep(0.02)
    raise AssertionError(f"{what} did not come true in {seconds:g} s")


@pytest.fixture
def tab(browser, viewer):
    context = browser.new_context(viewport={"width": 1000, "height": 700})
    page = context.new_page()
    page.set_default_timeout(120_000)  # without a graphics adapter a busy machine draws a picture in seconds
    page.asked, page.failed = [], []
    page.on("request", lambda request: page.asked.append(request.url))
    page.on("pageerror", lambda error: page.failed.append(str(error)))
    page.on("console", lambda m: page.failed.append(m.text) if m.type == "error" else None)
    page.goto(viewer.url)
    page.get_by_text("stable step").wait_for(timeout=60_000)
    yield page
    context.close()


def move(page, label, keys, count=1):
    """Press keys in the slider of that label."""
    row = page.locator(f"xpath=//label[contains(., '{label}')]/ancestor::*[.//*[@role='slider']][1]")
    slider = row.get_by_role("slider").first
    slider.focus()
    for _ in range(count):
        slider.press(keys)


def test_the_page_shows_the_running_scene_and_asks_this_machine_only(viewer, tab):
    play = viewer.playground
    wait_for(lambda: play.time > 0.3, what="stepping")
    text = tab.locator("body").inner_text()
    assert f"stable step {1e6 * play.limit:.4g} us: the damping of structural and shear springs" in text
    assert re.search(r"real time x \d+\.\d\d", text)
    assert all(re.match(rf"(blob:)?{viewer.url}|data:", url) for url in tab.asked)
    tab.wait_for_timeout(500)
    assert tab.failed == []
    shots = [tab.screenshot() for _ in range(2) if tab.wait_for_timeout(400) is None]
    assert shots[0] != shots[1]


def test_a_slider_moves_the_physics_within_a_fifth_of_a_second(viewer, tab, monkeypatch):
    """From the moment in which the browser's message arrives to the changed scene."""
    play = viewer.playground
    gravity = next(handle for handle, _ in viewer._controls if handle.label.startswith("gravity"))
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


def test_pause_and_single_step(viewer, tab):
    play = viewer.playground
    tab.get_by_role("checkbox").first.check()
    wait_for(lambda: play.paused, what="the pause")
    t = play.time
    tab.get_by_role("button", name="one step", exact=True).click()
    wait_for(lambda: play.time > t, what="the step")
    assert play.time == pytest.approx(t + play.dt)


def test_a_refused_change_is_told_and_taken_back(viewer, tab):
    play = viewer.playground
    offset = next(handle for handle, _ in viewer._controls if handle.label == "offset")
    tab.get_by_role("combobox", name="offset").click()
    tab.get_by_role("option", name="face").click()
    tab.get_by_text("offset 'face' needs response").first.wait_for(timeout=20_000)
    wait_for(lambda: offset.value == "edge")
    assert play.scene.spheres[0].offset == "edge" and not play.problem


def test_a_dragged_sphere_pushes_the_cloth(viewer):
    """Through the callback that the gizmo of the page calls."""
    play = viewer.playground

    class Dragged:
        def __init__(self, phase, position):
            self.phase, self.target = phase, type("Target", (), {"position": position})

    gizmo = viewer._gizmos[0]
    (moved,) = gizmo._impl_aux.update_cb
    moved(Dragged("start", (0.5, -0.5, 0.5)))
    for k in range(20):
        moved(Dragged("update", (0.5, -0.5 + 0.05 * k, 0.5)))
        time.sleep(0.02)
    moved(Dragged("end", (0.5, 0.45, 0.5)))
    wait_for(lambda: abs(play.centers()[0, 1] - 0.45) < 1e-6, what="the sphere's arrival")
    wait_for(lambda: play.positions()[..., 1].max() > 0.3, what="the cloth going up")
    assert not play.problem
    wait_for(lambda: abs(float(gizmo.position[1]) - 0.45) < 1e-6, what="the handle")


def test_clients_that_come_go_and_talk_nonsense_do_no_harm(viewer, browser):
    from websockets.sync.client import connect

    play = viewer.playground
    pages = [browser.new_page() for _ in range(2)]
    for page in pages:
        page.goto(viewer.url)
        page.get_by_text("stable step").wait_for(timeout=60_000)
    pages[0].close()  # lost without a word
    for nonsense in (b"\x00\x01garbage", "text", b"\x81\xa4type\xa4None", b""):
        try:
            with connect(viewer.url.replace("http", "ws"), subprotocols=[protocol()]) as socket_:
                socket_.send(nonsense)
                time.sleep(0.1)
        except Exception:
            pass  # the server may hang up on it
    t = play.time
    wait_for(lambda: play.time > t + 0.1, what="stepping on")
    move(pages[1], "gravity", "End")
    wait_for(lambda: play.scene.gravity[1] == -20.0, what="the other client's slider")
    assert not play.problem
    pages[1].close()


def protocol():
    import viser

    return f"viser-v{viser.__version__}"


def test_it_serves_this_machine_alone_unless_told_otherwise(viewer):
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


def test_a_missing_viser_names_the_extra(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "viser", None)
    with pytest.raises(ImportError, match=r"the live viewer needs viser: .*pip install '\.\[view\]'"):
        live.view(cs.scenes.paper_static())
