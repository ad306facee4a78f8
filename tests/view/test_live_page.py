"""The page that simulates a scene in the browser, in headless Chromium with WebGPU on the processor."""

from shutil import rmtree

import clothsim as cs
import numpy as np
import pytest
from clothsim.paper import write_gallery

DT = 4e-4
# A paused page, and its state after some steps from the start.
STEPS = """async (steps) => {
  const { live, then } = window.live;
  let out;
  await then(async () => {
    await live.reset();
    while (live.counted < steps && !live.problem) await live.advance(Math.min(100, steps - live.counted));
    out = { planes: [...live.planes], low: [...live.low], time: live.time, contacts: live.contacts,
            energy: live.energy(), depths: live.depths() };
  });
  return out;
}"""


def swing(size=16):
    return cs.scenes.paper_swing(bend=True).replace(cloth=cs.Cloth((size, size), springs=("structural", "shear", "bend")))


def ball(**changes):
    return cs.Sphere(**{"center": (0.5, -0.29, 0.5), "radius": 0.25, "response": "ray", "offset": "edge", **changes})


def draped(**changes):
    return cs.Scene(cs.Cloth((16, 16)), ball(**changes))


@pytest.fixture
def live(opened, tmp_path):
    """`live(scene, **options)`: the page of that scene, ready."""

    def open_live(scene, dt=DT, **options):
        page = opened(scene.to_live_html(tmp_path / "live.html", dt=dt), **options)
        page.ready()
        return page

    return open_live


def pause(page):
    page.tab.click("#play")
    assert page.tab.inner_text("#play") == "run"


def after(page, steps):
    """Planes of the high and of the low parts after `steps` steps from the start, and the whole answer."""
    out = page.tab.evaluate(STEPS, steps)
    return [np.array(out[name], np.float32).reshape(6, -1) for name in ("planes", "low")], out


def parts(stepper):
    """The same planes of a stepper."""
    core = stepper.snapshot().core
    names = (("positions", "velocities"), ("positions_low", "velocities_low"))
    return [np.concatenate([core[n].reshape(-1, 3).T for n in pair]).astype(np.float32) for pair in names]


def core_after(scene, steps, **options):
    stepper = cs.Stepper(scene, precision="single", kernel="gather", threads=1, t=0.0)
    stepper.advance(steps, DT)
    return stepper


def slider_place(page, name, value):
    """Pixel of the tab where a slider has a value."""
    page.tab.locator(f"#{name}").scroll_into_view_if_needed()
    box = page.tab.locator(f"#{name}").bounding_box()
    low, high = page.tab.eval_on_selector(f"#{name}", "(s) => [Number(s.min), Number(s.max)]")
    thumb = 16  # pixels in Chromium, whose middle is at the value
    part = (value - low) / (high - low)
    return box["x"] + thumb / 2 + part * (box["width"] - thumb), box["y"] + box["height"] / 2


def set_slider(page, name, value):
    """Drag the slider with the mouse from where it is."""
    mouse, now = page.tab.mouse, page.tab.eval_on_selector(f"#{name}", "(s) => s.valueAsNumber")
    mouse.move(*slider_place(page, name, now))
    mouse.down()
    mouse.move(*slider_place(page, name, value), steps=4)
    mouse.up()
    idle(page)
    step = page.tab.get_attribute(f"#{name}", "step")
    found = page.tab.eval_on_selector(f"#{name}", "(s) => s.valueAsNumber")
    assert found == pytest.approx(value, abs=0.15 if step == "any" else 0)


def idle(page):
    """Wait for the work that the page has in its queue."""
    page.tab.evaluate("() => window.live.then(() => {})")


def test_it_is_small_silent_and_asks_for_nothing(live, tmp_path):
    page = live(cs.scenes.paper_static())
    path = tmp_path / "live.html"
    assert path.stat().st_size < 400_000 and b"://" not in path.read_bytes()
    page.tab.wait_for_function("() => window.live.live.counted > 20")
    assert page.said == [] and page.asked == [path.as_uri()]
    assert page.tab.is_hidden("#problem")


