"""The page that simulates a scene, in headless Chromium with WebGPU on the processor."""

from io import BytesIO
from shutil import rmtree

import clothsim as cs
import numpy as np
import pytest
from PIL import Image

DT = 4e-4
# A paused page, and its state after some steps from the start.
STEPS = """async (steps) => {
  const { live, then } = window.live;
  let out;
  await then(async () => {
    await live.reset();
    while (live.counted < steps && !live.problem)
      await live.advance(Math.min(100, steps - live.counted));
    out = { planes: [...live.planes], low: [...live.low], time: live.time,
            limit: live.limit };
    live.record();
    for (const name of ["total", "points", "triangles", "stretch"])
      out[name] = live.curves[name].at(-1);
  });
  return out;
}"""


def swing(size=16):
    return cs.scenes.paper_swing(bend=True).replace(
        cloth=cs.Cloth((size, size), springs=("structural", "shear", "bend"))
    )


def ball(**changes):
    return cs.Sphere(
        **{
            "center": (0.5, -0.29, 0.5),
            "radius": 0.25,
            "response": "ray",
            "offset": "edge",
            **changes,
        }
    )


def draped(**changes):
    return cs.Scene(cs.Cloth((16, 16)), ball(**changes))


@pytest.fixture
def live(opened, tmp_path):
    """Return `live(scene, **options)`: the page of that scene, ready."""

    def open_live(scene, dt=DT, **options):
        page = opened(scene.to_live_html(tmp_path / "live.html", dt=dt), **options)
        page.ready()
        return page

    return open_live


def pause(page):
    page.tab.click("#play")
    assert page.tab.get_attribute("#play", "aria-label") == "play"


def after(page, steps):
    """Return planes of high and low parts after `steps` steps, and the whole answer."""
    out = page.tab.evaluate(STEPS, steps)
    return [np.array(out[name], np.float32).reshape(6, -1) for name in ("planes", "low")], out


def parts(stepper):
    """Return the same planes of a stepper."""
    core = stepper.snapshot().core
    names = (("positions", "velocities"), ("positions_low", "velocities_low"))
    return [
        np.concatenate([core[n].reshape(-1, 3).T for n in pair]).astype(np.float32)
        for pair in names
    ]


def core_after(scene, steps, **options):
    stepper = cs.Stepper(scene, precision="single", kernel="gather", threads=1, t=0.0)
    stepper.advance(steps, DT)
    return stepper


def set_slider(page, name, value):
    page.tab.locator(f"#{name}").fill(str(value))
    idle(page)


def idle(page):
    """Wait for the work that the page has in its queue."""
    page.tab.evaluate("() => window.live.then(() => {})")


def test_view_opens_a_small_silent_page_that_asks_for_nothing(opened, monkeypatch):
    urls = []
    monkeypatch.setattr("webbrowser.open", lambda url: not urls.append(url))
    path = cs.view(cs.scenes.paper_static())
    page = opened(path)
    page.ready()
    page.tab.wait_for_function("() => window.live.live.counted > 20")
    assert (
        page.said == [] and page.asked == urls == [path.as_uri()] and page.tab.is_hidden("#problem")
    )
    assert path.stat().st_size < 400_000 and b"://" not in path.read_bytes()
    rmtree(path.parent)


def test_view_is_a_cell_of_a_notebook(opened, monkeypatch, tmp_path):
    monkeypatch.setattr("clothsim.gpu.live_page.is_in_notebook", lambda: True)
    monkeypatch.setattr(
        "webbrowser.open", lambda url: pytest.fail("a notebook shows the page itself")
    )
    cell = tmp_path / "cell.html"
    cell.write_text(cs.view(cs.scenes.paper_static())._repr_html_(), encoding="utf-8")
    page = opened(cell)
    frame = page.tab.frames[1]
    frame.wait_for_selector("body[data-ready]")
    frame.wait_for_function("() => window.live.live.counted > 20")
    assert page.said == [] and page.asked[0] == cell.as_uri() and frame.is_hidden("#problem")


def test_view_refuses_what_is_no_scene_and_says_where_no_browser_is(monkeypatch, tmp_path):
    monkeypatch.setattr("clothsim.gpu.live_page.mkdtemp", lambda prefix: str(tmp_path))
    monkeypatch.setattr("webbrowser.open", lambda url: False)
    with pytest.raises(TypeError, match="scene must be"):
        cs.view("paper_static")
    assert not list(tmp_path.iterdir())
    with pytest.raises(RuntimeError, match="no web browser was found: open .*live.html in one"):
        cs.view(cs.scenes.paper_static())


