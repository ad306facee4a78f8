// The page: runs in step, one clock, one camera, curves with a cursor.
"use strict";

const $ = (id) => document.getElementById(id);
const MODES = {
  faces: {},
  stretch: { unit: "%", factor: 100 },
  speed: { unit: "m/s", factor: 1 },
  depth: { unit: "mm", factor: 1000 },
  difference: { unit: "mm", factor: 1000 },
};
const typed = (value) => Number(value.toPrecision(3));
const isText = ({ tagName, type, isContentEditable }) =>
  isContentEditable || tagName === "TEXTAREA" || (tagName === "INPUT" && type !== "range");

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
    this.scalars = {};
    this.names.forEach((name, k) => { this.scalars[name] = scalar(2 * count + k * frames * this.points); });
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

  // A value of a point, whose levels are finer near 0: they are those of its square root.
  value(name, frame, point) { return this.highest[name] * (this.scalars[name][frame * this.points + point] / 255) ** 2; }

  // Values of all points in a colour mode, as a part of its top.
  values(frame, mode, out) {
    if (this.scalars[mode.name]) for (let p = 0; p < this.points; p++) out[p] = this.value(mode.name, frame, p) / mode.top;
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

async function start() {
  const meta = JSON.parse($("meta").textContent);
  const highest = Object.fromEntries(Object.entries(meta.tops).map(([name, tops]) => [name, tops.max]));
  const compared = (run) => (meta.tops.depth ? run.spheres.length : 0);
  const runs = meta.runs.map((run) => new PageRun({ ...run, names: meta.names, highest, compared: compared(run) }));
  const inflated = Promise.all(runs.map((run) => run.inflate()));  // beside the set-up of WebGL
  const camera = new Orbit(meta.camera);
  const panels = runs.map((run, k) => {
    const canvas = $(`canvas-${k}`);
    if (runs.length > 1) $(`key-${k}`).append(sample(look(k)));
    const ring = document.createElement("span");
    ring.className = "ring";
    canvas.after(ring);
    return { run, canvas, ring, drawing: new Drawing(canvas, run, camera), says: $(`says-${k}`) };
  });
  await inflated;
  // The run that lasts longest, of those the one with most frames, is the clock's.
  const lead = runs.reduce((a, b) => (b.t.at(-1) > a.t.at(-1) || (b.t.at(-1) === a.t.at(-1) && b.t.length > a.t.length) ? b : a));
  const begin = lead.t[0], end = lead.t.at(-1), slider = $("time");
  slider.max = lead.t.length - 1;
  const state = { t: begin, playing: false, mode: "faces", top: "99 %", before: 0, probe: null };
  window.page = { runs, state, lead, camera };  // for tests and the curious

  const mode = () => {
    const tops = meta.tops[state.mode] || { max: 1 };
    return { name: state.mode, ...MODES[state.mode], max: tops.max, top: tops[state.top] || tops.max || 1 };
  };
  const curves = drawCurves(runs, (t) => { pause(); show(t); });
  const probed = (run) => {
    const [rows, columns] = run.shape, [row, column] = state.probe || [Infinity, Infinity];
    return row < rows && column < columns ? row * columns + column : null;
  };

  function draw(panel) {
    const { run, canvas, ring } = panel, point = probed(run);
    panel.drawing.background = css("--page").match(/\w\w/g).map((part) => parseInt(part, 16) / 255);
    panel.drawing.draw(camera);
    ring.hidden = point === null;
    if (ring.hidden) return;
    const [x, y] = camera.projection(canvas)(run.x, 3 * point);
    ring.style.transform = `translate(${x}px, ${y}px)`;
  }

  function redraw() { panels.forEach(draw); }

  function say({ run, says }) {
    const frame = run.frameAt(state.t), point = probed(run);
    says.textContent = `frame ${frame} of ${run.t.length - 1}, t = ${run.t[frame].toFixed(4)} s`;
    if (point === null) return;
    const parts = meta.names.map((name) => `${name} ${typed(MODES[name].factor * run.value(name, frame, point))} ${MODES[name].unit}`);
    says.textContent += `; row ${state.probe[0]}, column ${state.probe[1]}: ${parts.join(", ")}`;
  }

  // Probe a mass point of all runs: a ring, its values, its curves.
  function probe(place) {
    state.probe = place;
    [$("row").value, $("column").value] = place || ["", ""];
    const lines = (name) => runs.map((run, k) => ({ run, k, point: probed(run) })).filter(({ point }) => point !== null)
      .map(({ run, k, point }) => ({ ...look(k), t: run.t, y: run.t.map((_, f) => run.value(name, f, point)), label: run.label }));
    curves.replace(place ? meta.names.map((name) => [`${name} of the point [${MODES[name].unit}]`, MODES[name].factor, lines(name)]) : []);
    panels.forEach(say);
    redraw();
  }

  // The point nearest to the pixel, of those within 9 pixels and not behind another layer of cloth.
  function pick({ run, canvas }, x, y) {
    const at = camera.projection(canvas), layer = 18 * 2 * camera.extent(1)[1] / canvas.clientHeight, found = [];
    for (let p = 0; p < run.points; p++) {
      const [px, py, near] = at(run.x, 3 * p), away = Math.hypot(px - x, py - y);
      if (away <= 9) found.push({ p, near, away });
    }
    const front = Math.max(...found.map(({ near }) => near)) - layer;
    const [best] = found.filter(({ near }) => near >= front).sort((a, b) => a.away - b.away);
    probe(best ? [Math.floor(best.p / run.shape[1]), best.p % run.shape[1]] : null);
  }

  function show(t, force = false) {
    state.t = Math.max(begin, Math.min(end, t));
    const shown = lead.frameAt(state.t);
    for (const p of panels) {
      const frame = p.run.frameAt(state.t);
      if (!force && p.canvas.dataset.frame === String(frame)) continue;
      p.canvas.dataset.frame = frame;
      p.drawing.load(frame, mode());
      draw(p);
      say(p);
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
    if (state.t >= end && !$("loop").checked) return pause();
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
    const m = mode();
    $("legend").hidden = state.mode === "faces";
    $("top").parentElement.hidden = state.mode === "depth";
    $("high").textContent = `${m.max > m.top ? "≥ " : ""}${Number((m.factor * m.top).toPrecision(2))} ${m.unit}`;
    $("bar").style.background = `linear-gradient(90deg, ${(state.mode === "depth" ? HEAT : VIRIDIS).map((c) => "#" + c)})`;
  }

  $("play").addEventListener("click", () => (state.playing ? pause() : play()));
  $("back").addEventListener("click", () => step(-1));
  $("forth").addEventListener("click", () => step(1));
  slider.addEventListener("input", () => { pause(); show(lead.t[slider.valueAsNumber]); });
  for (const name of ["mode", "top"]) {
    $(name).addEventListener("change", () => { state[name] = $(name).value; legend(); show(state.t, true); });
  }
  for (const name of ["row", "column"]) $(name).addEventListener("change", () => {
    const place = [$("row"), $("column")].map((field) => field.valueAsNumber);
    if (place.every((k) => Number.isInteger(k) && k >= 0)) probe(place);
    else if (place.every(Number.isNaN)) probe(null);
  });
  for (const button of document.querySelectorAll("[data-direction]")) {
    button.addEventListener("click", () => { camera.reset(JSON.parse(button.dataset.direction)); redraw(); });
  }
  document.addEventListener("keydown", (e) => {
    if (isText(e.target) || e.ctrlKey || e.altKey || e.metaKey) return;
    const act = { " ": () => $("play").click(), ArrowLeft: () => step(-1), ArrowRight: () => step(1) }[e.key];
    if (!act) return;
    e.preventDefault();
    act();
  });
  // Firefox presses a button when space is released.
  document.addEventListener("keyup", (e) => { if (e.key === " " && !isText(e.target)) e.preventDefault(); });
  for (const p of panels) camera.listen(p.canvas, redraw, (x, y) => pick(p, x, y));
  const dark = matchMedia("(prefers-color-scheme: dark)"), pin = SHADING.pin;
  const theme = () => { SHADING.pin = dark.matches ? pin.map((k) => 1 - k) : pin; };
  dark.addEventListener("change", () => { theme(); show(state.t, true); curves.draw(true); });
  theme();
  new ResizeObserver(() => { redraw(); curves.draw(); }).observe($("runs"));
  legend();
  const asked = () => Number(new URLSearchParams(location.hash.slice(1)).get("t") ?? end);  // page.html#t=0.8; the last frame shows more than a flat sheet
  addEventListener("hashchange", () => { pause(); show(asked()); });
  show(asked(), true);
  for (const p of panels) p.canvas.classList.add("drawn");
  requestAnimationFrame(() => { document.body.dataset.ready = Math.round(performance.now()); });
}

start().catch((error) => {
  $("problem").hidden = false;
  $("problem").textContent = error.message;
});
