// The live page: a scene simulated on the graphics adapter (solver.js), and recorded as a run that
// page.js shows.

// A pointer jumps, and a sphere that jumped would pass cloth within a step.
const FASTEST_DRAG = 5;  // m/s
// Dissipation weakens the push on a cloth that leaves the sphere faster.
const FASTEST_GROWTH = 0.25;  // m/s, of a radius
const FRAME = 1 / 60;  // s of work that a frame asks of the adapter
// More would make a slow page slower.
const MOST_OVERHEAD = 0.1;  // s of fixed time that steps may match
const PAUSES = 0.25;  // s between two drawings of the curves
const MOST_FRAMES = 600;
const MOST_BYTES = 2 ** 26;  // of a recording; beyond, every other frame is dropped
const EASE = 0.4;  // s in which the view follows the cloth
const LAYER = ["thickness", "stiffness", "dissipation", "slip_speed"];
// A scene with its state and its recording, as page.js shows runs, and as the controls change it.
class Live extends PageRun {
  constructor(data, planes, solver, baked) {
    const {shape, pins, dots, dotSize, label} = baked;
    super({
      shape,
      pins,
      dots,
      dotSize,
      label,
      data,
      solver,
      baked,
      start: planes,
      names: ["stretch", "speed"],
      precision: 0
    });
    const most = Math.max(60, Math.min(MOST_FRAMES, MOST_BYTES / (24 * this.points)));
    Object.assign(this, {
      compared: data.spheres.length,
      most,
      t: [],
      curves: {},
      tops: {},
      perFrame: 1,
      least: Infinity
    });
    this.defaults();
  }
  // The scene as it is in Python.
  defaults() {
    const {stiffness, damping, drag, gravity, dt, method, spheres} = structuredClone(this.data);
    Object.assign(this, {stiffness, damping, drag, gravity, dt, method, spheres});
  }
  async reset() {
    Object.assign(
        this,
        {steps: 0, origin: 0, counted: 0, problem: "", pinned: null, interval: 0, frames: []});
    this.drags = this.data.spheres.map(({radius}) => ({by: [0, 0, 0], to: [0, 0, 0], radius}));
    this.solver.load(this.start);
    Object.assign(this, {
      planes: new Float32Array(this.start),
      low: Float32Array.from(this.start, (value) => value - Math.fround(value))
    });
    for (const values of [this.t, ...Object.values(this.curves)]) values.length = 0;
    for (const top of Object.values(this.tops)) top.max = 1e-3;
    await this.apply();
    this.record();
  }
  // Steps of the next frame: they take FRAME, or as long as the picture and a frame's fixed time,
  // and no more than real time, or slow motion, asks for.
  adapt(steps, took, wall, speed) {
    this.least = Math.min(this.least, took);
    const goal =
        steps * Math.max(FRAME, 2 * this.least, Math.min(wall - took, MOST_OVERHEAD)) / took;
    this.perFrame = Math.max(
        1, Math.min(MOST_STEPS, 2 * steps, Math.round(Math.min(goal, speed * wall / this.dt))));
  }
  // Another method or coefficients; what is 0 is compiled out.
  async apply() {
    const {data, stiffness, damping, drag, gravity, dt} = this;
    this.limit = guaranteed(data, stiffness, damping, drag);
    const features = {spring_damping: Object.values(damping).some((c) => c > 0), drag: drag > 0};
    const key = JSON.stringify([this.method, features]);
    if (this.compiled !== key) await this.solver.compile(this.method, features);
    this.compiled = key;
    this.solver.set({dt, stiffness, damping, drag, gravity, limit: this.limit});
  }
  // Another time step: the clock counts from now on, as Python's does.
  setStep(dt) {
    Object.assign(this, {origin: this.time, steps: 0, dt});
  }
  get time() {
    return this.origin + this.steps * this.dt;
  }
  // Eq 13 for a radius R, which a slider changes (Sphere.offset_length).
  contactOffset({side, diagonal, offset}, R) {
    const half = Math.min(side, (diagonal ? 2 : Infinity) * R) / 2;
    return side ? half * (half / (Math.hypot(half, R) + R)) : offset;
  }
  isPenalty(s) {
    return this.data.methods[this.method].responses[s] === "penalty";
  }
  // The restitution of a sphere: its own, else that of its response to contact, which is null for a
  // penalty.
  restitution(s) {
    return this.spheres[s].restitution ??
        this.data.restitutions[this.data.methods[this.method].responses[s]];
  }
  // Speed of a hand [m/s]: at most that which a layer takes from a mass point.
  fastest(s) {
    const {thickness, stiffness} = this.spheres[s];
    const heaviest = this.data.mass.reduce((a, b) => Math.max(a, b), 0);
    return this.isPenalty(s) ?
        Math.min(FASTEST_DRAG, thickness * Math.sqrt(stiffness / (2 * heaviest))) :
        FASTEST_DRAG;
  }
  // Spheres before the next steps and after each, and at the stages of each step. A dragged sphere
  // goes on straight to where the pointer is, and the cloth is given time to leave where a radius
  // grows.
  path(steps) {
    const {dt} = this;
    const duration = steps * dt;
    const ways = this.drags.map(({by, to, radius}, s) => {
      const way = to.map((k, i) => k - by[i]);
      const most = this.fastest(s) * duration;
      const part = Math.min(1, most / (Math.hypot(...way) || 1));
      const more = (this.spheres[s].radius ?? 0) - (radius ?? 0);
      return {
        by: way.map((k) => part * k),
        radius: this.isPenalty(s) ? Math.min(more, FASTEST_GROWTH * duration) : more
      };
    });
    const at = (s, n, t, inside) => {
      const [center, velocity] = motionAt(this.spheres[s], t, inside);
      const way = ways[s].by;
      return {
        center: center.map((k, i) => k + this.drags[s].by[i] + way[i] * (n / steps)),
        velocity: velocity.map((k, i) => k + way[i] / duration),
      };
    };
    const path = [];
    for (let n = 0; n <= steps; n++)
      path.push(this.spheres.map((sphere, s) => {
        const t = this.origin + (this.steps + n) * dt;
        const {radius: start} = this.drags[s];
        const radius = start === null ? Infinity : start + ways[s].radius * (n / steps);
        const stages = [0, 0.5, 1].map(
            (part) =>
                at(s, n + part, t + part * dt,
                   t + Math.min(Math.max(part, END_PART), 1 - END_PART) * dt));
        return {
          ...sphere,
          ...at(s, n, t, t),
          stages,
          radius,
          restitution: this.restitution(s),
          offset: this.contactOffset(sphere, radius)
        };
      }));
    return {path, ways};
  }
  // Take steps. An unstable one is searched for: the same steps give the same bits.
  async advance(steps) {
    const {path, ways} = this.path(steps);
    if (this.pinned) {
      const {point, at} = this.pinned;
      const v = at.map((k, i) => (k - this.planes[i * this.points + point]) / (steps * this.dt));
      this.solver.movePin(
          point, v.map((k) => k * Math.min(1, FASTEST_DRAG / (Math.hypot(...v) || 1))));
    }
    const read = await this.solver.run(path);
    if (read.bad >= 0 && steps > 1) {
      this.solver.takeBack();
      for (let n = 0; n < steps && !this.problem; n++)
        this.take(await this.solver.run(path.slice(n, n + 2)), 1);
      return;
    }
    this.take(read, steps);
    if (!this.problem)
      this.drags.forEach((m, s) => {
        m.by = m.by.map((k, i) => k + ways[s].by[i]);
        if (m.radius !== null) m.radius += ways[s].radius;
      });
  }
  take(read, steps) {
    if (read.bad >= 0) {
      this.solver.takeBack();
      const above = this.dt > this.limit;
      const [problem, remedy] = read.passed ?
          ["THROUGH THE LAYER", "a thicker or stiffer layer, or a shorter time step, holds it"] :
          [
            "UNSTABLE",
            `the time step ${this.dt.toPrecision(3)} s is ${
                above ? "above" : "within"} the guaranteed ${this.limit.toPrecision(3)} s`
          ];
      this.problem = `${problem} at step ${this.counted + 1} (t = ${
          (this.time + this.dt).toPrecision(6)} s), first at ${this.nameOf(read.bad)}: ${remedy}`;
      return;
    }
    Object.assign(this, {
      steps: this.steps + steps,
      counted: this.counted + steps,
      planes: read.planes,
      low: read.low
    });
  }
  // As it is drawn and measured: a plane is a sphere of a large radius.
  ball(
      s, {normal} = this.spheres[s], {radius} = this.drags[s],
      flat = this.baked.spheres[s].radius) {
    return {
      radius: radius ?? flat,
      center: this.centerNow(s).map((k, i) => (radius ? k : k - flat * normal[i]))
    };
  }
  // Of each penalty obstacle the energy of a mass point in its layer [J].
  layers() {
    return this.spheres.flatMap((sphere, s) => {
      if (!this.isPenalty(s)) return [];
      const {normal, stiffness, thickness} = sphere;
      const {radius} = this.drags[s];
      const center = this.centerNow(s);
      const reach = thickness + this.contactOffset(sphere, radius ?? Infinity);
      const height = (e) =>
          (radius ? Math.hypot(...e) - radius :
                    e[0] * normal[0] + e[1] * normal[1] + e[2] * normal[2]);
      return (p) => stiffness / 4 * Math.max(0, reach - height(p.map((k, i) => k - center[i]))) **
          4 / thickness ** 2;
    });
  }
  centerNow(s) {
    return motionAt(this.spheres[s], this.time)[0].map((k, i) => k + this.drags[s].by[i]);
  }
  // Keep the state as the last frame. It replaces the one before while that is nearer than
  // `interval` to its own.
  record() {
    const frame = {planes: this.planes.slice(), spheres: this.spheres.map((_, s) => this.ball(s))};
    const measured = measures(this, frame, this.layers());
    const lists = [this.t, this.frames];
    const {t} = this;
    for (const name of Object.keys(measured)) lists.push(this.curves[name] ??= []);
    if (t.length > this.most) {
      for (const list of lists) list.splice(0, list.length, ...list.filter((_, k) => k % 2 === 0));
      this.interval = 1.5 * (t.at(-1) - t[0]) / t.length;
    }
    if (t.at(-1) === this.time || (t.length > 1 && t.at(-1) - t.at(-2) < this.interval))
      for (const list of lists) list.pop();
    [this.time, frame, ...Object.values(measured)].forEach((value, k) => lists[k].push(value));
    for (const [name, value] of Object.entries(
             {stretch: measured.stretch, speed: measured.speed, depth: measured.triangles})) {
      this.tops[name] = {max: Math.max(value, this.tops[name]?.max ?? 1e-3)};
    }
  }
  // What page.js asks for.
  positions(frame) {
    const {planes} = this.frames[frame];
    for (let p = 0; p < this.points; p++)
      for (let k = 0; k < 3; k++) this.x[3 * p + k] = planes[k * this.points + p];
    return this.x;
  }
  center(s, frame) {
    return this.frames[frame].spheres[s].center;
  }
  radius(s, frame) {
    return this.frames[frame].spheres[s].radius;
  }
  lines(s) {
    return this.baked.spheres[s].lines;
  }
  value(name, frame, p) {
    const {planes: v} = this.frames[frame];
    const n = this.points;
    const [rows, columns] = this.shape;
    const row = Math.floor(p / columns);
    if (name === "speed") return Math.hypot(v[3 * n + p], v[4 * n + p], v[5 * n + p]);
    return Math.max(0, ...this.data.pairs.flatMap((pair) => [1, -1].map((way) => {
      const r = row + way * pair.row;
      const c = p % columns + way * pair.column;
      const q = r * columns + c;
      if (r < 0 || r >= rows || c < 0 || c >= columns) return 0;
      return Math.hypot(v[q] - v[p], v[n + q] - v[n + p], v[2 * n + q] - v[2 * n + p]) / pair.rest -
          1;
    })));
  }
  // "pin (0, 0)" or "mass point (3, 5)".
  nameOf(point) {
    const columns = this.shape[1];
    return `${this.pins.includes(point) ? "pin" : "mass point"} (${Math.floor(point / columns)}, ${
        point % columns})`;
  }
  says(frame) {
    const at = (name) => this.curves[name][frame];
    const mm = (name) => (1e3 * at(name)).toFixed(3);
    const deep = this.spheres.length ?
        `, deepest point ${mm("points")} mm, deepest triangle ${mm("triangles")} mm` :
        "";
    return `t = ${this.t[frame].toFixed(4)} s, energy ${at("total").toPrecision(5)} J${deep}`;
  }
}
// Energies [J], largest stretch and speed, and deepest mass point and triangle below a sphere [m],
// as Python has them.
function measures(
    {data, points: n, shape: [rows, columns], gravity: g, stiffness}, {planes: v, spheres},
    layers) {
  const values = {
    total: 0,
    kinetic: 0,
    elastic: 0,
    gravity: 0,
    contact: 0,
    stretch: 0,
    speed: 0,
    points: 0,
    triangles: 0
  };
  const pins = new Set(data.pins);
  for (let p = 0; p < n; p++) {
    const m = data.mass[data.mass.length > 1 ? p : 0];
    const speed2 = v[3 * n + p] ** 2 + v[4 * n + p] ** 2 + v[5 * n + p] ** 2;
    values.kinetic += m / 2 * speed2;
    values.speed = Math.max(values.speed, Math.sqrt(speed2));
    values.gravity -= m * (g[0] * v[p] + g[1] * v[n + p] + g[2] * v[2 * n + p]);
    if (!pins.has(p))
      for (const energy of layers) values.contact += energy([v[p], v[n + p], v[2 * n + p]]);
  }
  for (const {row, column, family, rest} of data.pairs) {
    for (let r = Math.max(0, -row); r < Math.min(rows, rows - row); r++)
      for (let c = Math.max(0, -column); c < Math.min(columns, columns - column); c++) {
        const p = r * columns + c;
        const q = p + row * columns + column;
        const more =
            Math.hypot(v[q] - v[p], v[n + q] - v[n + p], v[2 * n + q] - v[2 * n + p]) - rest;
        values.elastic += stiffness[family] / 2 * more * more;
        values.stretch = Math.max(values.stretch, more / rest);
      }
  }
  values.total = values.kinetic + values.elastic + values.gravity + values.contact;
  for (const {center, radius} of spheres) {
    const from = (p) => [v[p] - center[0], v[n + p] - center[1], v[2 * n + p] - center[2]];
    const near = radius + data.longest;
    for (let p = 0; p < n; p++) {
      const distance = Math.hypot(v[p] - center[0], v[n + p] - center[1], v[2 * n + p] - center[2]);
      values.points = Math.max(values.points, radius - distance);
      if (distance > near || (p + 1) % columns === 0 || p + columns >= n) continue;
      for (const [a, b, c] of [[p, p + columns, p + 1], [p + 1, p + columns, p + columns + 1]]) {
        values.triangles =
            Math.max(values.triangles, radius - toTriangle(from(a), from(b), from(c)));
      }
    }
  }
  values.triangles = Math.max(values.triangles, values.points);
  return values;
}
// Distance from the origin to a triangle: to its plane where the foot lies inside, else to its
// nearest side.
function toTriangle(a, b, c) {
  const minus = (u, v) => u.map((k, i) => k - v[i]);
  const dot = (u, v) => u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
  const cross =
      (u, v) => [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
  const n = cross(minus(b, a), minus(c, a));
  const nn = dot(n, n);
  const sides = [[a, b], [b, c], [c, a]];
  if (nn > 0 && sides.every(([p, q]) => dot(cross(minus(q, p), p), n) <= 0))
    return Math.abs(dot(a, n)) / Math.sqrt(nn);
  return Math.min(...sides.map(([p, q]) => {
    const way = minus(q, p);
    const part = Math.max(0, Math.min(1, -dot(p, way) / (dot(way, way) || 1)));
    return Math.hypot(...p.map((k, i) => k + part * way[i]));
  }));
}
// The guaranteed time step [s], as clothsim.max_stable_dt (cpp/measure/diagnostics.cpp,
// methods/region.py).
function guaranteed({shape: [rows, columns], mass, pins, pairs, exits}, stiffness, damping, drag) {
  const pinned = new Set(pins);
  const largest = (values) => values.reduce((a, b) => Math.max(a, b), 0);
  const narrow = Math.min(rows, columns);
  const mobile = Array.from(
      {length: rows * columns}, (_, p) => (pinned.has(p) ? 0 : 1 / mass[mass.length > 1 ? p : 0]));
  const bound = (values) => {
    const {structural: s = 0, shear: h = 0, bend: b = 0} = values;
    const inside = (x) => Math.max(-1, Math.min(1, x));
    const symbol = ([x, y]) =>
        2 * s * (2 - x - y) + 4 * h * (1 - x * y) + 4 * b * (2 - x * x - y * y);
    const on = (x) => (b > 0 ? inside(-(2 * s + 4 * h * x) / (8 * b)) : -1);
    const x = inside(-s / (2 * h + 4 * b));
    const places = [[1, -1], [1, on(1)]];
    if (narrow > 1) places.push([-1, -1], [-1, 1], [-1, on(-1)], ...(h + b > 0 ? [[x, x]] : []));
    const waves = largest(places.map(symbol)) * largest(mobile);
    if (mass.length === 1 && narrow > 2) return waves;
    return Math.min(
        waves,
        largest(mobile.map(
            (mobility, p) => pairs
                                 .flatMap((pair) => [1, -1].map((way) => {
                                   const r = Math.floor(p / columns) + way * pair.row;
                                   const c = p % columns + way * pair.column;
                                   const exists =
                                       mobility > 0 && r >= 0 && r < rows && c >= 0 && c < columns;
                                   return exists ?
                                       values[pair.family] * (mobility + mobile[r * columns + c]) :
                                       0;
                                 }))
                                 .reduce((a, b) => a + b, 0))));
  };
  const omega = Math.sqrt(bound(stiffness));
  const delta = bound(damping) + drag * largest(mobile);
  const last = exits.length - 1;
  if (!omega || !delta) return exits[omega ? 0 : last] / (omega + delta);
  const angle = exits.map((_, k) => k / last * Math.PI / 2);
  const corner = Math.atan2(delta, omega);
  const box = angle.map((k) => (k < corner ? omega / Math.cos(k) : delta / Math.sin(k)));
  const widest = (k) =>
      (angle[k] < corner && angle[k + 1] >= corner ? Math.hypot(omega, delta) :
                                                     Math.max(box[k], box[k + 1]));
  return Math.min(...exits.slice(1).map((_, k) => Math.min(exits[k], exits[k + 1]) / widest(k)));
}
// The recording as `pack` of viewing/page.py packs a run: settings of the page, and bytes in
// base64.
async function packed(live) {
  const {t, points, frames, shape, pins, dots, dotSize, label, curves, names} = live;
  const size = 3 * points;
  const count = t.length * size;
  const ends = (sign) => [0, 1, 2].map(
      (k) => sign *
          frames.reduce(
              (most, {planes}) => planes.subarray(k * points, (k + 1) * points)
                                      .reduce((a, b) => Math.max(a, sign * b), most),
              -Infinity));
  const low = ends(-1);
  const step = ends(1).map((high, k) => (high - low[k]) / 65535);
  const bytes = new Uint8Array(2 * count);
  const at = (f, p) =>
      (f < 0 ? 0 :
               Math.round(
                   (frames[f].planes[p] - low[Math.floor(p / points)]) /
                   (step[Math.floor(p / points)] || 1)));
  for (let f = 0; f < t.length; f++)
    for (let p = 0; p < size; p++) {
      const change = at(f, p) - at(f - 1, p) - (f > 1 ? at(f - 1, p) - at(f - 2, p) : 0);
      const z = (change << 16) >> 16;
      const zigzag = (z << 1) ^ (z >> 31);
      bytes[f * size + p] = zigzag;
      bytes[count + f * size + p] = zigzag >> 8;
    }
  const tops = live.spheres.length ? {depth: {max: live.tops.depth.max || 1e-3}} : {};
  const parts = [bytes];
  for (const name of names) {
    const values = Float64Array.from(
        {length: t.length * points},
        (_, k) => live.value(name, Math.floor(k / points), k % points));
    const sorted = values.slice().sort();
    const part = (k) => sorted[Math.round(k * (sorted.length - 1))];
    tops[name] = {max: part(1), top: part(0.99)};
    const levels =
        Uint8Array.from(values, (value) => Math.round(255 * Math.sqrt(value / (part(1) || 1))));
    parts.push(levels.map((level, k) => (k < points ? level : level - levels[k - points])));
  }
  const spheres = live.spheres.map((_, s) => frames.map((frame) => frame.spheres[s]))
                      .map((places, s) => ({
                             radius: places[0].radius,
                             radii: places.map(({radius}) => radius),
                             centers: places.map(({center}) => center),
                             lines: live.lines(s),
                           }));
  const run = {
    label,
    data: "data-0",
    shape,
    t,
    low,
    step,
    precision: Math.max(...step) / 2,
    spheres,
    pins,
    dots,
    dotSize,
    curves
  };
  const blob =
      await new Response(new Blob(parts).stream().pipeThrough(new CompressionStream("deflate")))
          .blob();
  const reader = new FileReader();
  const read = new Promise((resolve) => {
    reader.onload = resolve;
  });
  reader.readAsDataURL(blob);
  await read;
  return [{tops, names, runs: [run]}, reader.result.slice(reader.result.indexOf(",") + 1)];
}
function download(name, text) {
  const href = URL.createObjectURL(new Blob([text], {type: "text/plain"}));
  Object.assign(document.createElement("a"), {href, download: name}).click();
}
// The page before a script has changed it
const pristine = document.documentElement.cloneNode(true);
async function startLive() {
  const data = JSON.parse($("scene").textContent);
  const meta = JSON.parse($("meta").textContent);
  const baked = meta.runs[0];
  const solver = await Solver.open(data);
  const live = new Live(data, new Float64Array(await inflated("state")), solver, baked);
  await live.reset();
  const canvas = $("canvas-0");
  const camera = new Orbit(meta.camera);
  const side = Math.max(...data.size);
  let isHeld = false;
  let drawn = 0;
  let rate = 0;
  // One after the other: steps and changes of the state share the adapter's buffers.
  let queue = Promise.resolve();
  const then = (work) => (queue = queue.then(work).catch(fail));
  const singleStep = () => then(async () => {
    if (!live.problem) await live.advance(1);
    showLast();
  });
  const page = player([live], {...meta, names: live.names, tops: live.tops}, camera, {
    grab,
    singleStep,
    reset: () => reset(),
    get problem() {
      return live.problem;
    },
  });
  // Show the state: the newest frame, whose picture, energy and depth are of one moment.
  function showLast(wall = 0) {
    live.record();
    const last = live.t.length - 1;
    const balls = live.spheres.flatMap(({radius}, s) => {
      const path =
          baked.spheres[s].centers.map((c) => c.map((k, i) => k + live.drags[s].by[i])).concat([
            live.center(s, last)
          ]);
      const near = (c) => 2 * radius < side &&
          Math.hypot(...c.map((k, i) => k - camera.start.target[i])) < 2 * side;
      return path.filter(near).map((c) => [...c, radius]);
    });
    camera.follow(
        live.positions(last), balls,
        isHeld || canvas.matches(":hover") ?
            0 :
            1 - Math.exp(-wall / EASE));  // what a hand may take stays
    page.show(page.end(), true);
    if (performance.now() / 1000 - drawn > PAUSES || !page.state.playing) {
      page.curves.grow();
      page.legend();
      drawn = performance.now() / 1000;
    }
    $("rate").textContent = `${typed(rate * live.dt)} x real time, ${Math.round(rate)} steps/s, ${
        live.perFrame} a frame.`;
    tell(live.problem);
    if (live.problem) page.pause();
  }
  async function frame(lastTime) {
    const begin = performance.now();
    const steps = live.perFrame;
    await live.advance(steps);
    const took = (performance.now() - begin) / 1000;
    const wall = Math.max(took, (begin - lastTime) / 1000, 1e-3);
    live.adapt(steps, took, wall, Number($("speed").value));
    rate += 0.1 * (steps / wall - rate);
    showLast(wall);
    return begin;
  }
  async function loop(lastTime) {
    if (!page.state.playing || live.problem || document.hidden)
      lastTime = performance.now();
    else
      await then(async () => {
        lastTime = await frame(lastTime);
      });
    requestAnimationFrame(() => loop(lastTime));
  }
  function warn() {
    const above = live.dt > live.limit;
    const textContent = `above the guaranteed ${live.limit.toPrecision(3)} s`;
    Object.assign($("above"), {hidden: !above, textContent});
    $("dt").classList.toggle("above", above);
  }
  const changed = (change) => then(async () => {
    change();
    await live.apply();
    warn();
  });
  const times = (k) => `x ${typed(2 ** k)}`;
  const damps = (k) => `${typed(k)} N s/m`;
  const families = Object.keys(data.stiffness);
  const factors = {};
  const stiffen = (name) => (k) => {
    factors[name] = 2 ** k;
    for (const f of families)
      live.stiffness[f] = data.stiffness[f] * (factors.stiffness ?? 1) * (factors[f] ?? 1);
  };
  const damp = (k) => {
    for (const f of families) live.damping[f] = damped ? k / damped * data.damping[f] : k;
  };
  const damped = Math.max(...Object.values(data.damping));
  const down = Math.hypot(...data.gravity);
  const pull = down ? data.gravity.map((k) => k / down) : [0, -1, 0];
  const each = (name, value, most = 1, unit = "") =>
      [0,
       most,
       value,
       (k) => `${k.toFixed(2)}${unit}`,
       (k) => live.spheres.forEach((s) => {
         s[name] = k;
       }),
  ];
  const scale = (name) => [-3, 3, 0, times, (k) => live.spheres.forEach((s, n) => {
    s[name] = data.spheres[n][name] * 2 ** k;
  })];
  const first = (penalty) => live.spheres.findIndex((_, s) => live.isPenalty(s) === penalty);
  const mostDissipation = 4 *
      (Math.max(0, ...data.spheres.map(({dissipation}) => dissipation ?? 0)) ||
       data.usualDissipation);
  const spheres = data.spheres.some(({radius}) => radius !== null);  // else there are planes alone
  const sliders = {
    // place, least, most, value, how it is told, what it changes
    stiffness: ["usual", -4, 4, 0, times, stiffen("stiffness")],
    damping: ["usual", 0, 4 * (damped || data.usualDamping), damped, damps, damp],
    gravity: [
      "usual", 0, 25, down, (k) => `${k.toFixed(2)} m/s²`,
      (k) => {
        live.gravity = pull.map((u) => k * u);
      }
    ],
    dt: [
      "usual", -3, 3, 0, (k) => `${(data.dt * 2 ** k).toPrecision(3)} s`,
      (k) => live.setStep(data.dt * 2 ** k)
    ],
    radius: [
      "usual", -1, 1, 0, times, (k) => live.spheres.forEach((s, n) => {
        s.radius = data.spheres[n].radius && data.spheres[n].radius * 2 ** k;
      })
    ],
    ...Object.fromEntries(families.map((f) => [f, ["more", -4, 4, 0, times, stiffen(f)]])),
    drag: [
      "more", 0, 4 * (data.drag || data.usualDamping), data.drag, damps,
      (k) => {
        live.drag = k;
      }
    ],
    restitution: ["more", ...each("restitution", () => live.restitution(first(false)))],
    friction: ["more", ...each("friction", () => live.spheres[0].friction)],
    thickness: ["more", ...scale("thickness")],
    "layer-stiffness": ["more", ...scale("stiffness")],
    dissipation: [
      "more",
      ...each("dissipation", () => live.spheres[first(true)].dissipation, mostDissipation, " s/m")
    ],
  };
  const names = {
    dt: "time step",
    thickness: "layer thickness",
    "layer-stiffness": "layer stiffness"
  };
  for (const f of families) names[f] = `${f} stiffness`;
  for (const [id, [place, min, max, value, says, change]] of Object.entries(sliders)) {
    const label = document.createElement("label");
    const input = document.createElement("input");
    const output = document.createElement("output");
    Object.assign(input, {type: "range", id, min, max, step: "any"});
    output.id = `${id}-says`;
    label.append(names[id] ?? id, input, output);
    $(place).append(label);
    const tellValue = () => {
      output.textContent = says(input.valueAsNumber);
    };
    input.addEventListener("input", () => {
      tellValue();
      changed(() => change(input.valueAsNumber));
    });
    // A function reads the value of an obstacle; where the label is hidden, no obstacle has one.
    sliders[id] = () => {
      if (typeof value !== "function")
        input.value = value;
      else if (!label.hidden)
        input.value = value();
      tellValue();
    };
  }
  $("dt").parentElement.append($("above"));
  // Each response has parameters, and values, of its own.
  function fit() {
    const {responses} = data.methods[live.method];
    const penalty = first(true) >= 0;
    const shown = {
      radius: spheres,
      friction: responses.length,
      restitution: first(false) >= 0,
      thickness: penalty,
      "layer-stiffness": penalty,
      dissipation: penalty,
    };
    for (const [id, isShown] of Object.entries(shown)) $(id).parentElement.hidden = !isShown;
    for (const id of ["friction", "restitution", "dissipation"]) sliders[id]();
  }
  fit();
  for (const update of Object.values(sliders)) update();
  $("method").addEventListener("change", () => changed(() => {
                                           live.method = $("method").selectedIndex;
                                           fit();
                                         }));
  const offsetOf = ({side, diagonal, offset}) =>
      data.offsets[$("offset").value] ?? {side, diagonal, offset};
  $("offset").addEventListener(
      "change",
      () => changed(
          () => live.spheres.forEach((s, n) => Object.assign(s, offsetOf(data.spheres[n])))));
  $("method").parentElement.hidden = !data.spheres.length;
  $("offset").parentElement.hidden = !spheres;
  const reset = () => then(async () => {
    live.defaults();
    for (const name of Object.keys(factors)) delete factors[name];
    [$("method").selectedIndex, $("offset").selectedIndex] = [data.method, 0];
    fit();
    for (const update of Object.values(sliders)) update();
    await live.reset();
    warn();
    showLast();
    page.play();
  });
  $("reset").addEventListener("click", reset);
  // The scene as the controls have it, from its start.
  $("save-scene").addEventListener("click", async () => {
    const toml = new TextDecoder().decode(await inflated("toml"));
    const {responses, printed} = data.methods[live.method];
    const short = (all) => (new Set(Object.values(all)).size > 1 ? all : Object.values(all)[0]);
    const values = {
      gravity: live.gravity,
      stiffness: short(live.stiffness),
      damping: short(live.damping),
      drag: live.drag
    };
    const same = JSON.stringify(live.stiffness) === JSON.stringify(data.stiffness);
    live.spheres.forEach(({center, radius, restitution, friction, given, ...sphere}, s) => {
      const by = (c) => c.map((k, i) => k + live.drags[s].by[i]);
      const offset = $("offset").selectedIndex ? $("offset").value : data.spheres[s].named;
      const entry = {
        center: by(center),
        point: by(center),
        radius,
        friction,
        response: responses[s],
        as_printed: printed[s],
        offset
      };
      if (responses[s] !== "penalty") entry.restitution = restitution;
      // A parameter of a layer that follows from the cloth is written where something else decides.
      else
        for (const name of LAYER)
          entry[name] = same && sphere[name] === data.spheres[s][name] ? given[name] : sphere[name];
      for (const [name, value] of Object.entries(entry)) values[`spheres.${s}.${name}`] = value;
      values[`spheres.${s}.centers`] = data.spheres[s].centers?.map(by);
    });
    const written = (value) =>
        (typeof value !== "object" || Array.isArray(value) ?
             JSON.stringify(value) :
             `{ ${Object.entries(value).map(([key, part]) => `${key} = ${part}`).join(", ")} }`);
    const line = (text, prefix, name, suffix) =>
        ((values[name] ?? null) === null ? "" : prefix + written(values[name]) + suffix);
    download("scene.toml", toml.replace(/^(.*)"@([\w.]+)"(.*\n)/gm, line));
  });
  // The page of stored runs, with the recording in place of the run that was baked into this page.
  $("save-run").addEventListener("click", () => then(async () => {
                                            page.pause();
                                            const [fields, bytes] = await packed(live);
                                            const html = pristine.cloneNode(true);
                                            const settings =
                                                JSON.stringify({...fields, camera: camera.start});
                                            for (const part of html.querySelectorAll("[data-live]"))
                                              part.remove();
                                            html.querySelector(".stage img").src =
                                                canvas.toDataURL();
                                            html.querySelector("#data-0").textContent = bytes;
                                            html.querySelector("#meta").textContent =
                                                settings.replaceAll("<", "\\u003c");
                                            download(
                                                "recording.html",
                                                `<!DOCTYPE html>\n${html.outerHTML}`);
                                          }));
  // A pointer takes a pin near it, else the sphere under it unless it is ground, and moves it in
  // the plane of the view.
  function grab(e) {
    const [right, up] = camera.axes();
    const metre = camera.metre(canvas);
    const pixel = camera.projection(canvas);
    const distanceTo = (p) => metre *
        pixel(p, 0).slice(0, 2).reduce(
            (sum, k, i) => Math.hypot(sum, k - [e.offsetX, e.offsetY][i]), 0);
    const place = (p) => [0, 1, 2].map((k) => live.planes[k * live.points + p]);
    const shifted = (from, pointer) => from.map(
        (k, i) => k +
            metre *
                ((pointer.clientX - e.clientX) * right[i] - (pointer.clientY - e.clientY) * up[i]));
    const pin = live.pins.find((p) => distanceTo(place(p)) < Math.max(live.dotSize, 12 * metre));
    const s = live.spheres.findIndex(
        (sphere, k) => 2 * sphere.radius < side && distanceTo(live.centerNow(k)) < sphere.radius);
    if (pin === undefined && s < 0) return null;
    const from = pin === undefined ? [...live.drags[s].to] : place(pin);
    isHeld = true;
    $("held").textContent = pin === undefined ? "" : `${live.nameOf(pin)} is held.`;
    return (pointer) => {
      isHeld = pointer !== null;
      if (!isHeld) $("held").textContent = "";
      if (pin === undefined)
        live.drags[s].to = pointer ? shifted(from, pointer) : live.drags[s].to;
      else if (pointer)
        live.pinned = {point: pin, at: shifted(from, pointer)};
      else
        then(() => {
          live.pinned = null;
          solver.movePin(pin, [0, 0, 0]);
        });
    };
  }
  function fail(error) {
    live.problem ||= error.message;
    page.pause();
    tell(live.problem);
  }
  solver.lost.then((reason) => {
    live.problem = `The graphics adapter was lost (${reason}). Load the page again.`;
    fail();
  });
  [$("loop").parentElement.hidden, $("live").hidden] = [true, false];
  $("speed").value = "1";
  warn();
  window.live = {live, solver, page, camera, then};  // for tests and the curious
  showLast();
  page.ready(page.end());
  page.play();
  loop(performance.now());
}
// Without WebGPU the page plays the run that was baked into it.
Solver.missing()
    .then((reason) => {
      tell(reason);
      return reason ? start() : startLive();
    })
    .catch((error) => tell(error.message));
