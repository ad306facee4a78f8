// The page: runs in step, one clock, one camera, curves with a cursor.
"use strict";

const $ = (id) => document.getElementById(id);
const COLORS = LOOK.colors;
const DASHES = [[], [7, 4], [2, 3], [9, 3, 2, 3]];
const MODES = {
  faces: { label: "faces" },
  stretch: { label: "stretch", unit: "%", factor: 100 },
  speed: { label: "speed", unit: "m/s", factor: 1 },
  depth: { label: "depth below a sphere", unit: "mm", factor: 1000 },
};
const CURVES = [
  ["total", "energy [J]", 1], ["stretch", "largest stretch [%]", 100],
  ["triangles", "penetration [mm]", 1000], ["contacts", "points in contact", 1],
];

// One run: its frames are inflated once; positions come from 16-bit integers when they are drawn.
class PageRun {
  constructor(meta) {
    Object.assign(this, meta);
    this.points = meta.shape[0] * meta.shape[1];
    this.x = new Float32Array(3 * this.points);
  }

  async inflate() {
    const text = atob($(this.data).textContent);
    const packed = new Uint8Array(text.length);
    for (let k = 0; k < text.length; k++) packed[k] = text.charCodeAt(k);
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
    const frames = this.t.length, size = 3 * this.points, count = frames * size;
    const q = new Uint16Array(count);
    for (let k = 0; k < count; k++) {
      const z = bytes[k] | (bytes[count + k] << 8);  // low bytes, then high bytes
      q[k] = (z >>> 1) ^ -(z & 1);                   // signed second differences in time
    }
    for (let k = size; k < Math.min(2 * size, count); k++) q[k] += q[k - size];
    for (let k = 2 * size; k < count; k++) q[k] += 2 * q[k - size] - q[k - 2 * size];
    this.q = q;
    const scalar = (from) => {
      const s = bytes.slice(from, from + frames * this.points);
      for (let k = this.points; k < s.length; k++) s[k] += s[k - this.points];
      return s;
    };
    this.scalars = { stretch: scalar(2 * count), speed: scalar(2 * count + frames * this.points) };
  }

  positions(frame) {
    const { q, x, points, low, step } = this;
    for (let axis = 0; axis < 3; axis++) {
      const from = (3 * frame + axis) * points;
      for (let p = 0; p < points; p++) x[3 * p + axis] = low[axis] + step[axis] * q[from + p];
    }
    return x;
  }

  center(sphere, frame) {
    const c = this.spheres[sphere].centers;
    return c[Math.min(frame, c.length - 1)];
  }

  // What the colour modes "stretch" and "speed" show of each point, as a part of their top.
  values(frame, mode, out) {
    const s = this.scalars[mode.name], from = frame * this.points;
    if (s) for (let p = 0; p < this.points; p++) out[p] = s[from + p] / 255;
  }

  // The frame that is shown at the time t: the last one stored by then.
  frameAt(t) {
    let low = 0, high = this.t.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.t[middle] <= t + 1e-9) low = middle; else high = middle - 1;
    }
    return low;
  }
}

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

  listen(canvas, changed) {
    let last = null;
    canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); last = e; });
    canvas.addEventListener("pointerup", () => { last = null; });
    canvas.addEventListener("pointermove", (e) => {
      if (!last) return;
      const dx = e.clientX - last.clientX, dy = e.clientY - last.clientY;
      last = e;
      if (e.shiftKey || e.buttons === 2) {
        const metre = 2 * this.extent(canvas.clientWidth / canvas.clientHeight)[1] / canvas.clientHeight;
        const [right, up] = this.axes();
        this.target = this.target.map((k, i) => k - metre * (dx * right[i] - dy * up[i]));
      } else {
        this.azimuth -= 0.008 * dx;
        this.elevation = Math.max(-1.57, Math.min(1.57, this.elevation + 0.008 * dy));
      }
      changed();
    });
    canvas.addEventListener("wheel", (e) => {
      e.preventDefault();
      this.zoom = Math.max(0.1, Math.min(50, this.zoom * Math.exp(-0.0015 * e.deltaY)));
      changed();
    }, { passive: false });
    canvas.addEventListener("contextmenu", (e) => e.preventDefault());
    canvas.addEventListener("dblclick", () => { this.reset(); changed(); });
  }
}

