"""Film the live page in headless Chromium: `python tools/film_live.py FILE.webp`.

Needs Chromium, Pillow and playwright. A mouse takes the sphere and leads it below and into the
cloth. The page is paused and takes the steps of each picture at once. So the film runs in real
time, made on any machine. WebGPU runs on the processor.
"""

from __future__ import annotations

import math
import sys
import tempfile
from pathlib import Path
from shutil import which

import clothsim as cs
from PIL import Image
from playwright.sync_api import sync_playwright

FLAGS = [
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--no-sandbox",
]
FLAGS += ["--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader"]
RATE = 15  # pictures a second
SECONDS = 4.0  # length of the film
SIZE = 480, 375  # pixels
DT = 5e-4  # s
# The steps of a picture; the button takes the last of them, and draws.
STEPS = """async (steps) => {
  const { live, then } = window.live;
  await then(() => live.advance(steps - 1));
  document.getElementById("forth").click();
  await then(() => {});
}"""
PIXEL = """(p) => {
  const { camera } = window.live, canvas = document.getElementById("canvas-0");
  const box = canvas.getBoundingClientRect();
  const [right, up] = camera.axes(), metre = camera.metre(canvas);
  const along = (axis) =>
    axis.reduce((sum, k, i) => sum + k * (p[i] - camera.target[i]), 0) / metre;
  return [box.left + box.width / 2 + along(right), box.top + box.height / 2 - along(up), metre];
}"""


def main() -> None:
    file = Path(sys.argv[1])
    ball = cs.Sphere((0.5, -0.45, 0.5), 0.25, friction=0.1)
    scene = cs.Scene(cs.Cloth(springs=("structural", "shear")), ball)
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        chromium = playwright.chromium.launch(
            executable_path=which("chromium") or which("google-chrome"), args=FLAGS
        )
        tab = chromium.new_page(viewport={"width": 640, "height": 500})
        tab.goto(
            scene.to_live_html(
                folder / "live.html", dt=DT, title="clothsim, live in the browser"
            ).as_uri()
        )
        tab.wait_for_selector("body[data-ready]")
        tab.click("#play")
        tab.evaluate("() => window.live.then(() => window.live.live.reset())")
        tab.evaluate("() => { window.live.camera.enlarge(1.2); }")
        tab.add_style_tag(content="#rate { display: none }")  # of the machine that films
        x, y, metre = tab.evaluate(PIXEL, list(ball.center))
        tab.mouse.move(x, y)
        tab.mouse.down()
        for k in range(round(RATE * SECONDS)):
            phase = 2 * math.pi * max(k / RATE - 0.6, 0) / 1.7
            tab.mouse.move(
                x + 0.35 / metre * math.sin(phase), y - 0.15 / metre * (1 - math.cos(phase))
            )
            tab.evaluate(STEPS, round(1 / RATE / DT))
            tab.screenshot(path=folder / f"{k:03}.png")
        chromium.close()
        first, *later_frames = (
            Image.open(name).convert("RGB").resize(SIZE) for name in sorted(folder.glob("*.png"))
        )
        options = {
            "save_all": True,
            "duration": round(1000 / RATE),
            "loop": 0,
            "quality": 70,
            "method": 6,
        }
        first.save(file, append_images=later_frames, **options)


if __name__ == "__main__":
    main()
