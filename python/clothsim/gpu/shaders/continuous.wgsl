// Continuous contact of a mass point with one moving sphere, after the classic responses: the law of
// cpp/kernels/contact/continuous.hpp. The mean force of the step balances a bounce that flies, in place of spring energies.

// Levels: after a response, from the inside at the start, least.
struct Surface { top: wide, innermost: wide, lowest: wide }

fn surface_of(s: Contact, radius2: real) -> Surface {
    var least = s.least;
    if (cells) { least = least + min(wide_product(wide(radius2), s.of_cells), s.most_of_cells); }
    return Surface(least + s.band, least - (s.least - s.innermost), least);
}

// A place below the level `limit` goes along its normal to the level `top`; the exact centre along that of the place.
fn lifted(s: Contact, end: Response, limit: wide, top: wide) -> Response {
    let one = wide(1.0);
    let now = level(s, end.d);
    if (!(now < limit)) { return end; }
    let length2 = one + wide_product(s.curvature, now);
    if (!(length2 > wide(0.0))) { return Response(true, wide_scaled(height_of(s, top), s.normal), end.velocity); }
    let sum = length2 + sqrt(wide_product(length2, one + wide_product(s.curvature, top)));
    return Response(true, end.d + wide_scaled((top - now) / sum, gradient(s, end.d)), end.velocity);
}

// The response at the time of impact, if that is in the step. d, q: start and way of the point; end: its free end.
fn impact(s: Contact, top: wide, end: Response, d: vec3<wide>, q: vec3<wide>, gain: vec3<wide>) -> Response {
    let none = wide(0.0);
    let one = wide(1.0);
    let start = level(s, d);
    let a = wide_product(s.curvature, wide_inner(q, q));
    let b = wide_inner(gradient(s, d), q);
    let closest = min(select(one, -b / a, a > none), one);
    let below = top - level(s, d + wide_scaled(closest, q));
    let last = b + wide_product(closest, a);
    let down = sqrt(max(wide_product(last, last) + wide_product(a, below), none)) - b;
    let rested = start <= top + s.tolerance;
    let time = select((start - top) / down, none, rested || down <= none);
    if (!(b < none && (rested || (below > none && time <= one)))) { return end; }
    let place = d + wide_scaled(time, q);
    let m = gradient(s, place);
    let n = wide_scaled(one / sqrt(wide_inner(m, m)), m);
    let rest = one - time;
    let normal_way = min(wide_inner(q, n), none);
    let depth = wide_product(-rest, normal_way);
    let speed = wide_inner(end.velocity, n);
    let press = -wide_inner(gain, n) / s.dt;
    let fall = wide_product(wide(2.0) * press, depth);
    let bounce = wide_product(s.restitution, sqrt(max(wide_product(speed, speed) - fall, none)));
    let last2 = wide_product(bounce, bounce) - wide_product(s.restitution, fall);
    var leaving = max(speed, bounce);
    var height = none;
    if (bounce > none && wide(2.0) * bounce > wide_product(press, s.dt) && last2 >= none) {  // it flies as the step ends
        height = wide_product(s.restitution, depth);
        leaving = sqrt(last2);
    }
    let tangential = end.velocity - wide_scaled(speed, n);
    let most = wide_product(s.friction, max(leaving - speed, none));
    let kept = max(one - most / sqrt(wide_inner(tangential, tangential)), none);
    let along = wide_scaled(rest, q - wide_scaled(normal_way, n));
    let part = select(one, kept, most > none);
    return Response(
        true, place + wide_scaled(part, along) + wide_scaled(height, n),
        wide_scaled(part, tangential) + wide_scaled(leaving, n));
}

fn respond_continuously(body: Body, before: Body, id: vec3<u32>) -> Body {
    let start = contact_of(id.z, continuous_sphere, 1u);
    let s = contact_of(id.z, continuous_sphere, 0u);
    if (cells) { accelerations[place(id)] = real(-1.0); }
    let gone = (body.position - before.position) - vec3<real>(s.place - start.place);
    if (!is_near(s, body.position, gone)) { return body; }
    var radius2 = real(0.0);
    if (cells) { radius2 = point_radius2(id, real(s.excess)); }
    let surface = surface_of(s, radius2);
    let d = position_from(before, start);
    let begun = level(s, d);
    var end = Response(false, position_from(body, s), velocity_of(body) - s.velocity);
    if (is_pinned(id)) {
        if (level(s, end.d) < surface.innermost) { note(1u, id); }
        return body;
    }
    if (begun < surface.innermost) {
        let now = level(s, end.d);
        if (!(now < surface.top)) { return body; }
        let m = gradient(s, end.d);
        let length2 = wide_inner(m, m);
        var n = s.normal;
        if (length2 > wide(0.0)) { n = wide_scaled(wide(1.0) / sqrt(length2), m); }
        let inwards = min(wide_inner(end.velocity, n), wide(0.0));
        let aim = min(height_of(s, surface.top), max(height_of(s, now), height_of(s, begun) + s.push));
        let out = Response(true, end.d, end.velocity - wide_scaled(inwards, n));
        end = lifted(s, out, surface.top, wide_product(aim, wide(2.0) + wide_product(s.curvature, aim)));
    } else {
        if (cells) { accelerations[place(id)] = real(1.0); }
        end = impact(s, surface.top, end, d, way(body, before, s, start), velocity_of(body) - velocity_of(before));
        end = lifted(s, end, surface.lowest, surface.top);
    }
    if (!end.moved) { return body; }
    return moved_body(body, s, Response(true, end.d, s.velocity + end.velocity));
}

