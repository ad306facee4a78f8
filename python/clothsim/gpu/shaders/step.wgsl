// A step of classic RK4 in Nystroem form, one dispatch a stage (cpp/kernels/gather/gather_impl.hpp
// is the same on the CPU). Every invocation gathers from its point's neighbours, and finishes its
// own point. The host writes `spring_forces` from `neighbours` (cpp/model/stencil.hpp), and
// `add_contacts` (penalty.wgsl). Operations and their order are those of the core's kernel.
//
//   f = (K (l - L) / l + c (w.d) / l^2) d,  d = x_j - x_i, w = v_j - v_i, l = |d|    (eq 1)

fn state_at(at: u32) -> vec3<real> {
    let n = points();
    return vec3<real>(state[at], state[at + n], state[at + 2u * n]);
}

fn low_at(at: u32) -> vec3<real> {
    let n = points();
    return vec3<real>(compensation[at], compensation[at + n], compensation[at + 2u * n]);
}

fn point_state(at: u32) -> PointState {
    let v_at = at + 3u * points();
    if (compensated) { return PointState(state_at(at), low_at(at), state_at(v_at), low_at(v_at)); }
    return PointState(state_at(at), vec3<real>(), state_at(v_at), vec3<real>());
}

fn acceleration_at(at: u32) -> vec3<real> {
    let n = points();
    return vec3<real>(accelerations[at], accelerations[at + n], accelerations[at + 2u * n]);
}

// A vector that the stage before left for this one: x_n for the first; then it stands in the buffer
// that the stage does not write.
fn source(at: u32) -> vec3<real> {
    let n = points();
    if (stage == 1u) { return state_at(at); }
    if (stage % 2u == 1u) { return vec3<real>(stage_b[at], stage_b[at + n], stage_b[at + 2u * n]); }
    return vec3<real>(stage_a[at], stage_a[at + n], stage_a[at + 2u * n]);
}

// Two vectors for the stage after this one.
fn store(at: u32, first: vec3<real>, second: vec3<real>) {
    for (var k = 0u; k < 6u; k++) {
        let value = select(second[k % 3u], first[k % 3u], k < 3u);
        let to = at + k * points();
        if (stage % 2u == 1u) { stage_a[to] = value; } else { stage_b[to] = value; }
    }
}

// A vector of the state after the step.
fn store_state(at: u32, value: vec3<real>, low: vec3<real>) {
    for (var k = 0u; k < 3u; k++) {
        state[at + k * points()] = value[k];
        if (compensated) { compensation[at + k * points()] = low[k]; }
    }
}

// `force` plus the force of the spring to the point `other`.
fn add_spring(force: vec3<real>, x: vec3<real>, v: vec3<real>, other: u32,
              first: u32) -> vec3<real> {
    let d = source(other) - x;
    // Coincident points: a spring without direction gives no force instead of a NaN.
    let l = sqrt(max(inner(d, d), real(1e-36)));
    let r = real(1.0) / l;
    var scale = product(parameters[first], l - parameters[first + 1u]);
    if (spring_damping) {
        let w = source(other + 3u * points()) - v;
        scale = product(product(parameters[first + 2u], inner(w, d)), r) + scale;
    }
    return multiple(product(scale, r), d) + force;
}

fn weight(id: vec3<u32>) -> real {
    let first = id.z * constants.parameter_stride + first_weight;
    return parameters[first + id.y * constants.columns + id.x];
}

fn is_pinned(id: vec3<u32>) -> bool { return pinned && weight(id) == real(0.0); }

fn acceleration(id: vec3<u32>, x: vec3<real>, v: vec3<real>) -> vec3<real> {
    let base = id.z * constants.parameter_stride;
    var a = add_contacts(spring_forces(id, x, v), x, v, id);
    if (drag) { a = a - multiple(parameters[base + 3u], v); }
    if (mass_per_point) { a = multiple(weight(id), a); }
    a = a + vec3<real>(parameters[base], parameters[base + 1u], parameters[base + 2u]);
    if (is_pinned(id)) { a = vec3<real>(); }
    return a;
}

@compute @workgroup_size(group_size, group_size, 1)
fn advance(@builtin(global_invocation_id) id: vec3<u32>) {
    if (stage % 2u == 1u && all(id == vec3<u32>(0u))) { atomicAdd(&results[0], 1u); }
    if (!inside(id)) { return; }
    let at = place(id);
    let v_at = at + 3u * points();
    let v = source(v_at);
    let a = acceleration(id, source(at), v);
    if (stage == 4u) { finish(id, a); return; }
    let h = select(constants.half_h, constants.h, stage == 3u);
    store(at, multiple(h, v) + state_at(at), multiple(h, a) + state_at(v_at));
    let into = select(v_at, at, stage == 1u);
    var sum = a;
    if (stage == 3u) { sum = acceleration_at(into) + a; }
    for (var k = 0u; k < 3u; k++) { accelerations[into + k * points()] = sum[k]; }
}

// The last stage's sums, then the responses: a point is moved by its own invocation only.
fn finish(id: vec3<u32>, a: vec3<real>) {
    let at = place(id);
    let v_at = at + 3u * points();
    let first = acceleration_at(at);
    let middle = acceleration_at(v_at);
    let start = point_state(at);
    let dx = multiple(constants.h, start.velocity) + multiple(constants.h2_6, first + middle);
    let dv = multiple(constants.h_6, (first + a) + (middle + middle));
    var point = PointState(start.position + dx, vec3<real>(), start.velocity + dv, vec3<real>());
    if (compensated) {
        let x = add_increment(start.position, start.position_low, dx);
        let v = add_increment(start.velocity, start.velocity_low, dv);
        point = PointState(x[0], x[1], v[0], v[1]);
    }
    if (!is_pinned(id)) { point = respond_all(point, id); }
    store_state(at, point.position, point.position_low);
    store_state(v_at, point.velocity, point.velocity_low);
}

// old + increment, and its rounding error (Kahan 1965).
fn add_increment(old: vec3<real>, low: vec3<real>, increment: vec3<real>) -> array<vec3<real>, 2> {
    let whole = keep_all(increment + low);
    let next = keep_all(old + whole);
    return array<vec3<real>, 2>(next, whole - keep_all(next - old));
}
