// The cloth on the graphics adapter: the WGSL of backend="gpu" through WebGPU, in float32 with
// compensation. Four dispatches a step, workgroups of 16 x 16 x 1. The host's numbers are made as
// in gpu/shader.py, in double.
"use strict";

const NONE = 0xffffffff;
const MOST_STEPS = 512;  // a frame; the table of sphere places has one row more
const RESULTS = 24;  // bytes of `results` in layout.wgsl
// A velocity that jumps at the end of a step is that of this part of the step inside it
// (cpp/model/motion.hpp).
const END_PART = 1e-6;
// Centre and velocity of a sphere at a time, by the pieces of model/motion.py; `inside` selects the
// piece.
function motionAt({motion: m, center}, t, inside = t) {
  if (!m) return [center, [0, 0, 0]];
  const cycles = (time) => time / (m.period || 1) + m.phase;
  const whole = m.period ? Math.floor(cycles(inside)) : 0;
  const part = cycles(inside) - whole;
  const piece = m.pieces.findLast(({begin}, n) => n === 0 || begin <= part);
  const {angle, decay, amplitude} = piece;
  const u = (cycles(t) - whole - piece.begin) / piece.length;
  const seconds = piece.length * (m.period || 1);
  const all = -Math.expm1(-decay);
  const wave = decay ? -Math.expm1(-decay * u) / all : Math.sin(angle * u);
  const slope = decay ? decay * Math.exp(-decay * u) / all : angle * Math.cos(angle * u);
  const [p0, p1, p2, p3, p4, p5] = piece.polynomial;
  return [
    p0.map(
        (p, i) => (m.relative ? center[i] : 0) + p +
            u * (p1[i] + u * (p2[i] + u * (p3[i] + u * (p4[i] + u * p5[i])))) +
            amplitude[i] * wave),
    p1.map(
        (p, i) => (p + u * (2 * p2[i] + u * (3 * p3[i] + u * (4 * p4[i] + 5 * u * p5[i]))) +
                   amplitude[i] * slope) /
            seconds),
  ];
}

