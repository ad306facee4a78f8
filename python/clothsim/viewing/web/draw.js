// Drawing with WebGL 2: the cloth as triangles, balls intersected exactly in the fragment shader.
// The view is orthographic, so a depth is a length: a first pass stores the cloth's depth, and a
// sphere's surface turns red where cloth lies under it, as in the pictures of raster.py. A place q
// from an anchor is k q.q + g.q + h outside a sphere, up to second order: k = 1 / (2 radius), g is
// its gradient at the anchor and h its value there. Float32 has room for a radius of 1e5 m, since
// the anchor of a sphere that is larger than the view is in the view, and k, g and h are computed
// in double. The anchor of another is its centre, where g is 0. A plane comes as a sphere so large
// that it is flat, with the lines of its grid, and is drawn by itself after the balls. The page
// writes the colours and lights of raster.py into SHADING before this file.
const float = (number) => number.toFixed(4);
const vec3 = (numbers) => `vec3(${numbers.map(float)})`;
const MAP_SIZE = 512;  // texels of the light's view, along each axis
const SHADOW_SPREAD = 2;  // extent of the map of a plane's shadow, in extents of the light's view
const PLANE_REACH = 1.5;  // radius of a plane, in longer sides of the view
const OUTLINE_REACH = 0.4;  // half the side of the outline of a plane seen from behind, likewise
const LEAST_FACING = 0.02;  // cosine, up to which a plane is seen from its side
// Part of the text's colour in that of a plane, of its lines, and of its outline.
const PLANE_INK = 0.08;
const LINE_INK = 0.2;
const OUTLINE_INK = 0.5;
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const minus = (a, b) => a.map((k, i) => k - b[i]);
const cross =
    (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((k) => k / Math.hypot(...a));
// Right, up and towards the light, as rows.
const LIGHT_RIGHT = unit(cross([0, 0, 1], SHADING.key));
const LIGHT_AXES = [LIGHT_RIGHT, unit(cross(SHADING.key, LIGHT_RIGHT)), unit(SHADING.key)];
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
// Cloth below a surface, by metres.
const RED = `
vec3 reddened(vec3 color, float under) {
  float red = mix(${float(SHADING.leastRed)}, 1.0, min(under / ${
    float(SHADING.fullRedDepth)}, 1.0));
  return under > 0.0 ? mix(color, ${vec3(SHADING.red)}, red) : color;
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
${SHADE + BELOW + RED}
void main() {
  float k = b.y, c = dot(at, k * at + f.xy) + f.w, root = f.z * f.z - 4.0 * k * c;
  if (root <= 0.0) discard;
  root = sqrt(root);  // along the normal, towards the eye
  // Rounding of places and depths, and of the cloth's corners to parts of a pixel, lets no sphere
  // through cloth that lies on it [m].
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
    if (alpha == 1.0 && 2.0 * k * q.z + f.z >= 0.0) shown = reddened(shown, under);
  }
  color = vec4(shown, l.a > 0.0 ? alpha : 1.0);
}`;
// The part of the light that passes the cloth, as a picture of a plane in the view of the light. A
// first disc finds how high the cloth is, and thereby the width of the shadow's edge.
const SHADOW_FRAGMENT = `#version 300 es
precision highp float;
in vec2 at;
uniform mat3 lightAxes;
uniform vec3 normal, lightScale;
uniform float lightHeight;             // of the middle of the light's view above the plane [m]
uniform highp sampler2D light;         // depths of the cloth, from the light
out vec4 color;
float above(vec3 q) {
  float depth = texture(light, 0.5 + 0.5 * q.xy * lightScale.xy).r;
  return depth < 1.0 ? max((2.0 * depth - 1.0) / lightScale.z - q.z, 0.0) : 0.0;
}
vec2 seed(float part, int k) { return sqrt(part) * vec2(cos(2.39996 * float(k)), sin(2.39996 * float(k))); }
void main() {
  vec3 n = lightAxes * normal, q = vec3(at, -(lightHeight + dot(at, n.xy)) / (abs(n.z) < 1e-3 ? 1e-3 : n.z));
  float least = 3.0 / (lightScale.x * ${MAP_SIZE}.0);
  float widest = max(${float(SHADING.lightSize)} * (-1.0 / lightScale.z - q.z), least);
  float sum = 0.0, count = 0.0, covered = 0.0;
  for (int k = 0; k < 16; k++) {
    float up = above(q + vec3(widest * seed((float(k) + 0.5) / 16.0, k), 0.0));
    sum += up;
    count += float(up > 0.0);
  }
  float width = max(${float(SHADING.lightSize)} * sum / max(count, 1.0), least);
  for (int k = 0; k < 48; k++) covered += float(above(q + vec3(width * seed((float(k) + 0.5) / 48.0, k), 0.0)) > 0.0);
  color = vec4(count > 0.0 ? 1.0 - covered / 48.0 : 1.0);
}`;
// A plane fades out around the scene. Its places are metres from the target of the view, seen along
// `eye`.
const PLANE_VERTEX = `#version 300 es
uniform vec3 scale;
out vec2 at;
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
  at = corner / scale.xy;
  gl_Position = vec4(corner, 0.0, 1.0);
}`;
const planeFragment = (balls) => `#version 300 es
precision highp float;
in vec2 at;
uniform mat3 axes, lightAxes;
uniform vec3 target, scale, eye, normal, lines[2], page, ink, middle, lightTarget, lightScale;
uniform vec2 places;                   // of the target, across the lines of the grid [m]
uniform float height, reach, tone, alpha, pixel, rounding;
uniform vec4 balls[${balls || 1}];     // centre, radius; 0 without a shadow
uniform highp sampler2D cloth;         // depths from the eye
uniform sampler2D shadow;
out vec4 color;
${RED}
float line(float place, float cell) {
  float step = fwidth(place), away = abs(place - cell * round(place / cell));
  float part = clamp((max(${
    float(SHADING.planeLine)}, 0.25 * step) + 0.5 * step - away) / step, 0.0, 1.0);
  return part * clamp(1.5 - 5.0 * step / cell, 0.0, 1.0);  // no lines closer than a few pixels
}
// Part of the light that reaches a point past the cloth and the balls.
float lit(vec3 point) {
  vec2 q = (lightAxes * (point - lightTarget)).xy;
  float lit = texture(shadow, 0.5 + 0.5 * q * lightScale.xy / ${SHADOW_SPREAD}.0).r;
  for (int k = 0; k < ${balls}; k++) {
    vec3 way = balls[k].xyz - point;
    float towards = dot(way, lightAxes[2]), beside = sqrt(max(dot(way, way) - towards * towards, 0.0));
    float edge = ${float(SHADING.lightSize)} * towards;
    if (balls[k].w > 0.0 && towards > 0.0) lit = min(lit, smoothstep(-edge, edge, beside - balls[k].w));
  }
  return lit;
}
void main() {
  float facing = dot(eye, normal);
  vec3 beside = vec3(at, 0.0) * axes;
  float z = -(height + dot(beside, normal)) / facing;
  vec3 q = beside + z * eye, way = q - middle;
  vec2 place = places + vec2(dot(q, lines[0]), dot(q, lines[1]));
  float grid = max(max(line(place.x, ${float(SHADING.planeCell)}), line(place.y, ${
    float(SHADING.planeCell)})),
                   max(line(place.x, ${float(10 * SHADING.planeCell)}), line(place.y, ${
    float(10 * SHADING.planeCell)})));
  float away = sqrt(max(dot(way, way) - pow(dot(way, normal), 2.0), 0.0)) / reach;
  if (away >= 1.0) discard;
  float slack = rounding + pixel / 16.0 * sqrt(max(1.0 - facing * facing, 0.0));
  float depth = 0.5 + 0.5 * (z - slack / facing) * scale.z;
  gl_FragDepth = clamp(depth, 0.0, 0.999999);
  vec3 shown = mix(mix(page, ink, ${float(PLANE_INK)}), ink, ${float(LINE_INK)} * grid);
  shown *= tone * mix(${float(SHADING.planeInShadow)}, 1.0, lit(target + q));
  float behind = texelFetch(cloth, ivec2(gl_FragCoord.xy), 0).r;
  float under = behind < 1.0 && alpha == 1.0 ? (z - (2.0 * behind - 1.0) / scale.z) * facing - slack : 0.0;
  color = vec4(reddened(shown, under), alpha * smoothstep(0.0, 1.0, 2.0 - 2.0 * away));
}`;
// A plane seen from behind, or from its side, is the outline of a square on it.
const OUTLINE_VERTEX = `#version 300 es
uniform mat3 axes; uniform vec3 target, scale, corners[4]; uniform vec2 half_line;
void main() {
  vec3 a = axes * (corners[gl_InstanceID] - target) * scale, b = axes * (corners[(gl_InstanceID + 1) % 4] - target) * scale;
  vec2 way = (b.xy - a.xy) / half_line;
  way /= max(length(way), 1e-6);
  vec3 end = gl_VertexID < 2 ? a : b;
  vec2 beside = vec2(-way.y, way.x) * (gl_VertexID % 2 == 0 ? 1.0 : -1.0) + (gl_VertexID < 2 ? -way : way);
  gl_Position = vec4(end.xy + beside * half_line, clamp(end.z, -0.99999, 0.99999), 1.0);
}`;
const OUTLINE_FRAGMENT = `#version 300 es
precision highp float;
uniform vec3 page, ink;
out vec4 color;
void main() { color = vec4(mix(page, ink, ${float(OUTLINE_INK)}), 1.0); }`;
const stopsOf = (mode) => SHADING[mode === "depth" ? "heat" : "viridis"];
const DARK = matchMedia("(prefers-color-scheme: dark)");
const rgb = (hex) => [0, 2, 4].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);
// Anchor and k, g and h of a sphere, see above; `camera` is an Orbit.
function formOf(center, radius, {start: {target, reach}}) {
  if (radius < reach) return [...center, 0.5 / radius, 0, 0, 0, -radius / 2];
  const way = target.map((k, i) => k - center[i]);
  const out = Math.hypot(...way) - radius;
  return [...target, 0.5 / radius, ...way.map((k) => k / radius), out * (1 + out / (2 * radius))];
}

