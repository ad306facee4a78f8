"""Figures of pages, notebooks and the live viewer: the tables of docs/look.md and docs/dev/view.md.

    python benchmarks/view.py [picture] [page] [import] [live] [k3d]

"picture" needs Pillow and ffmpeg, "page" Chromium and playwright (`make test-view` installs both), "live"
viser, "k3d" k3d. A busy machine gives worse figures: each is the best of a few trials, the median stands
beside it, and the load ends the output.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import which
from typing import Any

import clothsim as cs
import numpy as np

FRAMES = 300
TRIALS = 5
# WebGL on the processor: the machine of a test has no graphics adapter.
FLAGS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--no-sandbox"]
SIZE = {"width": 760, "height": 640}
# Of a snapshot of k3d, the time at which its scene is loaded and two pictures have been drawn.
K3D_READY = """(async () => {
  while (!window.K3DInstance) await new Promise((done) => setTimeout(done, 5));
  await window.K3DInstance;
  for (const _ of [1, 2]) await new Promise(requestAnimationFrame);
  document.body.dataset.ready = Math.round(performance.now());
})()"""


def run_of_the_paper() -> cs.Run:
    """300 frames of 32 x 32 mass points that meet the sphere."""
    return cs.simulate(cs.scenes.paper_static("reflect"), 1.5, dt=5e-4, every=1.5 / (FRAMES - 1))


@contextmanager
def chromium() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    program = next(filter(None, map(which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if program is None:
        raise SystemExit("no Chromium on the PATH: `make test-view` installs it")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=FLAGS)
        yield browser
        browser.close()


def trials(measure: Callable[[], float], count: int = TRIALS) -> str:
    """Smallest and median of a few measurements."""
    found = [measure() for _ in range(count)]
    return f"{min(found):.2f} (median {statistics.median(found):.2f})"


def seconds(action: Callable[[], Any]) -> float:
    begun = time.perf_counter()
    action()
    return time.perf_counter() - begun


def cpu_seconds(action: Callable[[], Any]) -> float:
    begun = time.process_time()
    action()
    return time.process_time() - begun


class Page:
    """A page from a file, with its requests and the messages of its console."""

    def __init__(self, browser: Any, path: Path, script: str = "") -> None:
        self.context = browser.new_context(viewport=SIZE)
        self.tab = self.context.new_page()
        self.said: list[str] = []
        self.asked: list[str] = []
        self.tab.on("console", lambda message: self.said.append(message.text))
        self.tab.on("pageerror", lambda error: self.said.append(str(error)))
        self.tab.on("request", lambda request: self.asked.append(request.url))
        self.tab.goto(path.as_uri())
        if script:
            self.tab.evaluate(script)
        self.tab.wait_for_selector("body[data-ready]", state="attached", timeout=120_000)
        self.ready = int(self.tab.evaluate("document.body.dataset.ready")) / 1000

    def close(self) -> None:
        self.context.close()


def first_picture(browser: Any, path: Path, script: str = "") -> float:
    page = Page(browser, path, script)
    page.close()
    return page.ready


# Pictures and films -------------------------------------------------------------------------------


def picture_figures() -> list[tuple[str, str, str]]:
    """The paper's cloth on the sphere. Pictures are in processor time, which a busy machine changes less."""
    run = cs.simulate(cs.scenes.paper_static(), 1.5, dt=1e-4, every=1.5 / 180)
    close = cs.Camera((1, 0.6, 1.3), target=(0.5, -0.3, 0.5), width=0.4, height=0.3)
    rows = []
    processors = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(processors)})
    looks: list[tuple[str, str, dict[str, Any]]] = [
        ("`run.picture`, 640 wide, one thread", "at most 25 ms", {}),
        ("with shadow, ground, stretch and label", "", {"shadow": True, "ground": True, "color": "stretch", "label": True}),
        ("close up, 1,200 wide, one thread", "", {"camera": close, "width": 1200}),
    ]
    for name, goal, look in looks:
        rows.append(
            (name, goal, f"{trials(lambda look=look: 1e3 * cpu_seconds(lambda: run.picture(t=0.5, **look)), 15)} ms")
        )
    os.sched_setaffinity(0, processors)
    with tempfile.TemporaryDirectory() as folder:
        for suffix, goal in (("webp", "at most 12 s"), ("mp4", "at most 8 s"), ("gif", "")):
            path, fps = Path(folder, f"a.{suffix}"), 50 if suffix == "gif" else 120
            begun, used = time.perf_counter(), sum(os.times()[:4])
            run.animate(path, fps=fps, speed=fps / 120)
            wall, used = time.perf_counter() - begun, sum(os.times()[:4]) - used
            rows.append((f"film of 181 pictures as {suffix}", goal, f"{wall:.1f} s ({used:.1f} s of processor time)"))
    return rows


