"""Pages in a browser: pixels of a canvas, the frames shown, and the slider."""

from base64 import b64decode

import numpy as np


def pixels(page, canvas=0):
    """Return the RGB pixels of a run's canvas."""
    script = """(name) => {
      const from = document.getElementById(name), to = document.createElement("canvas");
      to.width = from.width; to.height = from.height;
      const c = to.getContext("2d");
      c.drawImage(from, 0, 0);
      const data = c.getImageData(0, 0, to.width, to.height).data;
      let text = "";
      for (let k = 0; k < data.length; k += 4096)
        text += String.fromCharCode(...data.subarray(k, k + 4096));
      return [to.height, to.width, btoa(text)];
    }"""
    height, width, text = page.tab.evaluate(script, f"canvas-{canvas}")
    return np.frombuffer(b64decode(text), np.uint8).reshape(height, width, 4)[..., :3]


def seek(page, index):
    page.tab.evaluate(
        """(k) => {
          const s = document.getElementById("time");
          s.value = k;
          s.dispatchEvent(new Event("input"));
        }""",
        index,
    )


def frames(page):
    return [int(c.get_attribute("data-frame")) for c in page.tab.locator("#runs canvas").all()]