class Solver {
  // Why there is no solver in this browser, in words; "" if there is one.
  static async missing() {
    const stored = "This plays a stored run. To simulate, the page needs";
    const has = "Chrome and Edge from 113, Safari from 26, Firefox from 141";
    if (!window.isSecureContext)
      return `${stored} to be a file opened from this device, or to come over https.`;
    Solver.adapter = await navigator.gpu?.requestAdapter({powerPreference: "high-performance"});
    return Solver.adapter ? "" :
                            `${stored} WebGPU (${has}) and a graphics adapter, which this browser ${
                                navigator.gpu ? "does not offer" : "lacks"}.`;
  }
  static async open(data) {
    const solver = new Solver();
    Object.assign(solver, {data, device: await Solver.adapter.requestDevice()});
    solver.lost = solver.device.lost.then((info) => info.message || info.reason);
    solver.makeBuffers();
    return solver;
  }
  makeBuffers() {
    const {device, data} = this;
    const [rows, columns] = data.shape;
    const points = rows * columns;
    const U = GPUBufferUsage;
    const both = U.STORAGE | U.COPY_SRC | U.COPY_DST;
    const six = 24 * points;
    const make = (size, usage) => device.createBuffer({size: Math.ceil(size / 16) * 16, usage});
    Object.assign(this, {
      points,
      state: make(six, both),
      compensation: make(six, both),
      results: make(RESULTS, both)
    });
    const working = [0, 1, 2].map(() => make(six, U.STORAGE));
    this.parameters = make(4 * (data.firstWeight + points), U.STORAGE | U.COPY_DST);
    this.table = make(
        4 * ((MOST_STEPS + 1) * data.spheres.length * data.contactSize || 1),
        U.STORAGE | U.COPY_DST);
    this.constants = make(96, U.UNIFORM | U.COPY_DST);
    this.kept = [0, 1].map(() => make(six, U.COPY_SRC | U.COPY_DST));
    this.readback = make(RESULTS + 2 * six, U.MAP_READ | U.COPY_DST);
    const kinds = [
      "uniform", ...Array(5).fill("storage"), "read-only-storage", "read-only-storage", "storage"
    ];
    const entries = kinds.map(
        (type, binding) => ({binding, visibility: GPUShaderStage.COMPUTE, buffer: {type}}));
    this.layout = device.createBindGroupLayout({entries});
    const bound = [
      this.constants, this.state, this.compensation, ...working, this.parameters, this.table,
      this.results
    ];
    this.bindings = device.createBindGroup({
      layout: this.layout,
      entries: bound.map((buffer, binding) => ({binding, resource: {buffer}}))
    });
    this.groups = [Math.ceil(columns / data.group), Math.ceil(rows / data.group)];
  }
  // Compile the shader for a collision method, whose texts differ in `add_contacts` and
  // `respond_all` alone, and for its features.
  async compile(method, features) {
    const {device, data} = this;
    const module = device.createShaderModule({code: data.wgsl + data.methods[method].wgsl});
    const said = (await module.getCompilationInfo()).messages.filter((m) => m.type === "error");
    if (said.length) throw new Error(`The browser refuses the shader: ${said[0].message}`);
    const layout = device.createPipelineLayout({bindGroupLayouts: [this.layout]});
    const make = (entryPoint, constants) =>
        device.createComputePipelineAsync({layout, compute: {module, entryPoint, constants}});
    const constants = {...data.constants, ...features};
    this.stages =
        await Promise.all([1, 2, 3, 4].map((stage) => make("advance", {...constants, stage})));
    this.check = await make("check", {});
    this.responses = data.methods[method].responses;
  }
  write(buffer, values, at = 0) {
    this.device.queue.writeBuffer(buffer, at, values);
  }
  // Planes of positions and velocities, in double: each is split into two float32.
  load(planes) {
    this.write(this.state, new Float32Array(planes));
    this.write(this.compensation, Float32Array.from(planes, (value) => value - Math.fround(value)));
  }
  // Coefficients and the time step. `limit`: the guaranteed time step, above which speeds are
  // bounded.
  set({dt, stiffness, damping, drag, gravity, limit}) {
    const {data} = this;
    const uniform = data.mass.length === 1;
    const scale = uniform ? 1 / data.mass[0] : 1;
    const numbers = new Float32Array(data.firstWeight + this.points);
    const fast = dt > limit ? data.extent / dt : Infinity;
    numbers.set([...gravity, drag * scale, Math.min(fast, data.largestFloat)]);
    data.springs.forEach(({family, rest}, k) => {
      numbers.set(
          [(stiffness[family] ?? 0) * scale, rest, (damping[family] ?? 0) * scale],
          data.firstSpring + 3 * k);
    });
    for (let p = 0; p < this.points; p++)
      numbers[data.firstWeight + p] = 1 / data.mass[uniform ? 0 : p];
    for (const p of data.pins) numbers[data.firstWeight + p] = 0;
    this.write(this.parameters, numbers);
    this.dt = dt;
    this.write(this.constants, new Float32Array([dt / 2, dt, dt * dt / 6, dt / 6]));
    this.write(
        this.constants,
        new Uint32Array([...data.shape, 0, 0, data.spheres.length * data.contactSize, 0, 1]), 16);
  }
  // A penalty obstacle in a step, at whose stages it is; as Block writes it.
  layer(
      {stages, radius, towards, offset, thickness, stiffness, dissipation, friction, slip_speed}) {
    const {data: {mass}} = this;
    const scale = mass.length === 1 ? 1 / mass[0] : 1;
    const curvature = 1 / radius;
    const surface = (center) => center.map((c, i) => (curvature ? c + radius * towards[i] : c));
    return [
      ...stages.flatMap(({center, velocity}) => [...surface(center), ...velocity]), ...towards,
      curvature, offset + thickness, scale * stiffness / (thickness * thickness), dissipation,
      friction, slip_speed * slip_speed, 2 * thickness
    ];
  }
  // An obstacle with a response after a step, as Block writes it.
  contact({center, velocity, radius, offset, restitution, friction, normal}) {
    const {epsilon, size} = this.data;
    const curvature = 1 / radius;
    const spread = Math.min(radius, 4 * Math.hypot(...size));
    const place = center.map((c, i) => (curvature ? c + radius * normal[i] : c));
    const top = offset * (2 + curvature * offset);
    const near = top + 64 * epsilon * (spread + place.reduce((sum, k) => sum + Math.abs(k), 0));
    return [
      ...place, ...place.map((k) => k - Math.fround(k)), ...velocity, ...normal, curvature, top,
      restitution, friction, near, curvature - 64 * epsilon / spread
    ];
  }
  // Take the steps of a path: every sphere before the first step and after each, and at the stages
  // of the step that follows. Resolves to {bad, passed, planes, low}; bad is the first mass point
  // that is not finite, too fast, or through a layer, or -1.
  async run(path) {
    const {data, device} = this;
    const row = data.spheres.length * data.contactSize;
    if (row) {
      const table = new Float32Array(path.length * row);
      path.forEach((step, n) => step.forEach((sphere, s) => {
        const values = this.responses[s] === "penalty" ? this.layer(sphere) : this.contact(sphere);
        table.set(values, n * row + s * data.contactSize);
      }));
      this.write(this.table, table);
    }
    this.write(this.results, new Uint32Array([0, NONE, NONE, NONE, NONE, 0]));
    const encoder = device.createCommandEncoder();
    const six = 24 * this.points;
    [this.state, this.compensation].forEach(
        (buffer, k) => encoder.copyBufferToBuffer(buffer, 0, this.kept[k], 0, six));
    const work = encoder.beginComputePass();
    work.setBindGroup(0, this.bindings);
    for (let n = 1; n < path.length; n++)
      for (const stage of this.stages) {
        work.setPipeline(stage);
        work.dispatchWorkgroups(...this.groups);
      }
    work.setPipeline(this.check);
    work.dispatchWorkgroups(...this.groups);
    work.end();
    encoder.copyBufferToBuffer(this.results, 0, this.readback, 0, RESULTS);
    [this.state, this.compensation].forEach(
        (buffer, k) =>
            encoder.copyBufferToBuffer(buffer, 0, this.readback, RESULTS + k * six, six));
    device.queue.submit([encoder.finish()]);
    await this.readback.mapAsync(GPUMapMode.READ);
    const read = this.readback.getMappedRange().slice(0);
    this.readback.unmap();
    const [, bad, , passed] = new Uint32Array(read, 0, 4);
    const first = [bad, passed].findIndex((k) => k !== NONE);
    return {
      bad: [bad, passed % this.points][first] ?? -1,
      passed: first === 1,
      planes: new Float32Array(read, RESULTS, 6 * this.points),
      low: new Float32Array(read, RESULTS + six, 6 * this.points),
    };
  }
  takeBack() {
    const encoder = this.device.createCommandEncoder();
    [this.state, this.compensation].forEach(
        (buffer, k) => encoder.copyBufferToBuffer(this.kept[k], 0, buffer, 0, 24 * this.points));
    this.device.queue.submit([encoder.finish()]);
  }
  // A pinned mass point has no acceleration, so it keeps a velocity.
  movePin(point, velocity) {
    velocity.forEach(
        (value, k) =>
            this.write(this.state, new Float32Array([value]), 4 * ((3 + k) * this.points + point)));
  }
}