# What is asked of a page --------------------------------------------------------------------------


def page_figures() -> list[tuple[str, str, str]]:
    run = run_of_the_paper()
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        path = run.to_html(Path(folder, "run.html"))
        size = path.stat().st_size / 1e6
        run.show()  # imports
        rows = [
            ("page of 300 frames of 32 x 32", "at most 3 MB", f"{size:.2f} MB"),
            ("`run.show()` of 300 frames", "under 1 s", f"{trials(lambda: seconds(run.show))} s"),
            ("its processor time", "", f"{trials(lambda: cpu_seconds(run.show))} s"),
            ("first picture", "under 1 s", f"{trials(lambda: first_picture(browser, path))} s"),
        ]
        page = Page(browser, path)
        page.tab.wait_for_timeout(200)
        rows += playback(page)
        rows.append(("requests beside the file", "0", str(len(page.asked) - 1)))
        rows.append(("messages in the console", "0", str(len(page.said))))
        page.close()
    return rows


def playback(page: Page) -> list[tuple[str, str, str]]:
    """Play for a second: pictures, and how far the shown frame is from the clock's."""
    script = """() => new Promise((done) => {
      document.getElementById("speed").value = "1";
      document.getElementById("play").click();
      const begun = performance.now(), run = page.runs[0];
      let pictures = 0, wrong = 0, spent = 0;
      const look = (now) => {
        pictures += 1;
        if (Number(document.querySelector("#runs canvas").dataset.frame) !== run.frameAt(page.state.t)) wrong += 1;
        if (now - begun < 1000) requestAnimationFrame(look);
        else {
          const from = performance.now();
          const slider = document.getElementById("time");
          for (let k = 0; k < 60; k++) { slider.value = (5 * k) % run.t.length; slider.dispatchEvent(new Event("input")); }
          spent = performance.now() - from;
          done([1000 * pictures / (now - begun), wrong, spent / 60]);
        }
      };
      requestAnimationFrame(look);
    })"""
    rate, wrong, spent = page.tab.evaluate(script)
    return [
        ("pictures in a second of playing, drawn by the processor", "60 with a graphics adapter", f"{rate:.0f}"),
        ("script of a picture", "under 16.7 ms", f"{spent:.1f} ms"),
        ("pictures whose frame is not the clock's", "0", str(wrong)),
    ]


def import_figures() -> list[tuple[str, str, str]]:
    names = ("clothsim.viewing", "viser", "k3d", "matplotlib", "PIL")
    script = f"import sys, clothsim; print(sum(m.startswith({names}) for m in sys.modules))"
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.strip()
    return [("modules of the viewer that `import clothsim` loads", "0", found)]


# The live viewer ----------------------------------------------------------------------------------