async function start() {
  const meta = JSON.parse($("meta").textContent);
  const runs = meta.runs.map((run) => new PageRun({ ...run, compared: meta.tops.depth ? run.spheres.length : 0 }));
  const inflated = Promise.all(runs.map((run) => run.inflate()));  // beside the set-up of WebGL
  const camera = new Orbit(meta.camera);
  const panels = runs.map((run, k) => {
    const canvas = $(`canvas-${k}`);
    if (runs.length > 1) $(`key-${k}`).append(sample(COLORS[k % 8], DASHES[k % 4]));
    return { run, canvas, drawing: new Drawing(canvas, run), says: $(`says-${k}`) };
  });
  await inflated;
  // The run that lasts longest, of those the one with most frames, is the clock's.
  const lead = runs.reduce((a, b) => (b.t.at(-1) > a.t.at(-1) || (b.t.at(-1) === a.t.at(-1) && b.t.length > a.t.length) ? b : a));
  const begin = lead.t[0], end = lead.t.at(-1), slider = $("time");
  slider.max = lead.t.length - 1;
  const state = { t: begin, playing: false, mode: "faces", before: 0 };
  window.page = { runs, state, lead, camera };  // for tests and the curious

  const mode = () => ({ name: state.mode, ...MODES[state.mode], top: meta.tops[state.mode] });
  const curves = drawCurves(runs, meta, (t) => { pause(); show(t); });

  function redraw() { for (const p of panels) p.drawing.draw(camera); }

  function show(t, force = false) {
    state.t = Math.max(begin, Math.min(end, t));
    const shown = lead.frameAt(state.t);
    for (const p of panels) {
      const frame = p.run.frameAt(state.t);
      if (!force && p.canvas.dataset.frame === String(frame)) continue;
      p.canvas.dataset.frame = frame;
      p.drawing.load(frame, mode());
      p.drawing.draw(camera);
      p.says.textContent = `frame ${frame} of ${p.run.t.length - 1}, t = ${p.run.t[frame].toFixed(4)} s`;
    }
    slider.value = shown;
    slider.setAttribute("aria-valuetext", `${state.t.toFixed(4)} s`);
    $("clock").textContent = `${state.t.toFixed(4)} s`;
    curves.cursor(state.t);
  }

  function pause() {
    state.playing = false;
    $("play").textContent = "▶";
    $("play").setAttribute("aria-label", "play");
  }

  function play() {
    state.playing = true;
    state.before = performance.now();
    if (state.t >= end) state.t = begin;
    $("play").textContent = "❚❚";
    $("play").setAttribute("aria-label", "pause");
    requestAnimationFrame(tick);
  }

  function tick(now) {
    if (!state.playing) return;
    const passed = Math.max(0, (now - state.before) / 1000) * Number($("speed").value);
    state.before = Math.max(now, state.before);
    let t = state.t + passed;
    if (t > end) t = state.t < end ? end : begin;  // the last frame is seen before it starts again
    show(t);
    requestAnimationFrame(tick);
  }

  function step(by) {
    pause();
    const k = Math.max(0, Math.min(lead.t.length - 1, lead.frameAt(state.t) + by));
    show(lead.t[k]);
  }

  function legend() {
    const m = mode(), bar = $("legend");
    bar.hidden = state.mode === "faces";
    $("low").textContent = "0";
    $("high").textContent = m.top ? `${Number((m.factor * m.top).toPrecision(2))} ${m.unit}` : "";
    $("bar").style.background = `linear-gradient(90deg, ${(state.mode === "depth" ? HEAT : VIRIDIS).map((c) => "#" + c)})`;
  }

  $("play").addEventListener("click", () => (state.playing ? pause() : play()));
  $("back").addEventListener("click", () => step(-1));
  $("forth").addEventListener("click", () => step(1));
  slider.addEventListener("input", () => { pause(); show(lead.t[slider.valueAsNumber]); });
  $("mode").addEventListener("change", () => { state.mode = $("mode").value; legend(); show(state.t, true); });
  for (const button of document.querySelectorAll("[data-direction]")) {
    button.addEventListener("click", () => { camera.reset(JSON.parse(button.dataset.direction)); redraw(); });
  }
  document.addEventListener("keydown", (e) => {
    if (/^(INPUT|SELECT|BUTTON)$/.test(e.target.tagName)) return;
    if (e.key === " ") { e.preventDefault(); $("play").click(); }
    if (e.key === "ArrowLeft") step(-1);
    if (e.key === "ArrowRight") step(1);
  });
  for (const p of panels) camera.listen(p.canvas, redraw);
  new ResizeObserver(() => { redraw(); curves.draw(); }).observe($("runs"));
  legend();
  show(begin, true);
  for (const p of panels) p.canvas.classList.add("drawn");
  requestAnimationFrame(() => { document.body.dataset.ready = Math.round(performance.now()); });
}