OTHERS = (
    cs.Sphere((0.15, -0.2, 0.8), 0.1, response="reflect"),
    cs.Plane((0.0, -0.3, 0.0), response="ray"),
)


@pytest.mark.parametrize(
    "response, offset, others",
    [("ray", "cell", ()), ("ray", "edge", OTHERS), ("reflect", "none", ())],
)
def test_contact_has_the_bits_of_the_adapter_without_float64_and_follows_the_core(
    live, same_bits, monkeypatch, response, offset, others
):
    """WebGPU has no float64, so a response rounds in float32; contact lets that grow."""
    scene = draped(
        motion=cs.Linear((0.1, 0.3, 0.0)), friction=0.2, response=response, offset=offset
    )
    scene = scene.replace(spheres=(*scene.spheres, *others))
    page = live(scene)
    pause(page)
    found, out = after(page, 300)
    cpu, free = core_after(scene, 300), core_after(scene.replace(spheres=()), 300)
    assert np.abs(cpu.positions - free.positions).max() > 1e-2
    x = found[0][:3].T.reshape(cpu.positions.shape)
    assert np.abs(x - cpu.positions).max() < 1e-4
    found_depths = [
        cs.penetration(x.astype(float), sphere, out["time"]) for sphere in scene.spheres
    ]
    depths = {name: max(one[name] for one in found_depths) for name in found_depths[0]}
    assert {name: out[name] for name in depths} == pytest.approx(depths, abs=1e-7)
    devices = pytest.importorskip("clothsim.gpu.device")
    try:
        narrow = devices.Device(devices.chosen_adapter(), float64=False)
    except (ImportError, RuntimeError) as error:
        pytest.skip(str(error))
    monkeypatch.setattr(devices, "open_device", lambda: narrow)
    gpu = cs.Stepper(scene, precision="single", backend="gpu", t=0.0)
    gpu.advance(300, DT)
    assert same_bits(found, parts(gpu))


def test_spheres_move_as_in_the_core(live):
    table = {"times": [0.1, 0.3, 0.6], "offsets": [(0, 0, 0), (0.1, 0.2, 0), (0, 0.1, -0.1)]}
    motions = [
        cs.Linear((0.1, 0.3, 0.0)),
        *(cs.Reciprocate((1, 2, 0), 0.3, 0.7, k, 0.2) for k in (0.0, 5.0)),
        cs.Sinusoid((0.1, 0.2, 0), 1.7, 0.3),
        *(cs.Keyframes(**table, smooth=smooth) for smooth in (False, True, "rest")),
        cs.Keyframes(table["times"], table["offsets"]),
    ]
    scene = cs.Scene(
        cs.Cloth((16, 16)), [ball(center=(0.5, -9.0, 0.5), motion=motion) for motion in motions]
    )
    page, times = live(scene), [0.0, 0.1, 0.25, 0.5, 0.9]
    found = page.tab.evaluate(
        "(times) => window.live.live.spheres.map((s) => times.map((t) => motionAt(s, t)))", times
    )
    for sphere, states in zip(scene.spheres, np.array(found), strict=True):
        np.testing.assert_allclose(states[:, 0], sphere.center_at(times), rtol=0, atol=1e-14)
        np.testing.assert_allclose(states[:, 1], sphere.velocity_at(times), rtol=0, atol=1e-13)


def test_an_unstable_step_is_marked_and_named_and_reset_where_the_hand_is(live):
    page = live(swing(), dt=2e-3)
    assert page.tab.is_hidden("#above") and page.tab.locator("label:has(#dt) #above").count() == 1
    set_slider(page, "dt", 3)
    page.tab.wait_for_selector("#above", state="visible")
    page.tab.wait_for_selector("#problem", state="visible")
    text = page.tab.inner_text("#problem")
    assert (
        text.startswith("UNSTABLE at step ")
        and "first at mass point (" in text
        and "above the guaranteed" in text
    )
    assert np.isfinite(page.tab.evaluate("() => [...window.live.live.planes]")).all()
    assert page.tab.inner_text("#play") == "reset"
    page.tab.click("#play")
    page.tab.wait_for_selector("#problem", state="hidden")
    page.tab.wait_for_function("() => window.live.live.counted > 3")
    assert page.tab.inner_text("#dt-says") == "0.00200 s" and page.tab.is_hidden("#above")


