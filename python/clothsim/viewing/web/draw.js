// Drawing with WebGL 2: the cloth as triangles, balls intersected exactly in the fragment shader.
// The view is orthographic, so a depth is a length: a first pass stores the cloth's depth, and a sphere's surface turns red
// where cloth lies under it, as in the pictures of raster.py.
// A place q from an anchor is k q.q + g.q + h outside a sphere, up to second order: k = 1 / (2 radius), g is its gradient
// at the anchor and h its value there. Float32 has room for a radius of 1e5 m, since the anchor of a sphere that is larger
// than the view is in the view, and k, g and h are computed in double. The anchor of another is its centre, where g is 0.
// The page writes the colours and lights of raster.py into SHADING before this file.
const float = (number) => number.toFixed(4);
const vec3 = (numbers) => `vec3(${numbers.map(float)})`;
const [AMBIENT, ABOVE, FROM_KEY, FROM_EYE] = SHADING.light.map(float);

const SHADE = `
vec3 shade(vec3 color, vec3 n, vec3 eye) {
  float key = max(dot(n, normalize(${vec3(SHADING.key)})), 0.0), front = max(dot(n, eye), 0.0);
  return color * (${AMBIENT} + ${ABOVE} * n.y + ${FROM_KEY} * key + ${FROM_EYE} * front);
}`;
// Metres below a sphere's surface.
const BELOW = `
float below(vec3 q, float k, vec3 g, float h) {
  float f = dot(q, k * q + g) + h;
  return -2.0 * f / (1.0 + sqrt(max(1.0 + 4.0 * k * f, 0.0)));
}`;
const CLOTH_VERTEX = `#version 300 es
layout(location = 0) in vec3 position; layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 cell; layout(location = 3) in float value;
uniform mat3 axes; uniform vec3 target, scale;
out vec3 n, place; out vec2 at; out float amount;
void main() {
  n = normal; at = cell; amount = value; place = position;
  gl_Position = vec4(axes * (position - target) * scale, 1.0);
}`;
const clothFragment = (spheres) => `#version 300 es
precision highp float;
in vec3 n, place; in vec2 at; in float amount;
uniform vec3 eye, stops[9];
uniform int mode;                        // 0 faces, 1 values of the points, 2 depth below a sphere
uniform float top;                       // depth that has the last colour [m]
uniform vec4 spheres[${2 * spheres || 1}];  // anchor, k; g, h
out vec4 color;
${SHADE + BELOW}
void main() {
  vec3 normal = normalize(n);
  bool front = dot(normal, eye) >= 0.0;
  vec3 c = front ? ${vec3(SHADING.front)} : ${vec3(SHADING.back)};
  if (mode > 0) {
    float shown = amount;
    if (mode == 2) {
      shown = 0.0;
      for (int s = 0; s < ${2 * spheres}; s += 2) {
        vec4 a = spheres[s], b = spheres[s + 1];
        shown = max(shown, below(place - a.xyz, a.w, b.xyz, b.w));
      }
      shown /= top;
    }
    float k = clamp(shown, 0.0, 1.0) * 8.0; int low = min(int(k), 7);
    c = mix(stops[low], stops[low + 1], k - float(low));
  }
  vec2 width = fwidth(at);
  vec2 line = 1.0 - smoothstep(vec2(0.05) - width, vec2(0.05) + width, abs(fract(at - 0.5) - 0.5));
  float fade = clamp(1.6 - 5.0 * max(width.x, width.y), 0.0, 1.0);  // no lines closer than a few pixels
  c *= 1.0 - 0.28 * fade * max(line.x, line.y);
  color = vec4(shade(c, front ? normal : -normal, eye), 1.0);
}`;
const BALL_VERTEX = `#version 300 es
layout(location = 0) in vec4 ball;   // anchor, k
layout(location = 1) in vec4 form;   // g, h
layout(location = 2) in vec4 look;   // colour, 1 if cloth in it is shown
uniform mat3 axes; uniform vec3 target, scale;
out vec2 at;                         // from the anchor, in the plane of the view [m]
flat out vec4 f, l;                  // g in the axes of the view, h
flat out vec2 b;                     // the anchor's height in the view, k
void main() {
  vec3 anchor = axes * (ball.xyz - target), g = axes * form.xyz;
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
  bool large = dot(g, g) > 0.0;
  vec2 place = large ? corner / scale.xy : anchor.xy + corner * (0.5 / ball.w);
  f = vec4(g, form.w); l = look; b = vec2(anchor.z, ball.w);
  at = place - anchor.xy;
  // From inside, a ground or a wall is not seen. The eye is where the depths begin.
  vec3 eye = vec3(0.0, 0.0, -1.0 / scale.z) - anchor;
  bool inside = large && dot(eye, ball.w * eye + g) + form.w < 0.0;
  gl_Position = vec4(inside ? vec2(2.0) : place * scale.xy, 0.0, 1.0);
}`;
const BALL_FRAGMENT = `#version 300 es
precision highp float;
in vec2 at; flat in vec4 f, l; flat in vec2 b;
uniform mat3 axes; uniform vec3 scale, eye; uniform float alpha, pixel, rounding; uniform highp sampler2D cloth;
out vec4 color;
${SHADE + BELOW}
void main() {
  float k = b.y, c = dot(at, k * at + f.xy) + f.w, root = f.z * f.z - 4.0 * k * c;
  if (root <= 0.0) discard;
  root = sqrt(root);  // along the normal, towards the eye
  // Rounding of places and depths, and of the cloth's corners to parts of a pixel, lets no sphere through cloth that lies on it [m].
  float slack = rounding + pixel / 16.0 * sqrt(max(1.0 - root * root, 0.0));
  vec3 q = vec3(at, f.z > 0.0 ? -2.0 * c / (f.z + root) : (root - f.z) / (2.0 * k));
  float depth = 0.5 + 0.5 * (q.z + b.x - slack / max(root, 0.05)) * scale.z;
  // What is behind the eye is not seen, such as the near side of a wall that is seen from its back.
  if (depth < 0.0) discard;
  gl_FragDepth = min(depth, 0.999999);  // ground reaches further than the depths do
  vec3 shown = shade(l.rgb, normalize(2.0 * k * q + f.xyz) * axes, eye);
  float behind = texelFetch(cloth, ivec2(gl_FragCoord.xy), 0).r;
  if (l.a > 0.0 && behind < 1.0) {
    q.z = (2.0 * behind - 1.0) / scale.z - b.x;  // the cloth
    float under = below(q, k, f.xyz, f.w) - slack;
    // Cloth on the far half of the ball is not what the eye sees here.
    bool red = alpha == 1.0 && 2.0 * k * q.z + f.z >= 0.0 && under > 0.0;
    if (red) shown = mix(shown, ${vec3(SHADING.red)}, mix(${float(SHADING.leastRed)}, 1.0, min(under / ${float(SHADING.fullRedDepth)}, 1.0)));
  }
  color = vec4(shown, l.a > 0.0 ? alpha : 1.0);
}`;
const stopsOf = (mode) => SHADING[mode === "depth" ? "heat" : "viridis"];
const DARK = matchMedia("(prefers-color-scheme: dark)");
const rgb = (hex) => [0, 2, 4].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);
// Anchor and k, g and h of a sphere, see above; `camera` is an Orbit.
function formOf(center, radius, { start: { target, reach } }) {
  if (radius < reach) return [...center, 0.5 / radius, 0, 0, 0, -radius / 2];
  const way = target.map((k, i) => k - center[i]), out = Math.hypot(...way) - radius;
  return [...target, 0.5 / radius, ...way.map((k) => k / radius), out * (1 + out / (2 * radius))];
}