def test_view_opens_the_page_from_a_file(opened, monkeypatch):
    urls = []
    monkeypatch.setattr("webbrowser.open", lambda url: not urls.append(url))
    path = cs.view(cs.scenes.paper_static())
    assert urls == [path.as_uri()]
    page = opened(path)
    page.ready()
    page.tab.wait_for_function("() => window.live.live.counted > 20")
    assert page.said == [] and page.asked == urls
    rmtree(path.parent)


def test_view_is_a_cell_of_a_notebook(opened, monkeypatch, tmp_path):
    monkeypatch.setattr("clothsim.gpu.live_page.in_notebook", lambda: True)
    monkeypatch.setattr("webbrowser.open", lambda url: pytest.fail("a notebook shows the page itself"))
    cell = tmp_path / "cell.html"
    cell.write_text(cs.view(cs.scenes.paper_static())._repr_html_(), encoding="utf-8")
    page = opened(cell)
    frame = page.tab.frames[1]
    frame.wait_for_selector("body[data-ready]", timeout=30_000)
    frame.wait_for_function("() => window.live.live.counted > 20")
    assert page.said == [] and page.asked[0] == cell.as_uri() and frame.is_hidden("#problem")


def test_view_says_what_it_does_not_take_and_where_no_browser_is(monkeypatch, tmp_path):
    monkeypatch.setattr("clothsim.gpu.live_page.mkdtemp", lambda prefix: str(tmp_path))
    monkeypatch.setattr("webbrowser.open", lambda url: False)
    with pytest.raises(TypeError, match=r"got block, port: .* the page that cs.view\(scene\) opens"):
        cs.view(cs.scenes.paper_static(), block=False, port=8080)
    with pytest.raises(TypeError, match="scene must be"):
        cs.view("paper_static")
    assert not list(tmp_path.iterdir())
    with pytest.raises(RuntimeError, match="no web browser was found: open .*live.html in one"):
        cs.view(cs.scenes.paper_static())


def test_free_cloth_has_the_bits_of_the_gather_kernel_after_1000_steps(live, same_bits):
    page = live(swing())
    pause(page)
    found, out = after(page, 1000)
    cpu = core_after(swing(), 1000)
    assert same_bits(found, parts(cpu)) and out["time"] == cpu.time
    assert np.abs(cpu.positions - swing().initial_position).max() > 0.1
    assert out["energy"] == pytest.approx(cs.energy(swing(), cpu.positions, cpu.velocities)["total"], rel=1e-5, abs=0)


@pytest.mark.parametrize("motion", [None, cs.Linear((0.1, 0.3, 0.0))])
@pytest.mark.parametrize("response, offset", [("ray", "edge"), ("continuous", "cell"), ("continuous", "none")])
def test_contact_follows_the_core_up_to_responses_in_float32(live, motion, response, offset):
    """WebGPU has no float64, so a response rounds in float32; contact lets that grow."""
    scene = draped(motion=motion, friction=0.2, response=response, offset=offset, restitution=float(response == "ray"))
    page = live(scene)
    pause(page)
    (planes, _), out = after(page, 300)
    cpu, free = core_after(scene, 300), core_after(scene.replace(spheres=()), 300)
    assert np.abs(cpu.positions - free.positions).max() > 1e-2
    x = planes[:3].T.reshape(cpu.positions.shape)
    assert np.abs(x - cpu.positions).max() < 1e-4
    depths = cs.penetration(x.astype(float), scene.spheres[0], out["time"])
    assert out["depths"] == pytest.approx({"points": depths["points"], "triangles": depths["triangles"]}, abs=1e-7)