SCENES = {
    "swing": swing(),
    "strip, undamped": cs.Scene(cs.Cloth((2, 9), damping=0.0)),
    "bend alone": cs.Scene(cs.Cloth((9, 9), springs=("bend",), drag=3.0)),
    "mass per point": cs.Scene(
        cs.Cloth((5, 6), mass=np.linspace(0.5, 2.0, 30).reshape(5, 6), pins=((2, 2),))
    ),
}


@pytest.mark.parametrize("name", SCENES)
def test_the_guarantee_is_that_of_python_for_all_coefficients(live, name):
    scene = SCENES[name]
    page = live(scene)
    pause(page)
    rng = np.random.default_rng(3)
    for _ in range(20):
        stiffness, damping = (
            {f: 10 ** rng.uniform(-1, 5) for f in scene.cloth.springs} for _ in range(2)
        )
        drag = float(10 ** rng.uniform(-1, 4))
        cloth = scene.cloth.replace(stiffness=stiffness, damping=damping, drag=drag)
        found = page.tab.evaluate(
            "(a) => guaranteed(window.live.live.data, ...a)", [stiffness, damping, drag]
        )
        assert found == pytest.approx(
            cs.max_stable_dt(scene.replace(cloth=cloth)), rel=1e-12, abs=0
        )
    assert page.tab.evaluate("() => window.live.live.limit") == pytest.approx(
        cs.max_stable_dt(scene), rel=1e-12, abs=0
    )


def test_controls_change_the_scene_and_the_file_has_it(live):
    motion = cs.Keyframes([0.0, 1.0], [(0.5, -0.29, 0.5), (0.5, -0.2, 0.5)])
    scene = draped(motion=motion, friction=0.1, restitution=1.0)
    scene = scene.replace(
        cloth=scene.cloth.replace(damping={"structural": 100.0, "shear": 50.0, "bend": 0.0})
    )
    page = live(scene)
    pause(page)
    set_slider(page, "gravity", 20.0)
    set_slider(page, "stiffness", 1)
    set_slider(page, "damping", 200)
    set_slider(page, "radius", 0.5)
    page.tab.click("#live summary")
    set_slider(page, "shear", -1)
    set_slider(
        page, "drag", page.tab.evaluate("() => Number(document.getElementById('drag').max) / 2")
    )
    set_slider(page, "restitution", 0.25)
    page.tab.select_option("#method", label="1 (reflect)")
    page.tab.select_option("#offset", label="none")
    page.tab.evaluate("() => { window.live.live.drags[0] = { by: [0.1, 0, 0], to: [0.1, 0, 0] }; }")
    idle(page)
    with page.tab.expect_download() as download:
        page.tab.click("#save-scene")
    changed = cs.load_scene(download.value.path())
    cloth, sphere = changed.cloth, changed.spheres[0]
    data = page.tab.evaluate(
        "(({ stiffness, damping, drag }) => ({ stiffness, damping, drag }))(window.live.live)"
    )
    assert changed.gravity == pytest.approx((0, -20, 0), abs=0.5) and 0 < cloth.drag == data["drag"]
    assert cloth.family_stiffness == data["stiffness"] and cloth.family_damping == data["damping"]
    assert cloth.family_stiffness["structural"] == pytest.approx(
        2 * cloth.family_stiffness["shear"], rel=0.3
    )
    assert (
        cloth.family_damping["structural"]
        == pytest.approx(200, rel=0.1)
        == 2 * cloth.family_damping["shear"]
    )
    assert (sphere.response, sphere.offset) == ("reflect", "none")
    assert sphere.restitution == pytest.approx(0.25, abs=0.1)
    assert sphere.friction == 0.1 and sphere.motion.centers[1].tolist() == [0.6, -0.2, 0.5]
    assert page.said == [] and page.tab.is_hidden("#problem")
    page.tab.click("#reset")
    page.tab.wait_for_function(
        "() => window.live.live.spheres[0].radius === 0.25 && window.live.live.gravity[1] > -10"
    )
    idle(page)
    with page.tab.expect_download() as download:
        page.tab.click("#save-scene")
    assert cs.load_scene(download.value.path()) == scene


def saved(page):
    """Return the scene that the page saves."""
    with page.tab.expect_download() as download:
        page.tab.evaluate("document.getElementById('save-scene').click()")
    return cs.load_scene(download.value.path())