def live_figures() -> list[tuple[str, str, str]]:
    viewer = cs.view(cs.scenes.paper_static(), block=False, dt=1e-4, port=8137)
    play, drawn = viewer.playground, []
    draw = viewer.stage.draw
    viewer.stage.draw = lambda: (draw(), drawn.append(time.perf_counter()))  # type: ignore[method-assign,assignment,return-value]
    rows = []
    try:
        for clients in (0, 1):
            with chromium() as browser:
                if clients:
                    page = browser.new_page(viewport={"width": 500, "height": 400})
                    page.goto(viewer.url)
                    page.get_by_text("stable step").wait_for(timeout=120_000)
                factors, rates, costs = [], [], []
                for _ in range(TRIALS):
                    drawn.clear()
                    t, begun, used = play.time, time.perf_counter(), time.process_time()
                    time.sleep(2.0)
                    passed = time.perf_counter() - begun
                    costs.append((time.process_time() - used) / (play.time - t))
                    factors.append((play.time - t) / passed)
                    rates.append(len(drawn) / passed)
                where = "a browser that draws on the same processors" if clients else "no browser"
                best, median = max(factors), statistics.median(factors)
                rows.append((f"real time at dt 1e-4, {where}", "1.0", f"{best:.2f} (median {median:.2f})"))
                best, median = max(rates), statistics.median(rates)
                rows.append((f"pictures sent in a second, {where}", "30", f"{best:.1f} (median {median:.1f})"))
                best, median = min(costs), statistics.median(costs)
                rows.append((f"processor time of a simulated second, {where}", "", f"{best:.2f} s (median {median:.2f} s)"))
        changes = [seconds(lambda k=k: play.change(gravity=9.0 + 0.1 * k)) for k in range(20)]
        rows.append(("a slider's change, to the scene that is stepped", "under 0.2 s", f"{max(changes):.3f} s at most"))
    finally:
        viewer.stop()
    return rows


# k3d ----------------------------------------------------------------------------------------------


def k3d_figures() -> list[tuple[str, str, str]]:
    """The same run as a page of ours and as a snapshot of k3d."""
    run = run_of_the_paper()
    rows = []
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        ours, theirs, three = (Path(folder, name) for name in ("ours.html", "k3d.html", "three.html"))
        times = [
            seconds(lambda: run.to_html(ours)),
            seconds(lambda: snapshot(run, theirs, 1)),
            seconds(lambda: snapshot(run, three, 3)),
        ]
        files = ((ours, ""), (theirs, K3D_READY), (three, K3D_READY))
        sizes = [path.stat().st_size / 1e6 for path, _ in files]
        pictures = [
            trials(lambda path=path, script=script: first_picture(browser, path, script), 3) for path, script in files
        ]
    rows.append(("bytes [MB]", *(f"{size:.2f}" for size in sizes)))
    rows.append(("writing [s]", *(f"{one:.1f}" for one in times)))
    rows.append(("first picture [s]", *pictures))
    return rows  # type: ignore[return-value]


def snapshot(run: cs.Run, path: Path, colours: int) -> None:
    """A self-contained page of k3d, with a mesh for each of so many colours of the cloth."""
    import k3d

    plot = k3d.plot(grid_visible=False)
    corners = cs.triangles(run.scene.cloth.shape).astype(np.uint32)
    keys = [f"{t:.6f}" for t in run.t]
    (sphere,) = run.scene.spheres
    depth = sphere.radius - np.linalg.norm(run.x - sphere.center, axis=-1)
    values = [np.linalg.norm(run.x - run.x[0], axis=-1), np.linalg.norm(run.v, axis=-1), depth.clip(0)]
    vertices = {key: x.reshape(-1, 3).astype(np.float32) for key, x in zip(keys, run.x)}
    for one in values[:colours]:
        flat = one.reshape(len(keys), -1).astype(np.float32)
        series = dict(zip(keys, flat))
        plot += k3d.mesh(vertices, corners, attribute=series, color_range=[0, float(flat.max())], side="double")
    plot += k3d.points(np.array([sphere.center], np.float32), point_size=2 * sphere.radius, shader="3dSpecular")
    path.write_text(plot.get_snapshot(9), encoding="utf-8")


PARTS = {
    "picture": picture_figures,
    "page": page_figures,
    "import": import_figures,
    "live": live_figures,
    "k3d": k3d_figures,
}


def main(parts: list[str]) -> None:
    for name in parts or PARTS:
        if name not in PARTS:
            raise SystemExit(f"parts are {', '.join(PARTS)}, got {name!r}")
        head = (
            ("page", "ours", "k3d, a colour", "k3d, three colours") if name == "k3d" else ("figure", "to reach", "measured")
        )
        print(f"\n| {' | '.join(head)} |\n|{' --- |' * len(head)}")
        for row in PARTS[name]():
            print(f"| {' | '.join(row)} |", flush=True)
    print(f"\n{os.cpu_count()} processors, load average {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main(sys.argv[1:])