@pytest.mark.parametrize("response", ["ray", "continuous"])
def test_contact_has_the_bits_of_the_adapter_without_float64(live, same_bits, monkeypatch, response):
    devices = pytest.importorskip("clothsim.gpu.device")
    try:
        narrow = devices.Device(devices.chosen_adapter(), float64=False)
    except (ImportError, RuntimeError) as error:
        pytest.skip(str(error))
    monkeypatch.setattr(devices, "opened", lambda: narrow)
    scene = draped(friction=0.2, response=response, offset="cell", motion=cs.Linear((0.1, 0.3, 0.0)))
    page = live(scene)
    pause(page)
    found, _ = after(page, 300)
    gpu = cs.Stepper(scene, precision="single", backend="gpu", t=0.0)
    gpu.advance(300, DT)
    assert same_bits(found, parts(gpu))


def test_spheres_move_as_in_the_core(live):
    table = {"times": [0.1, 0.3, 0.6], "offsets": [(0, 0, 0), (0.1, 0.2, 0), (0, 0.1, -0.1)]}
    motions = [
        cs.Linear((0.1, 0.3, 0.0)),
        *(cs.Reciprocate((1, 2, 0), 0.3, 0.7, k, 0.2) for k in (0.0, 5.0)),
        cs.Sinusoid((0.1, 0.2, 0), 1.7, 0.3),
        *(cs.Keyframes(**table, smooth=smooth) for smooth in (False, True)),
        cs.Keyframes(table["times"], table["offsets"]),
    ]
    scene = cs.Scene(cs.Cloth((16, 16)), [ball(center=(0.5, -9.0, 0.5), motion=motion) for motion in motions])
    page, times = live(scene), [0.0, 0.1, 0.25, 0.5, 0.9]
    found = page.tab.evaluate("(times) => window.live.live.spheres.map((s) => times.map((t) => motionAt(s, t)))", times)
    for sphere, states in zip(scene.spheres, np.array(found), strict=True):
        np.testing.assert_allclose(states[:, 0], sphere.center_at(times), rtol=0, atol=1e-14)
        np.testing.assert_allclose(states[:, 1], sphere.velocity_at(times), rtol=0, atol=1e-13)


def test_thread_ids_are_those_of_the_grid(live):
    page = live(cs.Scene(cs.Cloth((20, 33))))
    ids = np.array(page.tab.evaluate("() => window.live.solver.threadIds()")).reshape(20, 33, 7)
    grid = cs.thread_grid((20, 33))
    names = ("group_x", "group_y", "thread_x", "thread_y", "dispatch_x", "dispatch_y", "index")
    np.testing.assert_array_equal(ids, np.stack([grid[name] for name in names], axis=-1))


def test_an_unstable_step_is_marked_and_named_and_reset(live):
    page = live(swing(), dt=2e-3)
    assert page.tab.is_hidden("#above")
    set_slider(page, "dt", 3)
    page.tab.wait_for_selector("#above", state="visible")
    page.tab.wait_for_selector("#problem", state="visible")
    text = page.tab.inner_text("#problem")
    assert text.startswith("UNSTABLE at step ") and "first at mass point (" in text and "above the guaranteed" in text
    assert np.isfinite(page.tab.evaluate("() => [...window.live.live.planes]")).all()
    page.tab.click("#reset")
    page.tab.wait_for_selector("#problem", state="hidden")
    page.tab.wait_for_function("() => window.live.live.counted > 3")
    assert page.tab.is_hidden("#above")


def test_the_guarantee_of_the_sliders_is_that_of_python(live):
    page, scene = live(swing()), swing()
    for stiffness, damping in ((4, 3), (8, 0), (0, 5)):
        set_slider(page, "stiffness", stiffness)
        set_slider(page, "damping", damping)
        factors = 2.0 ** (stiffness - 4), (0.0, 0.25, 0.5, 1.0, 2.0, 4.0)[damping]
        cloth = scene.cloth
        cloth = cloth.replace(
            stiffness={family: factors[0] * k for family, k in cloth.family_stiffness.items()},
            damping={family: factors[1] * k for family, k in cloth.family_damping.items()},
        )
        assert page.tab.evaluate("() => window.live.live.limit") == cs.max_stable_dt(scene.replace(cloth=cloth))


