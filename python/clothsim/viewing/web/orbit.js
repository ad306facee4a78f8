// The view of a page: turned, moved and enlarged by mouse, fingers and keys.
"use strict";

// An orthographic view that turns about a target: azimuth and elevation [rad], height shown [m].
class Orbit {
  constructor(start) { this.start = start; this.reset(); }

  reset(direction = this.start.direction) {
    const [x, y, z] = direction, length = Math.hypot(x, y, z);
    this.azimuth = Math.atan2(x, z);
    this.elevation = Math.asin(y / length);
    this.target = [...this.start.target];
    this.zoom = 1;
  }

  axes() {
    const [sa, ca] = [Math.sin(this.azimuth), Math.cos(this.azimuth)];
    const [se, ce] = [Math.sin(this.elevation), Math.cos(this.elevation)];
    return [[ca, 0, -sa], [-sa * se, ce, -ca * se], [sa * ce, se, ca * ce]];
  }

  // Half the picture's width and height [m] for a canvas of that aspect.
  extent(aspect) {
    const { width, height } = this.start;
    const h = Math.max(height, width / aspect) / 2 / this.zoom;
    return [h * aspect, h];
  }

  scale(aspect) {
    const [w, h] = this.extent(aspect);
    const moved = Math.hypot(...this.target.map((k, i) => k - this.start.target[i]));
    return [1 / w, 1 / h, -1 / (this.start.reach + moved)];
  }

  turn(dx, dy) {
    this.azimuth -= 0.008 * dx;
    this.elevation = Math.max(-1.57, Math.min(1.57, this.elevation + 0.008 * dy));
  }

  // Enlarge, and move so that the point below the pixel `from` comes to the pixel `to`.
  move(canvas, from, to, by = 1) {
    const metres = () => 2 * this.extent(canvas.clientWidth / canvas.clientHeight)[1] / canvas.clientHeight;
    const centre = [canvas.clientWidth / 2, canvas.clientHeight / 2], before = metres();
    this.enlarge(by);
    const [dx, dy] = centre.map((c, k) => before * (from[k] - c) - metres() * (to[k] - c)), [right, up] = this.axes();
    this.target = this.target.map((k, i) => k + dx * right[i] - dy * up[i]);
  }

  enlarge(by) { this.zoom = Math.max(0.1, Math.min(50, this.zoom * by)); }

  // A function from a point [m] to pixels of the canvas, and its height towards the eye [m].
  projection(canvas) {
    const [w, h] = this.extent(canvas.clientWidth / canvas.clientHeight), axes = this.axes(), { target } = this;
    return (x, k) => {
      const [right, up, near] = axes.map((axis) => axis.reduce((sum, a, i) => sum + a * (x[k + i] - target[i]), 0));
      return [canvas.clientWidth * (1 + right / w) / 2, canvas.clientHeight * (1 - up / h) / 2, near];
    };
  }

  // Metres in a pixel of the canvas.
  metre(canvas) { return 2 * this.extent(canvas.clientWidth / canvas.clientHeight)[1] / canvas.clientHeight; }

  // Mouse, fingers and keys on a canvas. A click that does not drag calls `picked` with its pixel. `grab(event)` may take
  // a pointer: it returns a function of the events that follow, which gets null at the end.
  listen(canvas, changed, picked, grab = () => null) {
    const down = new Map();
    let taken = null;
    let way = 0;  // pixels since the first finger came down
    const middle = () => [0, 1].map((axis) => [...down.values()].reduce((sum, p) => sum + p[axis], 0) / down.size);
    const spread = () => { const [a, b] = down.values(); return Math.hypot(a[0] - b[0], a[1] - b[1]) || 1; };
    canvas.addEventListener("pointerdown", (e) => {
      canvas.setPointerCapture(e.pointerId);
      if (!down.size) taken = grab(e);
      down.set(e.pointerId, [e.offsetX, e.offsetY]);
      way = down.size > 1 ? Infinity : 0;
    });
    const release = () => {
      if (taken) taken(null);
      taken = null;
    };
    canvas.addEventListener("pointerup", (e) => {
      release();
      if (down.delete(e.pointerId) && way < 4 && e.button === 0 && !e.shiftKey) picked(e.offsetX, e.offsetY);
    });
    canvas.addEventListener("pointercancel", (e) => {
      release();
      down.delete(e.pointerId);
    });
    canvas.addEventListener("pointermove", (e) => {
      if (!down.has(e.pointerId)) return;
      if (taken) { taken(e); return; }
      const two = down.size === 2, from = middle(), wide = two && spread();
      down.set(e.pointerId, [e.offsetX, e.offsetY]);
      const to = middle(), dx = to[0] - from[0], dy = to[1] - from[1];
      way += Math.hypot(dx, dy);
      if (two) this.move(canvas, from, to, spread() / wide);
      else if (e.shiftKey || e.buttons === 2) this.move(canvas, from, to);
      else this.turn(dx, dy);
      changed();
    });
    canvas.addEventListener("wheel", (e) => {
      e.preventDefault();
      this.enlarge(Math.exp(-0.0015 * e.deltaY));
      changed();
    }, { passive: false });
    canvas.addEventListener("contextmenu", (e) => e.preventDefault());
    canvas.addEventListener("dblclick", () => { this.reset(); changed(); });
    const turns = { ArrowLeft: [-20, 0], ArrowRight: [20, 0], ArrowUp: [0, -20], ArrowDown: [0, 20] };
    canvas.addEventListener("keydown", (e) => {
      if (e.shiftKey && turns[e.key]) this.turn(...turns[e.key]);
      else if (e.key === "+" || e.key === "=") this.enlarge(1.2);
      else if (e.key === "-") this.enlarge(1 / 1.2);
      else if (e.key === "0") this.reset();
      else return;
      e.preventDefault();
      e.stopPropagation();
      changed();
    });
  }
}