MOVED = cs.Keyframes([0.0, 1.0], [(0.0, -0.6, 0.0), (0.0, -0.5, 0.0)])


@pytest.mark.parametrize(
    "planes",
    [
        [cs.Plane((0.0, -0.6, 0.0))],
        [cs.Plane((0.0, -0.6, 0.0), (1.0, 3.0, 0.0), friction=0.3, response="ray")],
        [
            cs.Plane(motion=MOVED, response="reflect"),
            cs.Plane((0, -1, 0), motion=cs.Linear((0, 1, 0))),
        ],
        [
            cs.Plane((0.0, -0.6, 0.0), response="reflect", restitution=0.5),
            ball(),
            ball(center=(3, 0, 0), offset=0.01),
        ],
    ],
    ids=["floor", "slope", "moving", "among spheres"],
)
def test_a_scene_with_planes_is_saved_as_it_is(live, planes):
    scene = cs.Scene(cs.Cloth((8, 8)), planes)
    page = live(scene)
    pause(page)
    assert saved(page) == scene
    page.tab.select_option("#method", label="1, as printed")
    idle(page)
    found = saved(page).spheres
    assert [one.response for one in found] == ["reflect"] * len(planes)
    assert [one.as_printed for one in found] == [isinstance(one, cs.Sphere) for one in planes]
    page.tab.select_option("#method", label="penalty")
    idle(page)
    found = saved(page).spheres
    assert [one.response for one in found] == ["penalty"] * len(planes)
    assert [type(one) for one in found] == [type(one) for one in planes]
    assert all(one.restitution is None for one in found)
    assert page.said == [] and page.tab.is_hidden("#problem")


def test_an_exception_in_a_handler_is_told_and_stays_told(live):
    page = live(draped())
    page.tab.evaluate("() => { window.live.live.spheres[0].center = null; }")
    page.tab.evaluate("document.getElementById('save-scene').click()")
    page.tab.wait_for_selector("#problem", state="visible")
    page.tab.evaluate("tell('')")
    assert page.tab.inner_text("#problem").startswith("This page has failed: ")
    assert "null" in page.tab.inner_text("#problem")


def test_a_method_has_the_restitution_of_python(live):
    """A sphere without one of its own takes that of its response."""
    scene = draped(response="ray")
    page = live(scene)
    pause(page)
    page.tab.click("#live summary")
    methods = ("ray", "2 (ray)"), ("reflect", "1 (reflect)"), ("penalty", "penalty")
    for response, name in (*methods, methods[0]):
        changed = scene.replace(spheres=scene.spheres[0].replace(response=response))
        page.tab.select_option("#method", label=name)
        idle(page)
        assert page.tab.is_visible("#restitution") == (response != "penalty")
        assert page.tab.is_visible("#thickness") == (response == "penalty")
        assert page.tab.evaluate("live.live.restitution(0)") == changed.spheres[0].restitution
        if response != "penalty":
            shown = float(page.tab.text_content("#restitution-says"))
            assert shown == changed.spheres[0].restitution
        assert saved(page) == changed
        (planes, _), _ = after(page, 500)
        cpu = core_after(changed, 500).positions
        assert np.abs(planes[:3].T.reshape(cpu.shape) - cpu).max() < 1e-4


def test_a_restitution_and_a_layer_are_saved_where_their_response_is(live):
    floor = cs.Plane((0.0, -0.6, 0.0), dissipation=0.75)
    scene = cs.Scene(cs.Cloth((8, 8)), [floor, ball(restitution=0.5)])
    page = live(scene)
    pause(page)
    page.tab.click("#live summary")
    assert page.tab.text_content("#restitution-says") == "0.50"
    assert page.tab.text_content("#dissipation-says") == "0.75 s/m"
    set_slider(page, "restitution", 0.25)
    set_slider(page, "thickness", 1)
    plane, sphere = saved(page).spheres
    layer = scene.spheres[0].layer(scene.cloth)
    assert plane.thickness == pytest.approx(2 * layer["thickness"], rel=0.1)
    assert sphere.restitution == pytest.approx(0.25, abs=0.01)
    assert sphere.thickness is None and plane.restitution is None
    page.tab.select_option("#method", label="penalty")
    idle(page)
    plane, sphere = saved(page).spheres
    assert sphere.thickness == pytest.approx(plane.thickness, rel=0.1)
    assert sphere.restitution is None
    page.tab.select_option("#method", label="2 (ray)")
    idle(page)
    plane, sphere = saved(page).spheres
    assert plane.restitution == sphere.restitution == pytest.approx(0.25, abs=0.01)
    assert plane.thickness is None and sphere.dissipation is None
    page.tab.click("#reset")
    idle(page)
    assert page.tab.text_content("#thickness-says") == "x 1" and saved(page) == scene
    assert page.said == [] and page.tab.is_hidden("#problem")