def test_sliders_of_gravity_and_radius_move_by_mouse_and_by_touch(live):
    page = live(draped(), has_touch=True)
    set_slider(page, "gravity", 20.0)
    assert page.tab.evaluate("() => window.live.live.gravity[1]") == pytest.approx(-20, abs=0.2)
    page.tab.touchscreen.tap(*slider_place(page, "radius", 0.5))
    page.tab.wait_for_function("() => Math.abs(Math.log2(window.live.live.spheres[0].radius / 0.25) - 0.5) < 0.05")
    idle(page)
    assert page.tab.inner_text("#radius-says").startswith("x 1.4") and page.tab.is_hidden("#problem")
    page.tab.touchscreen.tap(*center_of(page, "#reset"))
    page.tab.wait_for_function("() => window.live.live.spheres[0].radius === 0.25 && window.live.live.gravity[1] < -9")


def center_of(page, selector):
    box = page.tab.locator(selector).bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def test_one_step_is_one_step(live):
    page = live(draped())
    pause(page)
    idle(page)
    before = page.tab.evaluate("() => window.live.live.counted")
    page.tab.click("#one")
    idle(page)
    assert page.tab.evaluate("() => window.live.live.counted") == before + 1


def test_the_list_of_methods_has_those_of_python(live):
    options = {"offset": "cell", "restitution": 0.0, "motion": cs.Linear((0.1, 0.3, 0.0))}
    page = live(draped(**options))
    pause(page)
    names = page.tab.locator("#method option").all_inner_texts()
    assert names == ["1 (reflect)", "1, as printed", "2 (ray)", "2, as printed", "continuous"]
    expected = []
    for name, response, printed in zip(
        names, ("reflect", "reflect", "ray", "ray", "continuous"), (0, 1, 0, 1, 0), strict=True
    ):
        page.tab.select_option("#method", label=name)
        idle(page)
        (planes, _), _ = after(page, 250)
        cpu = core_after(draped(response=response, as_printed=bool(printed), **options), 250).positions
        assert np.abs(planes[:3].T.reshape(cpu.shape) - cpu).max() < 1e-5, name
        assert all(np.abs(other - cpu).max() > 1e-4 for other in expected), name
        expected.append(cpu)


def test_several_spheres_have_no_continuous_method(live):
    page = live(draped().replace(spheres=(ball(), ball(center=(0.2, -0.4, 0.2), radius=0.1))))
    assert "continuous" not in page.tab.locator("#method option").all_inner_texts()


def place(page, point):
    """Pixel of the tab where a point [m] is seen."""
    script = """(p) => {
      const { camera } = window.live, canvas = document.getElementById("canvas-0"), box = canvas.getBoundingClientRect();
      const [right, up] = camera.axes(), metre = camera.metre(canvas);
      const along = (axis) => axis.reduce((sum, k, i) => sum + k * (p[i] - camera.target[i]), 0) / metre;
      return [box.left + box.width / 2 + along(right), box.top + box.height / 2 - along(up)];
    }"""
    return page.tab.evaluate(script, list(point))


@pytest.mark.parametrize("response, offset", [("ray", "edge"), ("continuous", "cell")])
def test_a_mouse_drags_spheres_and_pins_and_turns_and_zooms(live, response, offset):
    page = live(draped(response=response, offset=offset))
    mouse = page.tab.mouse
    for place_now, point in (
        ("window.live.live.center(0)", ball().center),
        ("[0, 1, 2].map((k) => window.live.live.planes[k * window.live.live.points])", (0, 0, 0)),
    ):
        x, y = place(page, point)
        start = page.tab.evaluate(place_now)
        mouse.move(x, y)
        mouse.down()
        mouse.move(x - 40, y + 10, steps=4)
        page.tab.wait_for_function(f"(s) => Math.hypot(...{place_now}.map((k, i) => k - s[i])) > 0.02", arg=start)
        mouse.up()
    idle(page)
    if response == "continuous":
        assert page.tab.evaluate("() => window.live.live.depths().triangles") == 0
    angle = "() => [window.live.camera.azimuth, window.live.camera.zoom]"
    before = page.tab.evaluate(angle)
    box = page.tab.locator("#canvas-0").bounding_box()
    mouse.move(box["x"] + 5, box["y"] + 5)
    mouse.down()
    mouse.move(box["x"] + 60, box["y"] + 5, steps=3)
    mouse.up()
    mouse.wheel(0, -200)
    page.tab.wait_for_function("(z) => window.live.camera.zoom > z", arg=before[1])
    assert page.tab.evaluate(angle)[0] != before[0]
    assert page.tab.is_hidden("#problem")