// Curves as small charts: a line per run (of one run: per kind of energy), a cursor at the clock.
function drawCurves(runs, meta, seek) {
  const end = Math.max(...runs.map((r) => r.t.at(-1))), begin = Math.min(...runs.map((r) => r.t[0]));
  const charts = [];
  for (const [name, label, factor] of CURVES) {
    let lines = runs.map((run, k) => ({ t: run.t, y: run.curves[name], label: run.label, color: COLORS[k % 8], dash: DASHES[k % 4] }));
    if (runs.length === 1 && name === "total") {
      lines = ["total", "kinetic", "elastic", "gravity"].map((kind, k) => ({
        t: runs[0].t, y: runs[0].curves[kind], label: kind, color: COLORS[(k + 4) % 5], dash: DASHES[k],
      }));
    }
    lines = lines.filter((line) => line.y);
    if (!lines.length) continue;
    const figure = document.createElement("figure"), caption = document.createElement("figcaption");
    const canvas = document.createElement("canvas");
    caption.textContent = label;
    if (runs.length === 1 && lines.length > 1) for (const line of lines) {
      const key = document.createElement("span");
      key.className = "key";
      key.textContent = line.label;
      key.style.color = line.color;
      caption.append(" ", key);
    }
    figure.append(caption, canvas);
    $("curves").append(figure);
    const values = lines.flatMap((line) => line.y).filter((v) => v !== null).map((v) => factor * v);
    let low = Math.min(0, ...values), high = Math.max(0, ...values);
    if (low === high) high = 1;
    const chart = { canvas, lines, factor, low, high };
    charts.push(chart);
    const at = (e) => begin + (end - begin) * (e.offsetX - LEFT) / (canvas.clientWidth - LEFT - RIGHT);
    canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); seek(at(e)); });
    canvas.addEventListener("pointermove", (e) => { if (e.buttons) seek(at(e)); });
  }
  const LEFT = 58, RIGHT = 10, TOP = 6, BOTTOM = 20;

  function paint(chart, t) {
    const { canvas, lines, factor, low, high } = chart, ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight, c = canvas.getContext("2d");
    if (!width || !height) return;  // not laid out yet, as in a hidden cell of a notebook; drawn when it is shown
    if (!chart.kept || chart.kept.width !== Math.round(width * ratio)) {
      canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio);
      c.scale(ratio, ratio);
      const X = (time) => LEFT + (width - LEFT - RIGHT) * (time - begin) / (end - begin || 1);
      const Y = (value) => TOP + (height - TOP - BOTTOM) * (high - value) / (high - low);
      c.font = "11px system-ui, sans-serif"; c.fillStyle = "#566272"; c.strokeStyle = "#dfe4ea";
      c.textAlign = "right"; c.textBaseline = "middle";
      for (const value of ticks(low, high)) {
        c.beginPath(); c.moveTo(LEFT, Y(value)); c.lineTo(width - RIGHT, Y(value)); c.stroke();
        c.fillText(String(value), LEFT - 6, Y(value));
      }
      c.textAlign = "center"; c.textBaseline = "top";
      for (const time of ticks(begin, end)) c.fillText(`${time} s`, Math.min(X(time), width - 14), height - BOTTOM + 6);
      for (const { t: times, y, color, dash } of lines) {
        c.strokeStyle = color; c.lineWidth = 1.6; c.setLineDash(dash); c.beginPath();
        let pen = false;
        y.forEach((v, k) => {
          if (v === null) { pen = false; return; }
          c[pen ? "lineTo" : "moveTo"](X(times[k]), Y(factor * v));
          pen = true;
        });
        c.stroke();
      }
      c.setLineDash([]);
      chart.X = X;
      chart.kept = document.createElement("canvas");
      chart.kept.width = canvas.width; chart.kept.height = canvas.height;
      chart.kept.getContext("2d").drawImage(canvas, 0, 0);
    }
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.clearRect(0, 0, canvas.width, canvas.height);
    c.drawImage(chart.kept, 0, 0);
    c.fillStyle = "#111";
    c.fillRect(Math.round(chart.X(t) * ratio) - 1, TOP * ratio, 2, (canvas.clientHeight - TOP - BOTTOM) * ratio);
  }
  let now = begin;
  return {
    cursor(t) { now = t; charts.forEach((chart) => paint(chart, t)); },
    draw() { charts.forEach((chart) => paint(chart, now)); },
  };
}

// A piece of a curve, which says in a caption whose it is.
function sample(color, dash) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg"), line = document.createElementNS(svg.namespaceURI, "line");
  for (const [name, value] of Object.entries({ width: 34, height: 8 })) svg.setAttribute(name, value);
  const look = { x1: 1, x2: 33, y1: 4, y2: 4, stroke: color, "stroke-width": 2.5, "stroke-dasharray": dash.join(" ") };
  for (const [name, value] of Object.entries(look)) line.setAttribute(name, value);
  svg.append(line);
  return svg;
}

// Three to six round numbers from low to high.
function ticks(low, high) {
  const rough = (high - low) / 3, power = 10 ** Math.floor(Math.log10(rough));
  const by = [1, 2, 5, 10].map((k) => k * power).filter((k) => k <= rough * 1.001).at(-1);
  const found = [];
  for (let k = Math.ceil(low / by - 1e-9); k * by <= high + 1e-9 * by; k++) found.push(Number((k * by).toPrecision(6)));
  return found;
}

start().catch((error) => {
  $("problem").hidden = false;
  $("problem").textContent = error.message;
});