def test_free_cloth_has_the_bits_of_the_gather_kernel_with_the_coefficients_of_the_controls(
    live, same_bits
):
    """What a scene lacks is compiled in when a control brings it."""
    scene = swing().replace(cloth=swing().cloth.replace(damping=0.0))
    page = live(scene)
    pause(page)
    changed = {"damping": {"structural": 2.0, "shear": 1.0, "bend": 0.5}, "drag": 0.3}
    changed["stiffness"] = {**scene.cloth.family_stiffness, "shear": 1000.0}
    apply = (
        "(c) => window.live.then(() => "
        "{ Object.assign(window.live.live, c); return window.live.live.apply(); })"
    )
    page.tab.evaluate(apply, changed)
    found, out = after(page, 1000)
    scene = scene.replace(cloth=scene.cloth.replace(**changed))
    cpu = core_after(scene, 1000)
    assert same_bits(found, parts(cpu)) and out["time"] == cpu.time
    assert np.abs(cpu.positions - scene.initial_position).max() > 0.1
    assert out["total"] == pytest.approx(
        cs.energy(scene, cpu.positions, cpu.velocities)["total"], rel=1e-5, abs=0
    )


def test_the_recording_is_a_page_of_its_own(live, opened, tmp_path):
    scene = draped(offset="none")
    page = live(scene.replace(spheres=[*scene.spheres, cs.Plane((0.0, -0.8, 0.0))]))
    page.tab.wait_for_function("() => window.live.live.t.length > 8")
    pause(page)
    idle(page)
    script = """(run) => {
      const last = run.t.length - 1;
      const values = ["speed", "stretch"].map((name) => run.value(name, last, 37));
      return { t: [...run.t], x: [...run.positions(last)], values };
    }"""
    seen = page.tab.evaluate(f"() => ({script})(window.live.live)")
    with page.tab.expect_download() as download:
        page.tab.click("#live summary")
        page.tab.click("#save-run")
    path = tmp_path / "recording.html"
    download.value.save_as(path)
    assert b"data-live" not in path.read_bytes() and b"://" not in path.read_bytes()
    stored = opened(path)
    stored.ready()
    found = stored.tab.evaluate(f"() => ({script})(page.runs[0])")
    assert found["t"] == seen["t"] and np.abs(np.subtract(found["x"], seen["x"])).max() < 3e-5
    assert stored.tab.evaluate("page.runs[0].lines(1)") == [[1, 0, 0], [0, 0, -1]]
    assert found["values"] == pytest.approx(seen["values"], rel=0.05, abs=1e-4)
    assert stored.said == page.said == [] and stored.asked == [path.as_uri()]
    assert (
        stored.tab.locator("#curves canvas").count() == 3
        and stored.tab.locator("#live").count() == 0
    )


def test_one_step_is_one_step(live):
    page = live(draped())
    pause(page)
    idle(page)
    before = page.tab.evaluate("() => window.live.live.counted")
    page.tab.keyboard.press("ArrowRight")
    idle(page)
    assert page.tab.evaluate("() => window.live.live.counted") == before + 1
    page.tab.keyboard.press("Home")
    assert page.tab.inner_text("#says-0").startswith("t = 0.0000 s, energy ")
    page.tab.keyboard.press("End")
    page.tab.keyboard.press("Space")
    page.tab.wait_for_function("(n) => window.live.live.counted > n", arg=before + 2)


def test_the_list_of_methods_has_those_of_python(live):
    options = {"offset": "cell", "restitution": 0.0, "motion": cs.Linear((0.1, 0.3, 0.0))}
    page = live(draped(**options))
    pause(page)
    names = page.tab.locator("#method option").all_inner_texts()
    paper = ["1 (reflect)", "1, as printed", "2 (ray)", "2, as printed"]
    assert names == ["penalty", *paper]
    expected, responses = [], ("reflect", "reflect", "ray", "ray")
    for name, response, printed in zip(paper, responses, (0, 1, 0, 1), strict=True):
        page.tab.select_option("#method", label=name)
        idle(page)
        (planes, _), _ = after(page, 250)
        cpu = core_after(
            draped(response=response, as_printed=bool(printed), **options), 250
        ).positions
        assert np.abs(planes[:3].T.reshape(cpu.shape) - cpu).max() < 1e-5, name
        assert all(np.abs(other - cpu).max() > 1e-4 for other in expected), name
        expected.append(cpu)


