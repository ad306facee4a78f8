// A step of classic RK4 in Nystroem form, one dispatch a stage (cpp/kernels/gather/gather_impl.hpp is the same on
// the CPU). Every invocation gathers from its point's neighbours, and finishes its own point. The host writes
// `spring_forces` from `neighbours` (cpp/model/stencil.hpp). Operations and their order are the core's strict ones.
//
//   f = (K (l - L) / l + c (w.d) / l^2) d,  d = x_j - x_i, w = v_j - v_i, l = |d|    (Kim et al., eq 1)

// A vector of the state at which a stage evaluates forces: x_n for the first, then the result of the stage before.
fn source(at: u32) -> vec3<real> {
    let n = points();
    if (stage == 1u) {
        return vec3<real>(state[at], state[at + n], state[at + 2u * n]);
    }
    if (stage == 3u) {
        return vec3<real>(stage_b[at], stage_b[at + n], stage_b[at + 2u * n]);
    }
    return vec3<real>(stage_a[at], stage_a[at + n], stage_a[at + 2u * n]);
}

fn state_at(at: u32) -> vec3<real> {
    return vec3<real>(state[at], state[at + points()], state[at + 2u * points()]);
}

fn acceleration_at(at: u32) -> vec3<real> {
    return vec3<real>(accelerations[at], accelerations[at + points()], accelerations[at + 2u * points()]);
}

fn product(a: real, b: real) -> real {
    if (strict) {
        return keep(a * b);
    }
    return a * b;
}

fn scaled(a: real, b: vec3<real>) -> vec3<real> {
    return vec3<real>(product(a, b.x), product(a, b.y), product(a, b.z));
}

fn inner(a: vec3<real>, b: vec3<real>) -> real {
    return product(a.z, b.z) + (product(a.y, b.y) + product(a.x, b.x));
}

// `force` plus the force of the spring to the point `other`.
fn pulled(force: vec3<real>, x: vec3<real>, v: vec3<real>, other: u32, first: u32) -> vec3<real> {
    let d = source(other) - x;
    // Coincident points: a spring without direction gives no force instead of a NaN.
    let l = sqrt(max(inner(d, d), real(1e-36)));
    let r = real(1.0) / l;
    var scale = product(parameters[first], l - parameters[first + 1u]);
    if (spring_damping) {
        let w = source(other + 3u * points()) - v;
        scale = product(product(parameters[first + 2u], inner(w, d)), r) + scale;
    }
    return scaled(product(scale, r), d) + force;
}

fn weight(id: vec3<u32>) -> real {
    return parameters[id.z * constants.parameter_stride + first_weight + id.y * constants.columns + id.x];
}

fn is_pinned(id: vec3<u32>) -> bool {
    return pinned && weight(id) == real(0.0);
}

fn acceleration(id: vec3<u32>, x: vec3<real>, v: vec3<real>) -> vec3<real> {
    let base = id.z * constants.parameter_stride;
    var a = spring_forces(id, x, v);
    if (drag) {
        a = a - scaled(parameters[base + 3u], v);
    }
    if (mass_per_point) {
        a = scaled(weight(id), a);
    }
    a = a + vec3<real>(parameters[base], parameters[base + 1u], parameters[base + 2u]);
    if (is_pinned(id)) {
        a = vec3<real>();
    }
    return a;
}

@compute @workgroup_size(group_size, group_size, 1)
fn advance(@builtin(global_invocation_id) id: vec3<u32>) {
    if (moving && stage == 1u && all(id == vec3<u32>(0u))) {
        atomicAdd(&results[0], 1u);  // read by the fourth stage
    }
    if (!inside(id)) {
        return;
    }
    let n = points();
    let at = place(id);
    let x = source(at);
    let v = source(at + 3u * n);
    let a = acceleration(id, x, v);
    if (stage == 4u) {
        finish(id, a);
        return;
    }
    var h = constants.half_h;
    if (stage == 3u) {
        h = constants.h;
    }
    let next_x = scaled(h, v) + state_at(at);
    let next_v = scaled(h, a) + state_at(at + 3u * n);
    var into = at;
    var kept = a;
    if (stage != 1u) {
        into = at + 3u * n;
    }
    if (stage == 3u) {
        kept = acceleration_at(into) + a;
    }
    for (var k = 0u; k < 3u; k++) {
        if (stage == 2u) {
            stage_b[at + k * n] = next_x[k];
            stage_b[at + (3u + k) * n] = next_v[k];
        } else {
            stage_a[at + k * n] = next_x[k];
            stage_a[at + (3u + k) * n] = next_v[k];
        }
        accelerations[into + k * n] = kept[k];
    }
}

// The last stage's sums, then the collision pass: a point is moved by its own invocation only.
fn finish(id: vec3<u32>, a: vec3<real>) {
    let n = points();
    let at = place(id);
    let first = acceleration_at(at);
    let middle = acceleration_at(at + 3u * n);
    let v = state_at(at + 3u * n);
    let dx = scaled(constants.h, v) + scaled(constants.h2_6, first + middle);
    let dv = scaled(constants.h_6, (first + a) + (middle + middle));
    var before = Body(state_at(at), vec3<real>(), v, vec3<real>());
    var body = before;
    if (compensated) {
        for (var k = 0u; k < 3u; k++) {
            before.position_low[k] = compensation[at + k * n];
            before.velocity_low[k] = compensation[at + (3u + k) * n];
            let x_sum = added(before.position[k], before.position_low[k], dx[k]);
            let v_sum = added(before.velocity[k], before.velocity_low[k], dv[k]);
            body.position[k] = x_sum.x;
            body.position_low[k] = x_sum.y;
            body.velocity[k] = v_sum.x;
            body.velocity_low[k] = v_sum.y;
        }
    } else {
        body.position = before.position + dx;
        body.velocity = v + dv;
    }
    body = after_contacts(body, before, id);
    for (var k = 0u; k < 3u; k++) {
        state[at + k * n] = body.position[k];
        state[at + (3u + k) * n] = body.velocity[k];
        if (compensated) {
            compensation[at + k * n] = body.position_low[k];
            compensation[at + (3u + k) * n] = body.velocity_low[k];
        }
    }
}

// old + increment, and its rounding error (Kahan 1965).
fn added(old: real, low: real, increment: real) -> vec2<real> {
    let whole = keep(increment + low);
    let next = keep(old + whole);
    return vec2<real>(next, whole - keep(next - old));
}