def test_two_fingers_zoom_and_one_drags_a_sphere(live):
    page = live(draped(), has_touch=True)
    touch = page.context.new_cdp_session(page.tab)

    def send(kind, *points):
        touch.send(
            "Input.dispatchTouchEvent",
            {"type": kind, "touchPoints": [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(points)]},
        )

    x, y = place(page, ball().center)
    send("touchStart", (x, y))
    send("touchMove", (x + 40, y))
    page.tab.wait_for_function("() => Math.hypot(...window.live.live.moved[0].by) > 0.02")
    send("touchEnd")
    box = page.tab.locator("#canvas-0").bounding_box()
    x, y = box["x"] + 8, box["y"] + 8
    send("touchStart", (x, y))
    send("touchStart", (x, y), (x + 40, y))
    send("touchMove", (x, y), (x + 120, y))
    page.tab.wait_for_function("() => window.live.camera.zoom > 1.5")
    send("touchEnd")


def test_a_lost_device_is_named(live):
    page = live(swing())
    page.tab.evaluate("() => window.live.solver.device.destroy()")
    page.tab.wait_for_selector("#problem", state="visible")
    assert "lost" in page.tab.inner_text("#problem") and page.tab.inner_text("#play") == "run"


def test_two_tabs_run_and_128_x_128_fits(live, opened, tmp_path):
    first = live(swing())
    path = cs.Scene(cs.Cloth((128, 128))).to_live_html(tmp_path / "large.html")
    assert path.stat().st_size < 400_000
    second = opened(path)
    for page in (first, second):
        page.ready()
        page.tab.bring_to_front()
        page.tab.wait_for_function("() => window.live.live.counted > 5")
        assert page.said == []


def test_the_gallery_leads_to_pages_that_run_offline(opened, tmp_path):
    page = opened(write_gallery(tmp_path), offline=True)
    for k in range(page.tab.locator("p a").count()):
        page.tab.goto((tmp_path / "live.html").as_uri())
        page.tab.locator("p a").nth(k).click()
        page.ready()
        page.tab.wait_for_function("() => window.live.live.counted > 2")
        assert page.tab.is_hidden("#problem")
    assert k == 3 and page.said == []
    assert all(address.startswith(("data:", tmp_path.as_uri())) for address in page.asked)


def test_without_webgpu_it_says_so_and_shows_the_scene(opened, tmp_path):
    path = tmp_path / "live.html"
    text = draped().to_live_html(path).read_text(encoding="utf-8")
    path.write_text(
        text.replace("<script>", "<script>\nObject.defineProperty(navigator, 'gpu', { value: undefined });", 1),
        encoding="utf-8",
    )
    page = opened(path)
    page.tab.wait_for_selector("#problem", state="visible")
    assert "This browser has no WebGPU" in page.tab.inner_text("#problem")
    assert page.tab.is_visible(".stage img") and page.tab.is_hidden("#canvas-0")


def test_a_scene_that_the_shader_lacks_is_refused(tmp_path):
    scene = draped()
    scene = scene.replace(force=np.ones_like(scene.initial_position))
    with pytest.raises(ValueError, match="^force must be None"):
        scene.to_live_html(tmp_path / "live.html")