LAYERED = {
    "sphere": (ball(response="penalty", offset="cell"),),
    "plane, rough": (cs.Plane((0.0, -0.1, 0.0), (0.1, 1.0, 0.05), friction=0.4),),
    "two": (
        ball(response="penalty", friction=0.3),
        cs.Plane((0.0, -0.1, 0.0), motion=cs.Sinusoid((0.0, 0.02, 0.0), 5.0)),
    ),
    "moving": (ball(response="penalty", motion=cs.Linear((0.1, 0.5, 0.0))),),
}


@pytest.mark.parametrize("name", LAYERED)
def test_a_layer_has_the_bits_of_the_gather_kernel(live, same_bits, name):
    scene = cs.Scene(cs.Cloth((16, 16)), LAYERED[name])
    page = live(scene)
    pause(page)
    found, out = after(page, 500)
    cpu, free = core_after(scene, 500), core_after(scene.replace(spheres=()), 500)
    assert same_bits(found, parts(cpu))
    assert np.abs(cpu.positions - free.positions).max() > 1e-2
    energy = cs.energy(scene, cpu.positions, cpu.velocities, cpu.time)
    assert energy["contact"] > 0
    assert out["total"] == pytest.approx(energy["total"], rel=1e-5)


def test_a_dragged_sphere_has_the_velocity_of_its_travel(live):
    scene = draped(response="penalty", friction=0.3, offset="cell")
    page = live(scene)
    pause(page)
    after(page, 300)
    planes = page.tab.evaluate("""async () => {
      const { live, then } = window.live;
      await then(async () => {
        live.drags[0].to = [0.02, 0.02, 0];
        for (let k = 0; k < 2; k++) await live.advance(100);
      });
      return [...live.planes];
    }""")
    stepper = cs.Stepper(scene, precision="single", kernel="gather", threads=1, t=0.0)
    stepper.advance(300, DT)
    center = np.add(ball().center, (0.02, 0.02, 0))
    stepper.advance(100, DT, centers={0: center})
    stepper.advance(100, DT)
    x = np.array(planes).reshape(6, -1)[:3].T.reshape(stepper.x.shape)
    np.testing.assert_allclose(x, stepper.x, rtol=0, atol=1e-6)
    still = core_after(
        scene.replace(spheres=ball(response="penalty", offset="cell").replace(center=center)), 500
    )
    assert np.abs(still.x - stepper.x).max() > 1e-4


def test_the_parameters_of_a_layer_have_sliders_and_are_saved(live):
    scene = draped(response="penalty", friction=0.1, dissipation=0.5)
    page = live(scene)
    pause(page)
    page.tab.click("#live summary")
    assert page.tab.is_hidden("#restitution")
    set_slider(page, "thickness", 1)
    set_slider(page, "layer-stiffness", -1)
    set_slider(page, "dissipation", 1.5)
    set_slider(page, "friction", 0.25)
    with page.tab.expect_download() as download:
        page.tab.click("#save-scene")
    changed = cs.load_scene(download.value.path()).spheres[0]
    layer = scene.spheres[0].layer(scene.cloth)
    assert changed.thickness == pytest.approx(2 * layer["thickness"], rel=0.1)
    assert changed.stiffness == pytest.approx(layer["stiffness"] / 2, rel=0.1)
    assert changed.dissipation == pytest.approx(1.5, abs=0.05)
    assert changed.friction == pytest.approx(0.25, abs=0.02)
    assert changed.slip_speed is None
    found, _ = after(page, 500)
    x = core_after(scene.replace(spheres=changed), 500).positions
    np.testing.assert_array_equal(found[0][:3].T.reshape(x.shape), x.astype(np.float32))
    page.tab.select_option("#method", label="2 (ray)")
    idle(page)
    assert page.tab.is_hidden("#thickness") and page.tab.is_visible("#restitution")
    page.tab.click("#reset")
    idle(page)
    assert page.tab.is_visible("#thickness")
    set_slider(page, "stiffness", 1)  # of the cloth, which the layer does not follow
    with page.tab.expect_download() as download:
        page.tab.click("#save-scene")
    changed = cs.load_scene(download.value.path()).spheres[0]
    assert changed.layer(scene.cloth) == layer and changed.stiffness == layer["stiffness"]