class Drawing {
  constructor(canvas, run, camera) {
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("This page needs WebGL 2, which this browser does not offer.");
    Object.assign(this, { canvas, gl, run, camera });
    const [rows, columns] = run.shape, points = rows * columns;
    Object.assign(this, { normals: new Float32Array(3 * points), values: new Float32Array(points) });
    this.cloth = this.program(CLOTH_VERTEX, clothFragment(run.compared));
    this.clothDepth = this.program(CLOTH_VERTEX, "#version 300 es\nvoid main() {}");
    this.balls = this.program(BALL_VERTEX, BALL_FRAGMENT);
    this.clothArray = gl.createVertexArray();
    gl.bindVertexArray(this.clothArray);
    this.buffers = [3, 3, 2, 1].map((size, k) => this.buffer(gl.ARRAY_BUFFER, null, [[k, size, 0, 0]]));
    this.upload(this.buffers[2], Float32Array.from({ length: 2 * points }, (_, k) => (k % 2 ? Math.floor(k / 2 / columns) : (k / 2) % columns)));
    const corners = Array.from({ length: points }, (_, p) => (p % columns + 1 < columns && p + columns < points
      ? [p, p + columns, p + 1, p + 1, p + columns, p + columns + 1] : [])).flat();
    this.count = { corners: corners.length };
    this.buffer(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(corners));
    this.ballArray = gl.createVertexArray();
    gl.bindVertexArray(this.ballArray);
    this.ballBuffer = this.buffer(gl.ARRAY_BUFFER, null, [0, 1, 2].map((k) => [k, 4, 48, 16 * k]));
    for (const k of [0, 1, 2]) gl.vertexAttribDivisor(k, 1);
    gl.bindVertexArray(null);
    this.depths = gl.createTexture();
    this.depthPass = gl.createFramebuffer();
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }
  buffer(target, data, attributes = []) {
    const { gl } = this, buffer = gl.createBuffer();
    gl.bindBuffer(target, buffer);
    if (data) gl.bufferData(target, data, gl.STATIC_DRAW);
    for (const [place, size, stride, offset] of attributes) {
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, gl.FLOAT, false, stride, offset);
    }
    return buffer;
  }
  program(vertex, fragment) {
    const { gl } = this, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    return (name) => name ? gl.getUniformLocation(program, name) : gl.useProgram(program);
  }
  // Two samples a pixel along each axis, which the browser averages. WebGL's multisampling tests depths of the cloth beside the
  // pixel's middle against that of the ball in the middle, and shows the ball where it is a tenth of a millimetre below.
  resize() {
    const { gl, canvas } = this, ratio = Math.max(2, window.devicePixelRatio || 1);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((size) => Math.max(1, Math.round(size * ratio)));
    if (canvas.width === width && canvas.height === height && this.sized) return;
    Object.assign(canvas, { width, height });
    this.sized = true;
    gl.bindTexture(gl.TEXTURE_2D, this.depths);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.DEPTH_COMPONENT24, width, height, 0, gl.DEPTH_COMPONENT, gl.UNSIGNED_INT, null);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.NEAREST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.depthPass);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, this.depths, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }
  upload(buffer, data) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
  }
  // A frame in a colour mode: {name, top}; both are kept until the next call.
  load(frame, mode) {
    const { run, values } = this, x = run.positions(frame), size = run.dotSize;
    this.mode = mode;
    pointNormals(x, run.shape, this.normals);
    run.values(frame, mode, values);
    [x, this.normals, null, values].forEach((data, k) => { if (data) this.upload(this.buffers[k], data); });
    const balls = run.spheres.map((s, k) => [...formOf(run.center(k, frame), run.radius(k, frame), this.camera), ...SHADING[mode.name === "depth" ? "darkSphere" : "sphere"], 1]);
    const dot = (color) => (p) => balls.push([...formOf(x.subarray(3 * p, 3 * p + 3), size, this.camera), ...color, 0]);
    run.pins.forEach(dot(DARK.matches ? SHADING.pin.map((k) => 1 - k) : SHADING.pin));
    run.dots.forEach(dot(SHADING.front));
    this.sphereData = balls.slice(0, run.compared).flatMap((ball) => ball.slice(0, 8));
    this.count.balls = balls.length;
    this.upload(this.ballBuffer, new Float32Array(balls.flat()));
  }
  draw(camera) {
    this.resize();
    const { gl, canvas, mode } = this;
    const scale = camera.scale(canvas.width / canvas.height), axes = camera.axes();
    gl.viewport(0, 0, canvas.width, canvas.height);
    const set = (program) => {
      program();
      gl.uniformMatrix3fv(program("axes"), true, axes.flat());  // right, up and towards the eye: rows; GLSL wants columns
      for (const [name, value] of Object.entries({ target: camera.target, scale, eye: axes[2] })) gl.uniform3fv(program(name), value);
    };
    gl.clearColor(...rgb(getComputedStyle(document.documentElement).getPropertyValue("--page").trim().slice(1)), 1);
    gl.disable(gl.BLEND);
    gl.bindVertexArray(this.clothArray);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.depthPass);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    set(this.clothDepth);
    gl.drawElements(gl.TRIANGLES, this.count.corners, gl.UNSIGNED_INT, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    set(this.cloth);
    gl.uniform1i(this.cloth("mode"), mode.name === "faces" ? 0 : mode.name === "depth" ? 2 : 1);
    gl.uniform1f(this.cloth("top"), mode.top || 1);
    gl.uniform3fv(this.cloth("stops"), stopsOf(mode.name).flatMap(rgb));
    if (this.run.compared) gl.uniform4fv(this.cloth("spheres"), this.sphereData);
    gl.drawElements(gl.TRIANGLES, this.count.corners, gl.UNSIGNED_INT, 0);
    set(this.balls);
    gl.bindTexture(gl.TEXTURE_2D, this.depths);  // of the unit 0, which `cloth` has without a word
    const numbers = {
      rounding: 2 * this.run.precision + 1e-5 * Math.max(1, camera.start.width), pixel: 2 / (scale[0] * canvas.width),
      alpha: mode.name === "depth" ? 0.3 : 1,
    };
    for (const [name, value] of Object.entries(numbers)) gl.uniform1f(this.balls(name), value);
    gl.enable(gl.BLEND);
    gl.bindVertexArray(this.ballArray);
    if (mode.name === "depth") gl.disable(gl.DEPTH_TEST);  // glass: cloth in a sphere is what this mode shows
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.count.balls);
    gl.enable(gl.DEPTH_TEST);
  }
}
// Normals of the sheet by central differences along rows and columns; up (+y) for the flat sheet.
function pointNormals(x, [, columns], out) {
  for (let p = 0; p < x.length; p += 3) {
    const row = 3 * columns, c = p % row, u = p + row < x.length ? p + row : p, d = p >= row ? p - row : p;
    const e = c + 3 < row ? p + 3 : p, w = c > 0 ? p - 3 : p;
    const ax = x[u] - x[d], ay = x[u + 1] - x[d + 1], az = x[u + 2] - x[d + 2];
    const bx = x[e] - x[w], by = x[e + 1] - x[w + 1], bz = x[e + 2] - x[w + 2];
    const nx = ay * bz - az * by, ny = az * bx - ax * bz, nz = ax * by - ay * bx, length = Math.hypot(nx, ny, nz) || 1;
    out[p] = nx / length; out[p + 1] = ny / length; out[p + 2] = nz / length;
  }
}
