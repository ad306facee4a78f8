// The live page: a scene simulated on the graphics adapter (solver.js), drawn by draw.js, changed by hand.
"use strict";

const $ = (id) => document.getElementById(id);
const FASTEST_DRAG = 5;  // m/s; a pointer jumps, and a sphere that jumped would pass cloth within a step
const FRAME = 1 / 60;    // s of work that a frame asks of the adapter
const MOST_OVERHEAD = 0.1;  // s of fixed time that steps may match; more would make a slow page slower
const PAUSES = 0.25;     // s between two measurements of energy and depth, which cost more than a frame of a large cloth

async function inflated(name) {
  const packed = Uint8Array.from(atob($(name).textContent), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Float64Array(await new Response(stream).arrayBuffer());
}

// A scene with its state, as draw.js draws runs, and as the controls change it.
class Live {
  constructor(data, planes, solver) {
    Object.assign(this, { data, solver, start: planes, shape: data.shape, pins: data.pins, dots: data.dots });
    this.dotSize = data.dotSize;
    this.compared = 0;
    this.points = data.shape[0] * data.shape[1];
    this.x = new Float32Array(3 * this.points);
    this.stiffness = data.stiffnessFactors.indexOf(1);
    this.damping = data.dampingFactors.indexOf(1);
    Object.assign(this, { dt: data.dt, gravity: [...data.gravity], method: data.method, perFrame: 8 });
    this.spheres = data.spheres.map((s) => ({ ...s }));
  }

  // The guaranteed time step at the present coefficients; Python has computed it for every pair of stops.
  get limit() { return this.data.limits[this.stiffness][this.damping] ?? Infinity; }

  async reset() {
    Object.assign(this, { steps: 0, origin: 0, counted: 0, problem: "", contacts: 0, pinned: null });
    this.moved = this.data.spheres.map(() => ({ by: [0, 0, 0], to: [0, 0, 0] }));
    if (this.compiled !== this.method) await this.solver.compile(this.method);
    this.compiled = this.method;
    this.solver.load(this.start);
    this.low = Float32Array.from(this.start, (value) => value - Math.fround(value));
    this.planes = new Float32Array(this.start);
    this.apply();
  }

  // Measure a frame's fixed time and a step's time on this device [s]; the first frame compiles.
  async calibrate() {
    const took = [];
    for (const steps of [1, 1, 16]) {
      const begin = performance.now();
      await this.advance(steps);
      took.push((performance.now() - begin) / 1000);
    }
    this.cost = Math.max((took[2] - took[1]) / 15, 1e-6);
    this.overhead = Math.max(took[1] - this.cost, 0);
    await this.reset();
  }

  // Steps of the next frame: they take FRAME, or as long as the frame's fixed time, which the picture is a part of; and no
  // more than real time asks for.
  adapt(steps, took, wall) {
    this.overhead += 0.1 * (Math.max(took - this.cost * steps, 0) - this.overhead);
    const wanted = Math.min(Math.max(FRAME, Math.min(this.overhead, MOST_OVERHEAD)) / this.cost, wall / this.dt);
    this.perFrame = Math.max(1, Math.min(MOST_STEPS, 2 * steps, Math.round(wanted)));
  }

  apply() {
    const { dt, gravity, limit, data } = this;
    this.solver.set({ dt, gravity, limit, stiffness: data.stiffnessFactors[this.stiffness], damping: data.dampingFactors[this.damping] });
  }

  // Another time step: the clock counts from now on, as Python's does.
  setStep(dt) { Object.assign(this, { origin: this.time, steps: 0, dt }); this.apply(); }

  get time() { return this.origin + this.steps * this.dt; }

  contactRadius(sphere, s) {
    if (this.data.methods[this.method].responses[s] === "continuous" && sphere.cells) return sphere.radius;
    const R = sphere.radius ?? Infinity, half = Math.min(sphere.side, (sphere.cells ? 2 : Infinity) * R) / 2;
    return R + (sphere.side ? half * half / (Math.sqrt(half * half + R * R) + R) : sphere.offset);
  }

  // Spheres before the next steps and after each. A dragged sphere goes on straight to where the pointer is.
  path(steps) {
    const most = FASTEST_DRAG * steps * this.dt;
    const ways = this.moved.map(({ by, to }) => {
      const way = to.map((k, i) => k - by[i]), part = Math.min(1, most / (Math.hypot(...way) || 1));
      return way.map((k) => part * k);
    });
    const path = [];
    for (let n = 0; n <= steps; n++) path.push(this.spheres.map((sphere, s) => {
      const [center, velocity] = motionAt(sphere, this.origin + (this.steps + n) * this.dt), { by } = this.moved[s];
      return {
        radius: this.contactRadius(sphere, s), center: center.map((k, i) => k + by[i] + ways[s][i] * (n / steps)),
        velocity: velocity.map((k, i) => k + ways[s][i] / (steps * this.dt)),
      };
    }));
    return { path, ways };
  }

  // Take steps. An unstable one is searched for: the same steps give the same bits.
  async advance(steps) {
    const { path, ways } = this.path(steps);
    if (this.pinned) {
      const { point, at } = this.pinned, most = FASTEST_DRAG;
      const v = at.map((k, i) => (k - this.planes[i * this.points + point]) / (steps * this.dt)), speed = Math.hypot(...v);
      this.solver.movePin(point, v.map((k) => k * Math.min(1, most / (speed || 1))));
    }
    const read = await this.solver.run(path);
    if (read.bad >= 0 && steps > 1) {
      this.solver.takeBack();
      for (let n = 0; n < steps && !this.problem; n++) await this.take(await this.solver.run(path.slice(n, n + 2)), 1);
      return;
    }
    this.take(read, steps);
    if (!this.problem) this.moved.forEach((m, s) => { m.by = m.by.map((k, i) => k + ways[s][i]); });
  }

  take(read, steps) {
    if (read.bad >= 0) {
      this.solver.takeBack();
      const columns = this.shape[1], point = `(${Math.floor(read.bad / columns)}, ${read.bad % columns})`;
      const above = this.dt > this.limit;
      this.problem = `UNSTABLE at step ${this.counted + 1} (t = ${(this.time + this.dt).toPrecision(6)} s), first at mass point ${point}: ` +
        `the time step ${this.dt.toPrecision(3)} s is ${above ? "above" : "within"} the guaranteed ${this.limit.toPrecision(3)} s`;
      return;
    }
    this.steps += steps;
    this.counted += steps;
    Object.assign(this, { planes: read.planes, low: read.low, contacts: this.contacts + read.contacts });
  }

  // What draw.js asks for.
  positions() {
    for (let p = 0; p < this.points; p++) for (let k = 0; k < 3; k++) this.x[3 * p + k] = this.planes[k * this.points + p];
    return this.x;
  }

  center(s) { return motionAt(this.spheres[s], this.time)[0].map((k, i) => k + this.moved[s].by[i]); }

  values() {}

  // Energy [J] as in cs.energy.
  energy() {
    const { data, points, shape: [rows, columns], planes: v } = this, x = this.positions();
    let kinetic = 0, elastic = 0, gravity = 0;
    for (let p = 0; p < points; p++) {
      const m = data.mass[data.uniformMass ? 0 : p], at = (k) => v[k * points + p];
      kinetic += m / 2 * (at(3) ** 2 + at(4) ** 2 + at(5) ** 2);
      gravity -= m * (this.gravity[0] * at(0) + this.gravity[1] * at(1) + this.gravity[2] * at(2));
    }
    for (const { row, column, family, rest } of data.pairs) {
      const K = (data.stiffness[family] ?? 0) * data.stiffnessFactors[this.stiffness];
      for (let r = Math.max(0, -row); r < Math.min(rows, rows - row); r++) for (let c = Math.max(0, -column); c < Math.min(columns, columns - column); c++) {
        const p = 3 * (r * columns + c), q = 3 * ((r + row) * columns + c + column);
        elastic += K / 2 * (Math.hypot(x[q] - x[p], x[q + 1] - x[p + 1], x[q + 2] - x[p + 2]) - rest) ** 2;
      }
    }
    return kinetic + elastic + gravity;
  }

  // Deepest mass point and triangle below the radius of a sphere [m], as in cs.penetration.
  depths() {
    const x = this.positions(), [rows, columns] = this.shape, deepest = { points: 0, triangles: 0 };
    this.spheres.forEach((sphere, s) => {
      const c = this.center(s), R = sphere.radius, at = (p) => [x[3 * p] - c[0], x[3 * p + 1] - c[1], x[3 * p + 2] - c[2]];
      const places = Array.from({ length: this.points }, (_, p) => at(p));
      for (const p of places) deepest.points = Math.max(deepest.points, R - Math.hypot(...p));
      const near = R + this.data.longest;
      for (let r = 0; r + 1 < rows; r++) for (let k = 0; k + 1 < columns; k++) {
        const p = r * columns + k;
        if (Math.hypot(...places[p]) > near) continue;
        for (const [a, b, d] of [[p, p + columns, p + 1], [p + 1, p + columns, p + columns + 1]]) {
          deepest.triangles = Math.max(deepest.triangles, R - toTriangle(places[a], places[b], places[d]));
        }
      }
    });
    deepest.triangles = Math.max(deepest.triangles, deepest.points);
    return deepest;
  }
}

// Distance from the origin to a triangle: to its plane where the foot lies inside, else to its nearest side.
function toTriangle(a, b, c) {
  const minus = (u, v) => u.map((k, i) => k - v[i]), dot = (u, v) => u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
  const cross = (u, v) => [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
  const n = cross(minus(b, a), minus(c, a)), nn = dot(n, n);
  const sides = [[a, b], [b, c], [c, a]];
  if (nn > 0 && sides.every(([p, q]) => dot(cross(minus(q, p), p), n) <= 0)) return Math.abs(dot(a, n)) / Math.sqrt(nn);
  return Math.min(...sides.map(([p, q]) => {
    const way = minus(q, p), part = Math.max(0, Math.min(1, -dot(p, way) / (dot(way, way) || 1)));
    return Math.hypot(...p.map((k, i) => k + part * way[i]));
  }));
}

async function start() {
  const data = JSON.parse($("meta").textContent), planes = await inflated("state");
  const solver = await Solver.open(data), live = new Live(data, planes, solver);
  await live.reset();
  await live.calibrate();
  const canvas = $("canvas-0"), camera = new Orbit(data.camera), drawing = new Drawing(canvas, live, camera);
  const state = { playing: true, busy: false, factor: 0, rate: 0, measured: -1 };

  const page = () => getComputedStyle(document.documentElement).getPropertyValue("--page");
  drawing.background = page().match(/\w\w/g).map((part) => parseInt(part, 16) / 255);
  const redraw = () => drawing.draw(camera);
  function show() {
    drawing.load(0, { name: "faces" });
    redraw();
    $("clock").textContent = `t = ${live.time.toFixed(4)} s`;
    $("speed").textContent = `${state.factor.toPrecision(2)} x real time, ${Math.round(state.rate)} steps/s, ${live.perFrame} a frame`;
    const now = performance.now() / 1000;
    if (now - state.measured > PAUSES || !state.playing) {
      const deep = live.depths();
      $("measures").textContent = `energy ${live.energy().toPrecision(5)} J, deepest point ${(1e3 * deep.points).toFixed(3)} mm, ` +
        `deepest triangle ${(1e3 * deep.triangles).toFixed(3)} mm`;
      state.measured = now;
    }
    $("problem").hidden = !live.problem;
    $("problem").textContent = live.problem;
    if (live.problem) pause(true);
  }

  function pause(on) {
    state.playing = !on;
    $("play").textContent = on ? "run" : "pause";
  }

  // One after the other: steps and changes of the state share the adapter's buffers.
  let queue = Promise.resolve();
  const then = (work) => (queue = queue.then(work).catch(fail));

  async function frame(before) {
    const begin = performance.now(), steps = live.perFrame;
    await live.advance(steps);
    const took = (performance.now() - begin) / 1000, wall = Math.max(took, (begin - before) / 1000, 1e-3);
    live.adapt(steps, took, wall);
    state.rate += 0.1 * (steps / wall - state.rate);
    state.factor = state.rate * live.dt;
    show();
    return begin;
  }

  async function loop(before) {
    if (state.playing && !live.problem && !document.hidden) {
      await then(async () => { before = await frame(before); });
    } else before = performance.now();
    requestAnimationFrame(() => loop(before));
  }

  function limits() {
    const above = live.dt > live.limit;
    $("above").hidden = !above;
    $("above").textContent = `above the guaranteed ${live.limit.toPrecision(3)} s`;
    $("dt").classList.toggle("above", above);
  }

  function slider(id, { min, max, value, step = "any" }, text, change) {
    const input = $(id);
    Object.assign(input, { min, max, step });
    input.value = value;
    const says = () => { $(`${id}-says`).textContent = text(input.valueAsNumber); };
    input.addEventListener("input", () => { says(); then(() => { change(input.valueAsNumber); limits(); }); });
    says();
    return () => { input.value = value; says(); };
  }

  const { stiffnessFactors: K, dampingFactors: c } = data;
  const g = -data.gravity[1];
  const sliders = [
    slider("stiffness", { min: 0, max: K.length - 1, value: live.stiffness, step: 1 }, (k) => `x ${K[k]}`, (k) => { live.stiffness = k; live.apply(); }),
    slider("damping", { min: 0, max: c.length - 1, value: live.damping, step: 1 }, (k) => `x ${c[k]}`, (k) => { live.damping = k; live.apply(); }),
    slider("gravity", { min: 0, max: 25, value: g }, (k) => `${k.toFixed(2)} m/s²`, (k) => { live.gravity[1] = -k; live.apply(); }),
    slider("dt", { min: -3, max: 3, value: 0 }, (k) => `${(data.dt * 2 ** k).toPrecision(3)} s`, (k) => live.setStep(data.dt * 2 ** k)),
    slider("radius", { min: -1, max: 1, value: 0 }, (k) => `x ${(2 ** k).toFixed(2)}`,
      (k) => live.spheres.forEach((s, n) => { s.radius = data.spheres[n].radius * 2 ** k; })),
  ];
  $("damping").disabled = c.length < 2;
  $("radius").disabled = $("method").disabled = !data.spheres.length;
  $("method").addEventListener("change", () => then(async () => {
    live.method = $("method").selectedIndex;
    await solver.compile(live.method);
    live.compiled = live.method;
  }));
  $("play").addEventListener("click", () => { if (!live.problem) pause(state.playing); });
  $("one").addEventListener("click", () => { pause(true); then(async () => { if (!live.problem) await live.advance(1); show(); }); });
  $("reset").addEventListener("click", () => then(async () => {
    Object.assign(live, { stiffness: K.indexOf(1), damping: c.indexOf(1), gravity: [...data.gravity], dt: data.dt, method: data.method });
    $("method").selectedIndex = data.method;
    live.spheres = data.spheres.map((s) => ({ ...s }));
    for (const back of sliders) back();
    await live.reset();
    limits();
    pause(false);
    show();
  }));

  // A pointer takes a pin near it, else the sphere under it unless it is ground, and moves it in the plane of the view.
  function grab(e) {
    const [right, up] = camera.axes(), metre = camera.metre(canvas), box = canvas.getBoundingClientRect();
    const across = metre * (e.clientX - box.left - box.width / 2), above = -metre * (e.clientY - box.top - box.height / 2);
    const seen = (p) => [right, up].map((axis) => axis.reduce((sum, k, i) => sum + k * (p[i] - camera.target[i]), 0));
    const away = (p) => Math.hypot(seen(p)[0] - across, seen(p)[1] - above);
    const place = (p) => [0, 1, 2].map((k) => live.planes[k * live.points + p]);
    const moved = (from, now) => from.map((k, i) => k + metre * ((now.clientX - e.clientX) * right[i] - (now.clientY - e.clientY) * up[i]));
    const pin = live.pins.find((p) => away(place(p)) < Math.max(data.dotSize, 12 * metre));
    if (pin !== undefined) {
      const from = place(pin);
      live.pinned = { point: pin, at: from };
      return (now) => {
        if (now) live.pinned.at = moved(from, now);
        else then(() => { live.pinned = null; solver.movePin(pin, [0, 0, 0]); });
      };
    }
    const s = live.spheres.findIndex((sphere, k) => sphere.radius < data.camera.reach && away(live.center(k)) < sphere.radius);
    if (s < 0) return null;
    const from = [...live.moved[s].to];
    return (now) => { if (now) live.moved[s].to = moved(from, now); };
  }

  // Work that a loss ends fails too, maybe before the loss is known, with words of its own.
  async function fail(error) {
    pause(true);
    const lost = solver.lost.then((why) => `The graphics adapter was lost (${why}). Load the page again.`);
    live.problem = await Promise.race([lost, new Promise((known) => setTimeout(known, 1000, error.message))]);
    $("problem").hidden = false;
    $("problem").textContent = live.problem;
  }
  solver.lost.then(fail);
  camera.listen(canvas, redraw, () => {}, grab);
  new ResizeObserver(redraw).observe($("runs"));
  limits();
  show();
  canvas.classList.add("drawn");
  window.live = { live, solver, state, camera, then };  // for tests and the curious
  document.body.dataset.ready = Math.round(performance.now());
  loop(performance.now());
}

start().catch((error) => {
  $("problem").hidden = false;
  $("problem").textContent = `${error.message} The picture shows the scene at its start.`;
});
