// The view of a page: turned, distance and enlarged by mouse, fingers and keys.
// An orthographic view that turns about a target: azimuth and elevation [rad], height shown [m].
class Orbit {
  constructor(start) {
    this.start = start;
    this.reset();
  }
  reset(direction = this.start.direction) {
    const [x, y, z] = direction;
    const elevation = Math.asin(y / Math.hypot(x, y, z));
    Object.assign(this, {
      azimuth: Math.atan2(x, z),
      elevation,
      target: [...this.start.target],
      zoom: 1,
      byHand: false
    });
  }
  // Go a part of the way to a view of the points and balls ([x, y, z, radius] each), unless a hand
  // has chosen another.
  follow(points, balls, part) {
    const axes = this.axes();
    const {start} = this;
    const low = [];
    const high = [];
    axes.forEach(([a, b, c], k) => {
      low[k] = Math.min(...balls.map(([x, y, z, r]) => a * x + b * y + c * z - r));
      high[k] = Math.max(...balls.map(([x, y, z, r]) => a * x + b * y + c * z + r));
      for (let p = 0; p < points.length; p += 3) {
        const place = a * points[p] + b * points[p + 1] + c * points[p + 2];
        low[k] = Math.min(low[k], place);
        high[k] = Math.max(high[k], place);
      }
    });
    const size = low.map((k, i) => high[i] - k);
    const room = 0.06 * Math.max(size[0], size[1]);
    const way = this.byHand ? 0 : part;
    const to = [0, 1, 2].map(
        (i) => axes.reduce((sum, axis, k) => sum + axis[i] * (low[k] + high[k]) / 2, 0));
    const shift = to.map((k, i) => way * (k - start.target[i]));
    const ease = (value, goal) =>
        value + (goal > value ? way : way / 8) * (goal - value);  // a cloth that swings is no pump
    start.target = start.target.map((k, i) => k + shift[i]);
    this.target = this.target.map((k, i) => k + shift[i]);
    start.width = ease(start.width, size[0] + room);
    start.height = ease(start.height, size[1] + room);
    start.reach =
        1.05 * (Math.hypot(...size) / 2 + Math.hypot(...to.map((k, i) => k - start.target[i])));
  }
  axes() {
    const [sa, ca, se, ce] =
        [this.azimuth, this.elevation].flatMap((angle) => [Math.sin(angle), Math.cos(angle)]);
    return [[ca, 0, -sa], [-sa * se, ce, -ca * se], [sa * ce, se, ca * ce]];
  }
  // Half the picture's width and height [m] for a canvas of that aspect.
  extent(aspect) {
    const h = Math.max(this.start.height, this.start.width / aspect) / 2 / this.zoom;
    return [h * aspect, h];
  }
  scale(aspect) {
    const [w, h] = this.extent(aspect);
    const distance = Math.hypot(...this.target.map((k, i) => k - this.start.target[i]));
    return [1 / w, 1 / h, -1 / (this.start.reach + distance)];
  }
  turn(dx, dy) {
    this.azimuth -= 0.008 * dx;
    this.elevation = Math.max(-1.57, Math.min(1.57, this.elevation + 0.008 * dy));
  }
  // Move so that the point below the pixel `from` comes to the pixel `to`.
  move(canvas, from, to) {
    const metre = this.metre(canvas);
    const [right, up] = this.axes();
    const [dx, dy] = from.map((k, i) => metre * (k - to[i]));
    this.target = this.target.map((k, i) => k + dx * right[i] - dy * up[i]);
    this.byHand = true;
  }
  enlarge(by) {
    this.zoom = Math.max(0.1, Math.min(50, this.zoom * by));
    this.byHand = true;
  }
  // A function from a point [m] to pixels of the canvas, and its height towards the eye [m].
  projection(canvas) {
    const [w, h] = this.extent(canvas.clientWidth / canvas.clientHeight);
    const axes = this.axes();
    const {target} = this;
    return (x, k) => {
      const [right, up, near] =
          axes.map((axis) => axis.reduce((sum, a, i) => sum + a * (x[k + i] - target[i]), 0));
      return [
        canvas.clientWidth * (1 + right / w) / 2, canvas.clientHeight * (1 - up / h) / 2, near
      ];
    };
  }
  // Metres in a pixel of the canvas.
  metre(canvas) {
    return 2 * this.extent(canvas.clientWidth / canvas.clientHeight)[1] / canvas.clientHeight;
  }
  // Mouse, fingers and keys on a canvas. One finger scrolls the page, and two turn and enlarge. A
  // click that does not drag calls `picked` with its pixel. `grab(event)` may take a pointer: it
  // returns a function of the events that follow, which gets null at the end.
  listen(canvas, changed, picked, grab = () => null) {
    const down = new Map();
    let drag = null;
    let way = 0;  // pixels since the first finger came down
    const middle = () => [0, 1].map(
        (axis) => [...down.values()].reduce((sum, p) => sum + p[axis], 0) / down.size);
    const spread = () => {
      const [a, b] = down.values();
      return Math.hypot(a[0] - b[0], a[1] - b[1]) || 1;
    };
    canvas.addEventListener("pointerdown", (e) => {
      canvas.setPointerCapture(e.pointerId);
      if (!down.size) drag = grab(e);
      down.set(e.pointerId, [e.offsetX, e.offsetY]);
      way = down.size > 1 ? Infinity : 0;
    });
    for (const kind of ["pointerup", "pointercancel"])
      canvas.addEventListener(kind, (e) => {
        if (drag) drag(null);
        drag = null;
        const isClick = down.delete(e.pointerId) && way < (e.pointerType === "touch" ? 12 : 4);
        if (isClick && kind === "pointerup" && e.button === 0 && !e.shiftKey)
          picked(e.offsetX, e.offsetY);
      });
    canvas.addEventListener("pointermove", (e) => {
      if (!down.has(e.pointerId)) return;
      if (drag) return drag(e);
      const two = down.size === 2;
      const from = middle();
      const wide = two && spread();
      down.set(e.pointerId, [e.offsetX, e.offsetY]);
      const to = middle();
      const dx = to[0] - from[0];
      const dy = to[1] - from[1];
      way += Math.hypot(dx, dy);
      if (e.pointerType === "touch" && !two) return;
      if (two) this.enlarge(spread() / wide);
      if (e.shiftKey || e.buttons === 2)
        this.move(canvas, from, to);
      else
        this.turn(dx, dy);
      changed();
    });
    const keep = (e) => {
      if ((drag || e.touches.length > 1) && e.cancelable) e.preventDefault();
    };  // from scrolling
    for (const kind of ["touchstart", "touchmove"])
      canvas.addEventListener(kind, keep, {passive: false});
    const wheel = (e) => {
      e.preventDefault();
      this.enlarge(Math.exp(-0.0015 * e.deltaY));
      changed();
    };
    canvas.addEventListener("wheel", wheel, {passive: false});
    canvas.addEventListener("contextmenu", (e) => e.preventDefault());
    canvas.addEventListener("dblclick", () => {
      this.reset();
      changed();
    });
    const turns = {ArrowLeft: [-20, 0], ArrowRight: [20, 0], ArrowUp: [0, -20], ArrowDown: [0, 20]};
    canvas.addEventListener("keydown", (e) => {
      const larger = {"+": 1.2, "=": 1.2, "-": 1 / 1.2}[e.key];
      if (e.shiftKey && turns[e.key])
        this.turn(...turns[e.key]);
      else if (larger)
        this.enlarge(larger);
      else if (e.key === "0")
        this.reset();
      else
        return;
      e.preventDefault();
      e.stopPropagation();
      changed();
    });
  }
}