def place(page, point):
    """Return the pixel of the tab where a point [m] is seen."""
    script = """(p) => {
      const { camera } = window.live, canvas = document.getElementById("canvas-0");
      const box = canvas.getBoundingClientRect();
      const [right, up] = camera.axes(), metre = camera.metre(canvas);
      const along = (axis) =>
        axis.reduce((sum, k, i) => sum + k * (p[i] - camera.target[i]), 0) / metre;
      return [box.left + box.width / 2 + along(right), box.top + box.height / 2 - along(up)];
    }"""
    return page.tab.evaluate(script, list(point))


def test_a_mouse_drags_spheres_and_pins_and_turns_and_zooms(live):
    page = live(draped(response="penalty", offset="cell"))
    mouse = page.tab.mouse
    page.tab.hover("#canvas-0")  # the view no longer follows the cloth
    for place_now, point in (
        ("window.live.live.centerNow(0)", ball().center),
        ("[0, 1, 2].map((k) => window.live.live.planes[k * window.live.live.points])", (0, 0, 0)),
    ):
        x, y = place(page, point)
        start = page.tab.evaluate(place_now)
        mouse.move(x, y)
        mouse.down()
        mouse.move(x - 40, y + 10, steps=4)
        page.tab.wait_for_function(
            f"(s) => Math.hypot(...{place_now}.map((k, i) => k - s[i])) > 0.02", arg=start
        )
        held = page.tab.inner_text("#held")
        assert held == ("pin (0, 0) is held." if point == (0, 0, 0) else "")
        mouse.up()
    idle(page)
    assert page.tab.evaluate("() => Math.max(...window.live.live.curves.triangles)") == 0
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


def fingers(page, kind, *points):
    """Touch the page of that tab."""
    touch = {
        "type": kind,
        "touchPoints": [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(points)],
    }
    session = vars(page).setdefault("session", page.context.new_cdp_session(page.tab))
    session.send("Input.dispatchTouchEvent", touch)


def test_two_fingers_turn_and_zoom_and_one_drags_a_sphere(live):
    page = live(draped(), has_touch=True)
    page.tab.evaluate(
        "() => { window.live.camera.byHand = true; }"
    )  # the view no longer follows the cloth
    x, y = place(page, ball().center)
    fingers(page, "touchStart", (x, y))
    fingers(page, "touchMove", (x + 40, y))
    page.tab.wait_for_function("() => Math.hypot(...window.live.live.drags[0].by) > 0.02")
    fingers(page, "touchEnd")
    angle = page.tab.evaluate("() => window.live.camera.azimuth")
    box = page.tab.locator("#canvas-0").bounding_box()
    x, y = box["x"] + 8, box["y"] + 8
    fingers(page, "touchStart", (x, y))
    fingers(page, "touchStart", (x, y), (x + 40, y))
    fingers(page, "touchMove", (x, y), (x + 120, y))
    page.tab.wait_for_function(
        "(angle) => window.live.camera.zoom > 1.5 && window.live.camera.azimuth !== angle",
        arg=angle,
    )
    fingers(page, "touchEnd")


def test_one_finger_scrolls_the_page_and_controls_stay_at_hand(live):
    page = live(draped(), has_touch=True, is_mobile=True)
    pause(page)
    page.tab.set_viewport_size({"width": 390, "height": 700})
    box = page.tab.locator("#canvas-0").bounding_box()
    x, y, angle = box["x"] + 10, box["y"] + box["height"] - 10, "() => window.live.camera.azimuth"
    before = page.tab.evaluate(angle)
    fingers(page, "touchStart", (x, y))
    for k in range(1, 11):
        fingers(page, "touchMove", (x, y - 10 * k))
    fingers(page, "touchEnd")
    page.tab.wait_for_function("() => scrollY > 50")
    assert page.tab.evaluate(angle) == before
    play = page.tab.locator("#play").bounding_box()
    assert play["y"] > 600 and play["y"] + play["height"] <= 700


def seen(page):
    """Return the pixels of the stage, shape (height, width, 3)."""
    return np.asarray(
        Image.open(BytesIO(page.tab.locator("#canvas-0").screenshot())).convert("RGB")
    ).astype(int)


