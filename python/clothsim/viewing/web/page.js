// The page: runs in step, one clock, one camera, curves with a cursor. On a live page (live.js) the
// run grows.
const $ = (id) => document.getElementById(id);
const MODES = {
  faces: {},
  stretch: {unit: "%", factor: 100},
  speed: {unit: "m/s", factor: 1},
  depth: {unit: "mm", factor: 1000},
  difference: {unit: "mm", factor: 1000},
};
const typed = (value) => Number(value.toPrecision(3));
const isText = ({tagName, type, isContentEditable}) => isContentEditable ||
    tagName === "TEXTAREA" || (tagName === "INPUT" && type !== "range" && type !== "checkbox");
const hasArrows = ({tagName, type, id}) =>
    tagName === "SELECT" || (type === "range" && id !== "time");
// Bytes of a script element, in base64 and deflated.
async function inflated(name) {
  const packed = Uint8Array.from(atob($(name).textContent), (c) => c.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate")))
      .arrayBuffer();
}
// One run: its frames are inflated once; positions come from 16-bit integers when they are drawn.
class PageRun {
  constructor(meta) {
    Object.assign(this, meta);
    this.points = meta.shape[0] * meta.shape[1];
    this.x = new Float32Array(3 * this.points);
  }
  async inflate() {
    const bytes = new Uint8Array(await inflated(this.data));
    const frames = this.t.length;
    const size = 3 * this.points;
    const count = frames * size;
    const q = new Uint16Array(count);
    for (let k = 0; k < count; k++) {
      const z = bytes[k] | (bytes[count + k] << 8);  // low bytes, then high bytes
      q[k] = (z >>> 1) ^ -(z & 1);  // signed second differences in time
    }
    for (let k = size; k < Math.min(2 * size, count); k++) q[k] += q[k - size];
    for (let k = 2 * size; k < count; k++) q[k] += 2 * q[k - size] - q[k - 2 * size];
    this.q = q;
    this.scalars = {};
    this.names.forEach((name, n) => {
      const from = 2 * count + n * frames * this.points;
      const s = this.scalars[name] = bytes.slice(from, from + frames * this.points);
      for (let k = this.points; k < s.length; k++) s[k] += s[k - this.points];
    });
  }
  positions(frame) {
    const {q, x, points, low, step} = this;
    for (let axis = 0; axis < 3; axis++) {
      const from = (3 * frame + axis) * points;
      for (let p = 0; p < points; p++) x[3 * p + axis] = low[axis] + step[axis] * q[from + p];
    }
    return x;
  }
  center(sphere, frame) {
    return this.spheres[sphere].centers[frame] ?? this.spheres[sphere].centers.at(-1);
  }
  // Directions of the lines on a plane's grid; undefined for a sphere.
  lines(sphere) {
    return this.spheres[sphere].lines;
  }
  radius(sphere, frame) {
    return this.spheres[sphere].radii?.[frame] ?? this.spheres[sphere].radius;
  }
  // A value of a point, whose levels are finer near 0: they are those of its square root.
  value(name, frame, point) {
    return this.highest[name] * (this.scalars[name][frame * this.points + point] / 255) ** 2;
  }
  // Values of all points in a colour mode, as a part of its top.
  values(frame, mode, out) {
    if (this.names.includes(mode.name))
      for (let p = 0; p < this.points; p++) out[p] = this.value(mode.name, frame, p) / mode.top;
  }
  // The frame that is shown at the time t: the last one stored by then.
  frameAt(t) {
    return Math.max(0, this.t.findLastIndex((stored) => stored <= t + 1e-9));
  }
  says(frame) {
    return `frame ${frame} of ${this.t.length - 1}, t = ${this.t[frame].toFixed(4)} s`;
  }
}
// The word and the sign on the button that plays.
function labelOfPlay(on, problem) {
  if (problem) return ["reset", "reset"];
  return on ? ["pause", "❚❚"] : ["play", "▶"];
}
// Shows runs, and answers to controls, pointers and keys. `live`: a run that grows, as live.js has
// it.
function player(runs, meta, camera, live = null) {
  const panels = runs.map((run, k) => {
    const canvas = $(`canvas-${k}`);
    if (runs.length > 1) $(`key-${k}`).append(sample(look(k)));
    const ring = document.createElement("span");
    ring.className = "ring";
    canvas.after(ring);
    return {run, canvas, ring, drawing: new Drawing(canvas, run, camera), says: $(`says-${k}`)};
  });
  // The run that lasts longest, of those the one with most frames, is the clock's.
  const lead = runs.reduce(
      (a, b) =>
          (b.t.at(-1) > a.t.at(-1) || (b.t.at(-1) === a.t.at(-1) && b.t.length > a.t.length) ? b :
                                                                                               a));
  const begin = () => lead.t[0];
  const end = () => lead.t.at(-1);
  const slider = $("time");
  const state = {t: 0, playing: false, mode: "faces", lastTick: 0, probe: null};
  const mode = ({max, top} = meta.tops[state.mode] ?? {max: 1}) =>
      ({name: state.mode, ...MODES[state.mode], max, top: top || max || 1});
  const curves = drawCurves(runs, (t) => {
    pause();
    show(t);
  });
  const probed = (run) => {
    const [rows, columns] = run.shape;
    const [row, column] = state.probe || [Infinity, Infinity];
    return row < rows && column < columns ? row * columns + column : null;
  };
  function draw({run, canvas, ring, drawing}) {
    const point = probed(run);
    drawing.draw(camera);
    ring.hidden = point === null;
    const [x, y] = ring.hidden ? [0, 0] : camera.projection(canvas)(run.x, 3 * point);
    ring.style.transform = `translate(${x}px, ${y}px)`;
  }
  function redraw() {
    panels.forEach(draw);
  }
  function say({run, says}) {
    const frame = run.frameAt(state.t);
    const point = probed(run);
    says.textContent = run.says(frame);
    if (point === null) return;
    const parts = meta.names.map(
        (name) => `${name} ${typed(MODES[name].factor * run.value(name, frame, point))} ${
            MODES[name].unit}`);
    const pin = run.pins.includes(point) ? "pin at " : "";
    says.textContent +=
        `; ${pin}row ${state.probe[0]}, column ${state.probe[1]}: ${parts.join(", ")}`;
  }
  // Probe a mass point of all runs: a ring, its values, its curves.
  function probe(place) {
    state.probe = place;
    [$("row").value, $("column").value] = place || ["", ""];
    const lines = (name) => runs.map((run, k) => ({run, k, point: probed(run)}))
                                .filter(({point}) => point !== null)
                                .map(({run, k, point}) => ({
                                       ...look(k),
                                       t: run.t,
                                       of: () => run.t.map((_, f) => run.value(name, f, point)),
                                       label: run.label
                                     }));
    curves.replace(
        place ? meta.names.map(
                    (name) =>
                        [`${name} of the point [${MODES[name].unit}]`, MODES[name].factor,
                            lines(name)]) :
                []);
    panels.forEach(say);
    redraw();
  }
  // The point nearest to the pixel, of those within 9 pixels and not behind another layer of cloth.
  function pick({run, canvas}, x, y) {
    const at = camera.projection(canvas);
    const layer = 18 * camera.metre(canvas);
    const all = Array.from({length: run.points}, (_, p) => p);
    const candidates =
        all.map((p) => [p, ...at(run.x, 3 * p)])
            .map(([p, px, py, near]) => ({p, near, away: Math.hypot(px - x, py - y)}))
            .filter(({away}) => away <= 9);
    const front = Math.max(...candidates.map(({near}) => near)) - layer;
    const [best] = candidates.filter(({near}) => near >= front).sort((a, b) => a.away - b.away);
    probe(best ? [Math.floor(best.p / run.shape[1]), best.p % run.shape[1]] : null);
  }
  function show(t, force = false) {
    state.t = Math.max(begin(), Math.min(end(), t));
    const shown = lead.frameAt(state.t);
    for (const p of panels) {
      const frame = p.run.frameAt(state.t);
      if (!force && p.canvas.dataset.frame === String(frame)) continue;
      p.canvas.dataset.frame = frame;
      p.drawing.load(frame, mode());
      draw(p);
      say(p);
    }
    slider.max = lead.t.length - 1;
    slider.value = shown;
    slider.setAttribute("aria-valuetext", `${state.t.toFixed(4)} s`);
    $("clock").textContent = `${state.t.toFixed(4)} s`;
    curves.cursor(state.t);
  }
  function playing(on) {
    state.playing = on;
    const [word, sign] = labelOfPlay(on, live?.problem);
    Object.assign($("play"), {textContent: sign, ariaLabel: word});
  }
  function pause() {
    playing(false);
  }
  function play() {
    if (live?.problem) return live.reset();
    playing(true);
    state.lastTick = performance.now();
    if (live) return show(end());
    if (state.t >= end()) state.t = begin();
    requestAnimationFrame(tick);
  }
  function tick(time) {
    if (!state.playing) return;
    let t = state.t + Math.max(0, (time - state.lastTick) / 1000) * Number($("speed").value);
    state.lastTick = Math.max(time, state.lastTick);
    if (state.t >= end() && !$("loop").checked) return pause();
    if (t > end())
      t = state.t < end() ? end() : begin();  // the last frame is seen before it starts again
    show(t);
    requestAnimationFrame(tick);
  }
  function step(by) {
    seek(lead.frameAt(state.t) + by);
  }
  function seek(frame) {
    pause();
    if (live && frame >= lead.t.length && frame < Infinity)
      live.singleStep();
    else
      show(lead.t[Math.max(0, Math.min(lead.t.length - 1, frame))]);
  }
  function legend() {
    const m = mode();
    $("legend").hidden = state.mode === "faces";
    $("high").textContent =
        `${m.max > m.top ? "≥ " : ""}${Number((m.factor * m.top).toPrecision(2))} ${m.unit}`;
    $("bar").style.background =
        `linear-gradient(90deg, ${stopsOf(state.mode).map((c) => "#" + c)})`;
  }
  const buttons = {
    play: () => (state.playing ? pause() : play()),
    back: () => step(-1),
    forth: () => step(1)
  };
  for (const [id, act] of Object.entries(buttons)) $(id).addEventListener("click", act);
  slider.addEventListener("input", () => seek(slider.valueAsNumber));
  $("mode").addEventListener("change", () => {
    state.mode = $("mode").value;
    legend();
    show(state.t, true);
  });
  for (const name of ["row", "column"])
    $(name).addEventListener("change", () => {
      const place = [$("row"), $("column")].map((field) => field.valueAsNumber);
      if (place.every((k) => Number.isInteger(k) && k >= 0))
        probe(place);
      else if (place.every(Number.isNaN))
        probe(null);
    });
  for (const button of document.querySelectorAll("[data-direction]")) {
    button.addEventListener("click", () => {
      camera.reset(JSON.parse(button.dataset.direction));
      redraw();
    });
  }
  document.addEventListener("keydown", (e) => {
    if (isText(e.target) || e.ctrlKey || e.altKey || e.metaKey ||
        (e.key !== " " && hasArrows(e.target)))
      return;
    const ends = {Home: () => seek(0), End: () => seek(Infinity)};
    const act =
        {" ": buttons.play, ArrowLeft: buttons.back, ArrowRight: buttons.forth, ...ends}[e.key];
    if (!act) return;
    e.preventDefault();
    act();
  });
  // Firefox presses a button when space is released.
  document.addEventListener("keyup", (e) => {
    if (e.key === " " && !isText(e.target)) e.preventDefault();
  });
  for (const p of panels) camera.listen(p.canvas, redraw, (x, y) => pick(p, x, y), live?.grab);
  function ready(t) {
    legend();
    show(t, true);
    DARK.addEventListener("change", () => {
      show(state.t, true);
      curves.draw();
    });
    new ResizeObserver(() => {
      redraw();
      curves.draw();
    }).observe($("runs"));
    for (const p of panels) p.canvas.classList.add("drawn");
    requestAnimationFrame(() => {
      document.body.dataset.ready = Math.round(performance.now());
    });
  }
  return {
    runs,
    state,
    lead,
    camera,
    curves,
    begin,
    end,
    show,
    pause,
    play,
    probe,
    legend,
    redraw,
    ready
  };
}
// The page of stored runs.
async function start() {
  const meta = JSON.parse($("meta").textContent);
  const highest =
      Object.fromEntries(Object.entries(meta.tops).map(([name, tops]) => [name, tops.max]));
  const compared = (run) => (meta.tops.depth ? run.spheres.length : 0);
  const runs = meta.runs.map(
      (run) => new PageRun({...run, names: meta.names, highest, compared: compared(run)}));
  const inflating = Promise.all(runs.map((run) => run.inflate()));  // beside the set-up of WebGL
  const page = window.page =
      player(runs, meta, new Orbit(meta.camera));  // for tests and the curious
  await inflating;
  // page.html#t=0.8; the last frame shows more than a flat sheet.
  const requestedTime = () =>
      Number(new URLSearchParams(location.hash.slice(1)).get("t") ?? page.end());
  addEventListener("hashchange", () => {
    page.pause();
    page.show(requestedTime());
  });
  page.ready(requestedTime());
}
let failure = "";  // of a handler; it stays until the page is loaded again
function tell(problem) {
  const textContent = problem || failure;
  Object.assign($("problem"), {hidden: !textContent, textContent});
}
function failed(error) {
  if (!error) return;  // a notice of the browser about the layout is no exception
  failure = `This page has failed: ${error.message ?? error}`;
  tell("");
}
addEventListener("error", (event) => failed(event.error));
addEventListener("unhandledrejection", (event) => failed(event.reason));

document.documentElement.classList.toggle(
    "framed", parent !== window);  // in a notebook all of it fits
if (!$("live")) start().catch((error) => tell(error.message));