class Drawing {
  constructor(canvas, run, camera) {
    const gl =
        canvas.getContext("webgl2", {alpha: false, antialias: false, preserveDrawingBuffer: true});
    if (!gl) throw new Error("This page needs WebGL 2, which this browser does not offer.");
    Object.assign(this, {canvas, gl, run, camera});
    const [rows, columns] = run.shape;
    const points = rows * columns;
    Object.assign(this, {normals: new Float32Array(3 * points), values: new Float32Array(points)});
    this.cloth = this.program(CLOTH_VERTEX, clothFragment(run.compared));
    this.clothDepth = this.program(CLOTH_VERTEX, "#version 300 es\nvoid main() {}");
    this.balls = this.program(BALL_VERTEX, BALL_FRAGMENT);
    this.clothArray = gl.createVertexArray();
    gl.bindVertexArray(this.clothArray);
    this.buffers =
        [3, 3, 2, 1].map((size, k) => this.buffer(gl.ARRAY_BUFFER, null, [[k, size, 0, 0]]));
    this.upload(
        this.buffers[2],
        Float32Array.from(
            {length: 2 * points},
            (_, k) => (k % 2 ? Math.floor(k / 2 / columns) : (k / 2) % columns)));
    const corners = Array
                        .from(
                            {length: points},
                            (_, p) =>
                                (p % columns + 1 < columns && p + columns < points ?
                                     [p, p + columns, p + 1, p + 1, p + columns, p + columns + 1] :
                                     []))
                        .flat();
    this.count = {corners: corners.length};
    this.buffer(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(corners));
    this.ballArray = gl.createVertexArray();
    gl.bindVertexArray(this.ballArray);
    this.ballBuffer = this.buffer(gl.ARRAY_BUFFER, null, [0, 1, 2].map((k) => [k, 4, 48, 16 * k]));
    for (const k of [0, 1, 2]) gl.vertexAttribDivisor(k, 1);
    gl.bindVertexArray(null);
    this.depths = this.depthPass();
    if (run.spheres.some((_, s) => run.lines(s))) {
      this.casterCount = run.compared && run.spheres.filter((_, s) => !run.lines(s)).length;
      this.plane = this.program(PLANE_VERTEX, planeFragment(this.casterCount));
      this.outline = this.program(OUTLINE_VERTEX, OUTLINE_FRAGMENT);
      this.shadow = this.program(PLANE_VERTEX, SHADOW_FRAGMENT);
      this.light = this.depthPass();
      this.size(this.light, MAP_SIZE, MAP_SIZE);
      this.shadows = run.spheres.map((_, s) => run.lines(s) && this.shadowPass());
    }
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }
  buffer(target, data, attributes = []) {
    const {gl} = this;
    const buffer = gl.createBuffer();
    gl.bindBuffer(target, buffer);
    if (data) gl.bufferData(target, data, gl.STATIC_DRAW);
    for (const [place, size, stride, offset] of attributes) {
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, gl.FLOAT, false, stride, offset);
    }
    return buffer;
  }
  program(vertex, fragment) {
    const {gl} = this;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS))
      throw new Error(gl.getProgramInfoLog(program));
    return (name) => name ? gl.getUniformLocation(program, name) : gl.useProgram(program);
  }
  // Two samples a pixel along each axis, which the browser averages. WebGL's multisampling tests
  // depths of the cloth beside the pixel's middle against that of the ball in the middle, and shows
  // the ball where it is a tenth of a millimetre below.
  resize() {
    const {gl, canvas} = this;
    const ratio = Math.max(2, window.devicePixelRatio || 1);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map(
        (size) => Math.max(1, Math.round(size * ratio)));
    if (canvas.width === width && canvas.height === height && this.sized) return;
    Object.assign(canvas, {width, height});
    this.sized = true;
    this.size(this.depths, width, height);
  }
  // A texture of the cloth's depths, and what draws into it.
  depthPass() {
    return {texture: this.gl.createTexture(), buffer: this.gl.createFramebuffer()};
  }
  // A texture of a plane's shadow, and what draws into it.
  shadowPass() {
    const {gl} = this;
    const pass = this.depthPass();
    gl.bindTexture(gl.TEXTURE_2D, pass.texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.R8, MAP_SIZE, MAP_SIZE, 0, gl.RED, gl.UNSIGNED_BYTE, null);
    this.filter(gl.LINEAR);
    gl.bindFramebuffer(gl.FRAMEBUFFER, pass.buffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, pass.texture, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return pass;
  }
  filter(kind) {
    const {gl} = this;
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
      gl.texParameteri(gl.TEXTURE_2D, side, kind);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T])
      gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
  }
  size({texture, buffer}, width, height) {
    const {gl} = this;
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(
        gl.TEXTURE_2D, 0, gl.DEPTH_COMPONENT24, width, height, 0, gl.DEPTH_COMPONENT,
        gl.UNSIGNED_INT, null);
    this.filter(gl.NEAREST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, texture, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }
  upload(buffer, data) {
    const {gl} = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
  }
  // A frame in a colour mode: {name, top}; both are kept until the next call.
  load(frame, mode) {
    const {run, values} = this;
    const x = run.positions(frame);
    const size = run.dotSize;
    this.mode = mode;
    pointNormals(x, run.shape, this.normals);
    run.values(frame, mode, values);
    [x, this.normals, null, values].forEach((data, k) => {
      if (data) this.upload(this.buffers[k], data);
    });
    const obstacles = run.spheres.map((_, s) => ({
                                        center: run.center(s, frame),
                                        radius: run.radius(s, frame),
                                        lines: run.lines(s),
                                        shadow: this.shadows?.[s],
                                      }));
    const forms = obstacles.map(({center, radius}) => formOf(center, radius, this.camera));
    this.sphereData = forms.slice(0, run.compared).flat();
    this.planes = obstacles.filter(({lines}) => lines);
    this.casters =
        obstacles.filter(({lines}) => !lines)
            .map(({center, radius}) => [...center, radius < this.camera.start.reach ? radius : 0]);
    const color = SHADING[mode.name === "depth" ? "darkSphere" : "sphere"];
    const balls = forms.filter((_, s) => !obstacles[s].lines).map((form) => [...form, ...color, 1]);
    const dot = (color) => (p) =>
        balls.push([...formOf(x.subarray(3 * p, 3 * p + 3), size, this.camera), ...color, 0]);
    run.pins.forEach(dot(DARK.matches ? SHADING.pin.map((k) => 1 - k) : SHADING.pin));
    run.dots.forEach(dot(SHADING.front));
    this.count.balls = balls.length;
    this.upload(this.ballBuffer, new Float32Array(balls.flat()));
    if (this.planes.length) this.drawShadows(lightViewOf(x));
  }
  draw(camera) {
    this.resize();
    const {gl, canvas, mode} = this;
    const view = {
      axes: camera.axes(),
      target: camera.target,
      scale: camera.scale(canvas.width / canvas.height)
    };
    if (this.planes.length) view.scale[2] /= 3;  // planes reach further than the scene
    const {scale} = view;
    const set = (program) => this.look(program, view);
    gl.clearColor(...rgb(css("--page").slice(1)), 1);
    this.drawDepths(this.depths, view, canvas.width, canvas.height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    set(this.cloth);
    gl.uniform1i(this.cloth("mode"), {faces: 0, depth: 2}[mode.name] ?? 1);
    gl.uniform1f(this.cloth("top"), mode.top || 1);
    gl.uniform3fv(this.cloth("stops"), stopsOf(mode.name).flatMap(rgb));
    if (this.run.compared) gl.uniform4fv(this.cloth("spheres"), this.sphereData);
    gl.drawElements(gl.TRIANGLES, this.count.corners, gl.UNSIGNED_INT, 0);
    set(this.balls);
    gl.bindTexture(
        gl.TEXTURE_2D, this.depths.texture);  // of the unit 0, which `cloth` has without a word
    const numbers = {
      rounding: 2 * this.run.precision + 1e-5 * Math.max(1, camera.start.width),
      pixel: 2 / (scale[0] * canvas.width),
      alpha: mode.name === "depth" ? 0.3 : 1,
    };
    for (const [name, value] of Object.entries(numbers)) gl.uniform1f(this.balls(name), value);
    gl.enable(gl.BLEND);
    gl.bindVertexArray(this.ballArray);
    if (mode.name === "depth")
      gl.disable(gl.DEPTH_TEST);  // glass: cloth in a sphere is what this mode shows
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.count.balls);
    gl.enable(gl.DEPTH_TEST);
    for (const plane of this.planes) this.drawPlane(plane, view, numbers);
  }
  // Set the view of a program, and use it.
  look(program, {axes, target, scale}) {
    const {gl} = this;
    program();
    gl.uniformMatrix3fv(
        program("axes"), true,
        axes.flat());  // right, up and towards the eye: rows; GLSL wants columns
    for (const [name, value] of Object.entries({target, scale, eye: axes[2]}))
      gl.uniform3fv(program(name), value);
  }
  // Store the depths of the cloth in a view.
  drawDepths({buffer}, view, width, height) {
    const {gl} = this;
    gl.disable(gl.BLEND);
    gl.bindVertexArray(this.clothArray);
    gl.viewport(0, 0, width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    this.look(this.clothDepth, view);
    gl.drawElements(gl.TRIANGLES, this.count.corners, gl.UNSIGNED_INT, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }
  // Store the shadow that the cloth casts on each plane; `view` is that of the light.
  drawShadows(view) {
    const {gl, shadow} = this;
    this.lightView = view;
    this.drawDepths(this.light, view, MAP_SIZE, MAP_SIZE);
    gl.bindTexture(gl.TEXTURE_2D, this.light.texture);
    gl.disable(gl.DEPTH_TEST);
    for (const {center, radius, lines, shadow: {buffer}} of this.planes) {
      gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
      this.look(shadow, {...view, scale: view.scale.map((k) => k / SHADOW_SPREAD)});
      gl.uniformMatrix3fv(shadow("lightAxes"), true, view.axes.flat());
      gl.uniform3fv(shadow("lightScale"), view.scale);
      gl.uniform3fv(shadow("normal"), cross(...lines));
      gl.uniform1f(shadow("lightHeight"), Math.hypot(...minus(view.target, center)) - radius);
      gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    }
    gl.enable(gl.DEPTH_TEST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }
  // Draw a plane that faces the eye as a surface, another as an outline.
  drawPlane({center, radius, lines, shadow}, view, {alpha, rounding, pixel}) {
    const {gl, canvas, lightView, camera: {start}} = this;
    const {target} = view;
    const normal = cross(...lines);
    const heightOf = (place) => Math.hypot(...minus(place, center)) - radius;
    const program = dot(view.axes[2], normal) > LEAST_FACING ? this.plane : this.outline;
    const side = Math.max(start.width, start.height);
    const height = heightOf(target);
    const foot = start.target.map((k, i) => k - heightOf(start.target) * normal[i]);
    const corner = ([a, b]) =>
        foot.map((k, i) => k + OUTLINE_REACH * side * (a * lines[0][i] + b * lines[1][i]));
    const vectors = {
      normal,
      lines: lines.flat(),
      corners: [[1, 1], [1, -1], [-1, -1], [-1, 1]].flatMap(corner),
      middle: minus(start.target, target),
      page: rgb(css("--page").slice(1)),
      ink: rgb(css("--ink").slice(1)),
      lightTarget: lightView.target,
      lightScale: lightView.scale,
    };
    const numbers = {
      alpha: (1 + alpha) / 2,
      rounding,
      pixel,
      height,
      reach: PLANE_REACH * side,
      tone: toneOf(normal)
    };
    this.look(program, view);
    for (const [name, value] of Object.entries(vectors)) gl.uniform3fv(program(name), value);
    for (const [name, value] of Object.entries(numbers)) gl.uniform1f(program(name), value);
    gl.uniformMatrix3fv(program("lightAxes"), true, lightView.axes.flat());
    gl.uniform2fv(
        program("places"),
        lines.map((line) => dot(minus(target, center), line) % (10 * SHADING.planeCell)));
    gl.uniform2f(program("half_line"), 3 / canvas.width, 3 / canvas.height);
    if (this.casterCount) gl.uniform4fv(program("balls"), this.casters.flat());
    gl.uniform1i(program("shadow"), 1);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, shadow.texture);
    gl.activeTexture(gl.TEXTURE0);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, program === this.plane ? 1 : 4);
  }
}
// The view from the light, which holds the points x.
function lightViewOf(x) {
  const low = [0, 0, 0].fill(Infinity);
  const high = [0, 0, 0].fill(-Infinity);
  for (let p = 0; p < x.length; p += 3)
    LIGHT_AXES.forEach(([a, b, c], k) => {
      const place = a * x[p] + b * x[p + 1] + c * x[p + 2];
      low[k] = Math.min(low[k], place);
      high[k] = Math.max(high[k], place);
    });
  const middle = low.map((k, i) => (k + high[i]) / 2);
  const half = low.map((k, i) => 0.51 * (high[i] - k) + 1e-6);
  const across = Math.max(half[0], half[1]);
  const target =
      [0, 1, 2].map((i) => LIGHT_AXES.reduce((sum, axis, k) => sum + middle[k] * axis[i], 0));
  return {axes: LIGHT_AXES, target, scale: [1 / across, 1 / across, -1 / half[2]]};
}
// Brightness of a plane over that of a level one, as in pictures.
function toneOf(normal) {
  const [ambient, above, key] = SHADING.light;
  const light = (n) => ambient + above * n[1] + key * Math.max(0, dot(n, LIGHT_AXES[2]));
  return 1 - SHADING.toneOfPlanes * (1 - light(normal) / light([0, 1, 0]));
}
// Normals of the sheet by central differences along rows and columns; up (+y) for the flat sheet.
function pointNormals(x, [, columns], out) {
  for (let p = 0; p < x.length; p += 3) {
    const row = 3 * columns;
    const c = p % row;
    const u = p + row < x.length ? p + row : p;
    const d = p >= row ? p - row : p;
    const e = c + 3 < row ? p + 3 : p;
    const w = c > 0 ? p - 3 : p;
    const ax = x[u] - x[d];
    const ay = x[u + 1] - x[d + 1];
    const az = x[u + 2] - x[d + 2];
    const bx = x[e] - x[w];
    const by = x[e + 1] - x[w + 1];
    const bz = x[e + 2] - x[w + 2];
    const nx = ay * bz - az * by;
    const ny = az * bx - ax * bz;
    const nz = ax * by - ay * bx;
    const length = Math.hypot(nx, ny, nz) || 1;
    out[p] = nx / length;
    out[p + 1] = ny / length;
    out[p + 2] = nz / length;
  }
}