def red_pixels(page, draw):
    """Return the red pixels of five views, each drawn by `draw` of the camera."""
    red = 0
    for direction in ((1, 0.6, 1.3), (0, -1, 0.01), (1, -0.3, 0), (-1, 0.2, -1), (0, 1, 0.01)):
        script = (
            f"(d) => {{ const {{ camera }} = {draw}; camera.reset(d); camera.enlarge(2); "
            f"{draw}.redraw(); }}"
        )
        page.tab.evaluate(script, direction)
        r, g, b = np.moveaxis(seen(page), 2, 0)
        # The back of the cloth is sand, which has less blue.
        red += ((r - g > 25) & (abs(g - b) < 15)).sum()
    return red


@pytest.mark.parametrize("obstacle", ["cell", "none", "plane"])
def test_red_is_shown_where_cloth_is_inside_and_nowhere_else(live, opened, tmp_path, obstacle):
    plane = cs.Scene(cs.Cloth((16, 16), pins=()), cs.Plane((0, -0.1, 0)))
    response = "ray" if obstacle == "none" else "penalty"
    scene = plane if obstacle == "plane" else draped(response=response, offset=obstacle)
    page = live(scene)
    pause(page)
    _, out = after(page, 500)
    page.tab.evaluate("() => { const { page, live } = window.live; page.show(live.time, true); }")
    stored = opened(cs.simulate(scene, 500 * DT, dt=DT, every=0.05).to_html(tmp_path / "run.html"))
    stored.ready()
    for one, draw in ((page, "window.live.page"), (stored, "window.page")):
        assert (red_pixels(one, draw) > 0) == (obstacle == "none") == (out["triangles"] > 1e-6)
        assert np.ptp(seen(one), axis=(0, 1)).max() > 100 and one.said == []


def test_pins_are_seen_in_both_themes_and_the_cloth_fills_the_stage(live):
    page = live(draped(), color_scheme="dark")
    page.tab.wait_for_function("() => window.live.live.time > 0.05")
    pause(page)
    page.tab.evaluate("""() => {
      const { live, camera, page } = window.live;
      for (let k = 0; k < 50; k++) camera.follow(live.positions(live.t.length - 1), [], 1);
      page.redraw();
    }""")
    for scheme, background in (("dark", (20, 24, 29)), ("light", (255, 255, 255))):
        page.tab.emulate_media(color_scheme=scheme)
        idle(page)
        pixels = seen(page)
        assert tuple(pixels[2, 2]) == background
        x, y, _ = page.tab.evaluate(
            "() => window.live.camera.projection(document.getElementById('canvas-0'))([0, 0, 0], 0)"
        )
        assert abs(pixels[round(y), round(x)] - background).min() > 100
        rows = np.flatnonzero((abs(pixels - background) > 20).any(axis=(1, 2)))
        assert np.ptp(rows) > 0.7 * len(pixels)


def test_a_lost_device_is_named(live):
    page = live(swing())
    page.tab.evaluate("() => window.live.solver.device.destroy()")
    page.tab.wait_for_function(
        "() => document.getElementById('problem').textContent.includes('was lost')"
    )
    assert not page.tab.evaluate("() => window.live.page.state.playing")


def test_without_webgpu_it_says_so_and_plays_a_run(opened, tmp_path):
    path = tmp_path / "live.html"
    text = draped().to_live_html(path).read_text(encoding="utf-8")
    path.write_text(
        text.replace(
            "<script>",
            "<script>\nObject.defineProperty(navigator, 'gpu', { value: undefined });",
            1,
        ),
        encoding="utf-8",
    )
    page = opened(path)
    page.ready()
    assert "Chrome and Edge from 113" in page.tab.inner_text("#problem")
    assert (
        page.tab.is_visible("#canvas-0")
        and page.tab.is_hidden("#live")
        and page.tab.evaluate("page.end()") == 2
    )
    page.tab.click("#play")
    page.tab.wait_for_function("() => page.state.t > 0.1 && page.state.t < 1.9")
    assert page.said == []


def test_a_scene_that_the_shader_lacks_is_refused(tmp_path):
    scene = draped()
    scene = scene.replace(force=np.ones_like(scene.initial_position))
    with pytest.raises(ValueError, match="^force must be None"):
        scene.to_live_html(tmp_path / "live.html")
