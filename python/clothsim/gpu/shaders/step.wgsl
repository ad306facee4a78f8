// A step of classic RK4 in Nystroem form, one dispatch a stage (cpp/kernels/gather/gather_impl.hpp is the same on
// the CPU). Every invocation gathers from its point's neighbours, and finishes its own point. The host writes
// `spring_forces` from `neighbours` (cpp/model/stencil.hpp). Operations and their order are the core's strict ones.
//
//   f = (K (l - L) / l + c (w.d) / l^2) d,  d = x_j - x_i, w = v_j - v_i, l = |d|    (Kim et al., eq 1)

// The state at which a stage looks: x_n for the first, then what the stage before has left.
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

fn set_target(at: u32, value: vec3<real>) {
    let n = points();
    if (stage == 2u) {
        stage_b[at] = value.x;
        stage_b[at + n] = value.y;
        stage_b[at + 2u * n] = value.z;
    } else {
        stage_a[at] = value.x;
        stage_a[at + n] = value.y;
        stage_a[at + 2u * n] = value.z;
    }
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

// `force` with that of the spring to the point `other` added.
fn pulled(force: vec3<real>, x: vec3<real>, v: vec3<real>, other: u32, first: u32) -> vec3<real> {
    let spring = Spring(parameters[first], parameters[first + 1u], parameters[first + 2u]);
    let d = source(other) - x;
    // Coincident points: a spring without direction gives no force instead of a NaN.
    let l = sqrt(max(inner(d, d), real(1e-36)));
    let r = real(1.0) / l;
    var scale = product(spring.stiffness, l - spring.rest_length);
    if (spring_damping) {
        let w = source(other + 3u * points()) - v;
        scale = product(product(spring.damping, inner(w, d)), r) + scale;
    }
    return scaled(product(scale, r), d) + force;
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

fn weight(id: vec3<u32>) -> real {
    return parameters[id.z * constants.parameter_stride + first_weight + id.y * constants.columns + id.x];
}

fn is_pinned(id: vec3<u32>) -> bool {
    return pinned && weight(id) == real(0.0);
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
    let x_n = vec3<real>(state[at], state[at + n], state[at + 2u * n]);
    let v_n = vec3<real>(state[at + 3u * n], state[at + 4u * n], state[at + 5u * n]);
    set_target(at, scaled(h, v) + x_n);
    set_target(at + 3u * n, scaled(h, a) + v_n);
    var into = at;
    var kept = a;
    if (stage != 1u) {
        into = at + 3u * n;
    }
    if (stage == 3u) {
        kept = vec3<real>(accelerations[into], accelerations[into + n], accelerations[into + 2u * n]) + a;
    }
    accelerations[into] = kept.x;
    accelerations[into + n] = kept.y;
    accelerations[into + 2u * n] = kept.z;
}

// The last stage's sums, then the collision pass: a point is moved by its own invocation only.
fn finish(id: vec3<u32>, a: vec3<real>) {
    let n = points();
    let at = place(id);
    let first = vec3<real>(accelerations[at], accelerations[at + n], accelerations[at + 2u * n]);
    let middle = vec3<real>(
        accelerations[at + 3u * n], accelerations[at + 4u * n], accelerations[at + 5u * n]);
    let x = vec3<real>(state[at], state[at + n], state[at + 2u * n]);
    let v = vec3<real>(state[at + 3u * n], state[at + 4u * n], state[at + 5u * n]);
    let dx = scaled(constants.h, v) + scaled(constants.h2_6, first + middle);
    let dv = scaled(constants.h_6, (first + a) + (middle + middle));
    var before = Body(x, vec3<real>(), v, vec3<real>());
    var body = before;
    if (compensated) {
        let low = array<real, 6>(
            compensation[at], compensation[at + n], compensation[at + 2u * n],
            compensation[at + 3u * n], compensation[at + 4u * n], compensation[at + 5u * n]);
        before.position_low = vec3<real>(low[0], low[1], low[2]);
        before.velocity_low = vec3<real>(low[3], low[4], low[5]);
        let sx = added(x.x, low[0], dx.x);
        let sy = added(x.y, low[1], dx.y);
        let sz = added(x.z, low[2], dx.z);
        let su = added(v.x, low[3], dv.x);
        let sv = added(v.y, low[4], dv.y);
        let sw = added(v.z, low[5], dv.z);
        body = Body(
            vec3<real>(sx.x, sy.x, sz.x), vec3<real>(sx.y, sy.y, sz.y),
            vec3<real>(su.x, sv.x, sw.x), vec3<real>(su.y, sv.y, sw.y));
    } else {
        body.position = x + dx;
        body.velocity = v + dv;
    }
    store_body(at, after_contacts(body, before, id));
}

fn store_body(at: u32, body: Body) {
    let n = points();
    for (var k = 0u; k < 3u; k++) {
        state[at + k * n] = body.position[k];
        state[at + (3u + k) * n] = body.velocity[k];
        if (compensated) {
            compensation[at + k * n] = body.position_low[k];
            compensation[at + (3u + k) * n] = body.velocity_low[k];
        }
    }
}

// old + increment, and what rounding takes of it (Kahan 1965).
fn added(old: real, low: real, increment: real) -> vec2<real> {
    let whole = keep(increment + low);
    let next = keep(old + whole);
    return vec2<real>(next, whole - keep(next - old));
}