// Offset "cell": each mass point keeps sqrt(R^2 + rho^2) from the centre (cpp/kernels/contact/contact_impl.hpp). The fourth
// stage leaves 1 in `accelerations`, or -1 for a point that is far or began inside.
fn squared(a: vec3<real>, b: vec3<real>) -> real { return inner(b - a, b - a); }

// The larger of radius2 and rho^2 of the triangle with the squared sides s, t and e, if it is acute and above `more`.
fn with_acute(radius2: real, more: real, s: real, t: real, e: real) -> real {
    let w = s + t - e;
    let st = product(s, t);
    let part = real(4.0) * st - product(w, w);
    let counts = w > real(0.0) && s + e > t && t + e > s && product(e, st) > product(more, part);
    return select(radius2, max(product(e, st) / part, radius2), counts);
}

// rho^2 of a cell with the corners a, b and c, d below them.
fn cell_radius2(excess: real, a: vec3<real>, b: vec3<real>, c: vec3<real>, d: vec3<real>) -> real {
    let side = vec4<real>(squared(a, b), squared(b, d), squared(d, c), squared(c, a));
    let falling = squared(a, d);
    let rising = squared(b, c);
    let longest = max(max(max(side.x, side.y), max(side.z, side.w)), max(falling, rising));
    let most = real(0.25) * longest;
    let more = product(most, excess);
    let beside = with_acute(with_acute(most, more, side.x, side.y, falling), more, side.z, side.w, falling);
    return with_acute(with_acute(beside, more, side.y, side.z, rising), more, side.w, side.x, rising);
}

// The largest of a mass point's cells. At the border a cell beyond it has no area, and counts for nothing.
fn point_radius2(id: vec3<u32>, excess: real) -> real {
    var p: array<vec3<real>, 9>;
    for (var k = 0u; k < 9u; k++) {
        let row = min(max(id.y + k / 3u, 1u), constants.rows) - 1u;
        let at = place(vec3<u32>(min(max(id.x + k % 3u, 1u), constants.columns) - 1u, row, id.z));
        if (stage == 4u) { p[k] = state_at(at); } else { p[k] = source(at); }
    }
    let above = max(cell_radius2(excess, p[0], p[1], p[3], p[4]), cell_radius2(excess, p[1], p[2], p[4], p[5]));
    return max(max(cell_radius2(excess, p[3], p[4], p[6], p[7]), cell_radius2(excess, p[4], p[5], p[7], p[8])), above);
}

// A round of the growth of cells: points that lie deeper than rho lets them go outwards, and keep their velocities.
@compute @workgroup_size(group_size, group_size, 1)
fn raise(@builtin(global_invocation_id) id: vec3<u32>) {
    if (!inside(id)) { return; }
    let at = place(id);
    var body = Body(source(at), source(at + 3u * points()), vec3<real>(), vec3<real>());
    if (accelerations[at] >= real(0.0)) {
        let s = contact_of(id.z, continuous_sphere, 0u);
        let radius2 = point_radius2(id, real(s.excess));
        let whole = vec3<real>(s.place);
        let low = vec3<real>((s.place - vec3<wide>(whole)) + s.place_low);
        let d = (body.position - whole) + (body.position_low - low);
        let n = vec3<real>(s.normal);
        let f = inner(d, n + n + scaled(real(s.curvature), d));
        let more = min(product(radius2, real(s.of_cells)), real(s.most_of_cells));
        let least = real(s.least + s.tolerance / wide(4.0));
        if (product(radius2, real(s.curvature)) > real(s.most_of_cells) && f < least + more + real(s.band)) { note(2u, id); }
        if (f < least + more) {
            let end = Response(false, position_from(body, s), vec3<wide>());
            let top = surface_of(s, radius2).top;
            body = moved_body(body, s, lifted(s, end, top, top));
            if (stage == 7u) { atomicStore(&results[1u + 4u * constants.members], 1u); }
        }
    }
    if (stage == 7u) { store_state(at, body.position, body.position_low); }
    if (stage != 7u) { store(at, body.position, body.position_low); }
}
