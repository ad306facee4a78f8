// Continuous contact of a mass point with one moving sphere, after the classic responses: the law of
// cpp/kernels/contact/continuous.hpp. The mean force of the step balances a bounce that flies, in place of spring energies.

// Distances from the centre: after a response, from the inside at the start, least without a contact, least after it.
struct Surface { top: wide, innermost: wide, lowest: wide, held: wide }

fn surface_of(s: Contact, radius2: real) -> Surface {
    if (!cells) { return Surface(s.radius, s.radius - wide(2.0) * s.slop, s.radius - s.slop / wide(2.0), s.radius); }
    let surface2 = wide_product(s.radius, s.radius);
    let least = sqrt(surface2 + min(wide_product(wide(radius2), s.rounding), surface2));
    let held = wide_product(least, wide(1.0) + s.band / wide(2.0));
    return Surface(wide_product(least, wide(1.0) + s.band), least - s.slop, least, held);
}

// A place that is nearer than `limit` goes to the distance `top`.
fn lifted(end: Response, limit: wide, top: wide) -> Response {
    let distance2 = wide_inner(end.on_surface, end.on_surface);
    if (!(distance2 < wide_product(limit, limit))) { return end; }
    return Response(true, wide_scaled(top / sqrt(distance2), end.on_surface), end.velocity);
}

// The response at the time of impact, if that is in the step. p, q: start and way of the point; end: its free end.
fn impact(s: Contact, top: wide, end: Response, p: vec3<wide>, q: vec3<wide>, gain: vec3<wide>) -> Response {
    let none = wide(0.0);
    let a = wide_inner(q, q);
    let b = wide_inner(p, q);
    let closest = p + wide_scaled(-b / a, q);
    let below = wide_product(top, top) - wide_inner(closest, closest);
    let time = max(wide_inner(p, p) - wide_product(top, top), none) / (sqrt(max(wide_product(a, below), none)) - b);
    if (!(b < none && below > none && time <= wide(1.0))) { return end; }
    let on_surface = p + wide_scaled(time, q);
    let n = wide_scaled(wide(1.0) / sqrt(wide_inner(on_surface, on_surface)), on_surface);
    let rest = wide(1.0) - time;
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
    let kept = max(wide(1.0) - most / sqrt(wide_inner(tangential, tangential)), none);
    let along = wide_scaled(rest, q - wide_scaled(normal_way, n));
    let part = select(wide(1.0), kept, most > none);
    return Response(
        true, on_surface + wide_scaled(part, along) + wide_scaled(height, n),
        wide_scaled(part, tangential) + wide_scaled(leaving, n));
}

fn respond_continuously(body: Body, before: Body, id: vec3<u32>) -> Body {
    let start = contact_of(id.z, continuous_sphere, 1u);
    let s = contact_of(id.z, continuous_sphere, 0u);
    if (cells) { accelerations[place(id)] = real(-1.0); }
    let m = body.position - vec3<real>(s.center);
    let gone = (body.position - before.position) - vec3<real>(s.center - start.center);
    if (!(inner(m, m) < real(s.outer_radius_squared) + real(near_factor) * inner(gone, gone))) { return body; }
    var radius2 = real(0.0);
    if (cells) { radius2 = point_radius2(id, real(s.excess)); }
    let surface = surface_of(s, radius2);
    let p = position_from(before, start);
    let start2 = wide_inner(p, p);
    var end = Response(false, position_from(body, s), velocity_of(body) - s.velocity);
    if (is_pinned(id) && lifted(end, surface.lowest, surface.top).moved) { note(1u, id); }
    if (is_pinned(id)) { return body; }
    if (start2 < wide_product(surface.innermost, surface.innermost)) {
        let distance = sqrt(wide_inner(end.on_surface, end.on_surface));
        if (!(distance < surface.top)) { return body; }
        let n = outward_normal(end.on_surface);
        let aim = min(surface.top, max(distance, sqrt(start2) + s.push));
        let inwards = min(wide_inner(end.velocity, n), wide(0.0));
        end = Response(true, wide_scaled(aim, n), end.velocity - wide_scaled(inwards, n));
    } else {
        if (cells) { accelerations[place(id)] = real(1.0); }
        end = impact(s, surface.top, end, p, way(body, before, s, start), velocity_of(body) - velocity_of(before));
        end = lifted(end, select(surface.lowest, surface.held, end.moved), surface.top);
    }
    if (!end.moved) { return body; }
    return moved_body(body, s, Response(true, end.on_surface, s.velocity + end.velocity));
}

// Offset "cell": each mass point keeps sqrt(R^2 + rho^2) from the centre (cpp/kernels/contact/cell_impl.hpp). The fourth
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
        let center = vec3<real>(s.center);
        let low = vec3<real>((s.center - vec3<wide>(center)) + s.center_low);
        let m = (body.position - center) + (body.position_low - low);
        let surface2 = real(wide_product(wide_product(s.radius, s.radius), wide(1.0) + wide(8.0) * s.epsilon));
        let inflated = product(radius2, real(s.rounding + wide(8.0) * s.epsilon));
        if (radius2 > surface2 && inner(m, m) < real(2.0002) * surface2) { note(2u, id); }
        if (inner(m, m) < surface2 + min(inflated, surface2)) {
            let end = Response(false, position_from(body, s), vec3<wide>());
            body = moved_body(body, s, lifted(end, wide(2.0) * s.radius, surface_of(s, radius2).top));
            if (stage == 7u) { atomicStore(&results[1u + 4u * constants.members], 1u); }
        }
    }
    if (stage == 7u) { store_state(at, body.position, body.position_low); }
    if (stage != 7u) { store(at, body.position, body.position_low); }
}
