// Continuous contact of a mass point with moving spheres, after the classic responses: the law of
// cpp/contact/continuous.hpp. The mean force of the step balances a bounce that flies, in place of spring energies.

// The host writes `spheres`, their number, `is_continuous`, and `first_continuous`.
const most_contacts = 16u;  // of a point in a step, and rounds in which it is taken out of the spheres, as in the core
const most_rounds = 100u;

// rho^2 of a mass point's cells: before the step, which tells whether the point began inside, and to be kept.
struct Radii { before: real, now: real }

// Levels: after a response, from the inside at the start, least.
struct Surface { top: wide, innermost: wide, lowest: wide }

fn least_of(s: Contact, radius2: real) -> wide { return s.least + min(wide_product(wide(radius2), s.of_cells), s.most_of_cells); }
fn surface_of(s: Contact, radii: Radii) -> Surface {
    let least = least_of(s, radii.now);
    return Surface(least + s.band, least_of(s, radii.before) - (s.least - s.innermost), least);
}

// A sphere's place after a part of the step.
fn on_path(member: u32, sphere: u32, part: wide) -> Spot {
    let start = contact_of(member, sphere, 1u).place;
    return beyond(start, wide_scaled(part, spot_from(contact_of(member, sphere, 0u).place, start)));
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

// A point that was inside, `height` high at the start, goes outwards by no more than `push` unless it moves so itself.
fn pushed_out(s: Contact, top: wide, height: wide, end: Response) -> Response {
    let now = level(s, end.d);
    if (!(now < top)) { return end; }
    let m = gradient(s, end.d);
    let length2 = wide_inner(m, m);
    var n = s.normal;
    if (length2 > wide(0.0)) { n = wide_scaled(wide(1.0) / sqrt(length2), m); }
    let inwards = min(wide_inner(end.velocity, n), wide(0.0));
    let aim = min(height_of(s, top), max(height_of(s, now), height + s.push));
    let out = Response(true, end.d, end.velocity - wide_scaled(inwards, n));
    return lifted(s, out, top, level_of(s, aim));
}

// Where a point touches a sphere within the step, and its whole way.
struct Touch { hit: bool, time: wide, place: vec3<wide>, way: vec3<wide> }

// d, q: start and way of the point.
fn touch(s: Contact, top: wide, d: vec3<wide>, q: vec3<wide>) -> Touch {
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
    return Touch(b < none && (rested || (below > none && time <= one)), time, d + wide_scaled(time, q), q);
}

// The state after a touch, with the velocity at the free end; `gain`: what the free step added to the velocity.
fn leave(s: Contact, t: Touch, velocity: vec3<wide>, gain: vec3<wide>) -> Response {
    let none = wide(0.0);
    let one = wide(1.0);
    let m = gradient(s, t.place);
    let n = wide_scaled(one / sqrt(wide_inner(m, m)), m);
    let rest = one - t.time;
    let normal_way = min(wide_inner(t.way, n), none);
    let depth = wide_product(-rest, normal_way);
    let speed = wide_inner(velocity, n);
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
    let tangential = velocity - wide_scaled(speed, n);
    let most = wide_product(s.friction, max(leaving - speed, none));
    let kept = max(one - most / sqrt(wide_inner(tangential, tangential)), none);
    let along = wide_scaled(rest, t.way - wide_scaled(normal_way, n));
    let part = select(one, kept, most > none);
    return Response(
        true, t.place + wide_scaled(part, along) + wide_scaled(height, n),
        wide_scaled(part, tangential) + wide_scaled(leaving, n));
}

// Where the levels of two spheres intersect: Newton's method along both normals.
fn on_both(a: Contact, top_a: wide, b: Contact, top_b: wide, start: Spot) -> Spot {
    var at = start;
    for (var round = 0u; round < 30u; round++) {
        let m = gradient(a, spot_from(at, a.place));
        let n = gradient(b, spot_from(at, b.place));
        let mm = wide_inner(m, m);
        let mn = wide_inner(m, n);
        let nn = wide_inner(n, n);
        let determinant = wide_product(mm, nn) - wide_product(mn, mn);
        if (determinant <= wide_product(wide_product(wide(1e-24), mm), nn)) {  // in a line with both centres
            let aside = select(vec3<wide>(-m.y, m.x, wide(0.0)), vec3<wide>(wide(0.0), -m.z, m.y), abs(m.z) > abs(m.x));
            let size = size_of_tolerance * min(a.tolerance, b.tolerance);
            at = beyond(at, wide_scaled(wide(1e-3) * size / length_of(aside), aside));
            continue;
        }
        let lacks_a = (top_a - level(a, spot_from(at, a.place))) / wide(2.0);
        let lacks_b = (top_b - level(b, spot_from(at, b.place))) / wide(2.0);
        let along_m = (wide_product(lacks_a, nn) - wide_product(lacks_b, mn)) / determinant;
        let along_n = (wide_product(lacks_b, mm) - wide_product(lacks_a, mn)) / determinant;
        at = beyond(at, wide_scaled(along_m, m) + wide_scaled(along_n, n));
        if (max(abs(lacks_a), abs(lacks_b)) < (a.band + b.band) / wide(8.0)) { break; }
    }
    return at;
}

// Takes a point out of every sphere at the end of the step. False: it is trapped between them. `placed`: on to one already.
fn taken_out(id: vec3<u32>, start: Spot, radii: Radii, at: ptr<function, Spot>, velocity: ptr<function, vec3<wide>>,
             placed: bool) -> bool {
    for (var round = 0u; round < most_rounds; round++) {
        var last = spheres;
        for (var k = 0u; k < spheres; k++) {
            if (!is_continuous(k)) { continue; }
            let s = contact_of(id.z, k, 0u);
            let surface = surface_of(s, radii);
            let begun = level(s, spot_from(start, contact_of(id.z, k, 1u).place));
            let height = height_of(s, begun);
            let was_inside = begun < surface.innermost;
            var least = select(surface.lowest, (surface.lowest + surface.innermost) / wide(2.0), placed || round > 0u);
            if (was_inside && round == 0u) {
                if (cells) { accelerations[place(id)] = real(-1.0); }
                least = surface.top;
            } else if (was_inside) {
                least = min(least, level_of(s, (height + s.push) - (surface.top - surface.lowest) / wide(2.0)));
            }
            var end = Response(false, spot_from(*at, s.place), *velocity - s.velocity);
            if (level(s, end.d) >= least) { continue; }
            if (was_inside) {
                end = pushed_out(s, surface.top, height, end);
                *at = beyond(s.place, end.d);
                *velocity = s.velocity + end.velocity;
            } else if (round > 0u && last < spheres) {
                let other = contact_of(id.z, last, 0u);
                *at = on_both(other, surface_of(other, radii).top, s, surface.top, *at);
            } else {
                *at = beyond(s.place, lifted(s, end, surface.top, surface.top).d);
            }
            last = k;
        }
        if (last == spheres) { return true; }
    }
    return false;
}

// Contacts of the step with all spheres, earliest first (cpp/contact/continuous.hpp).
fn respond_continuously(body: Body, before: Body, id: vec3<u32>) -> Body {
    let start = spot_of(before);
    var at = spot_of(body);
    var near = false;
    for (var k = 0u; k < spheres; k++) {
        let s = contact_of(id.z, k, 0u);
        let gone = (body.position - before.position) - vec3<real>(s.place.whole - contact_of(id.z, k, 1u).place.whole);
        near = near || (is_continuous(k) && is_near(s, body.position, gone));
    }
    if (cells) { accelerations[place(id)] = real(-1.0); }
    if (!near) { return body; }
    let radii = radii_of(id, real(0.0));
    if (is_pinned(id)) {
        for (var k = 0u; k < spheres; k++) {
            let s = contact_of(id.z, k, 0u);
            if (is_continuous(k) && level(s, spot_from(at, s.place)) < surface_of(s, radii).innermost) { note(1u, id); }
        }
        return body;
    }
    if (cells) { accelerations[place(id)] = radii.now; }
    var velocity = velocity_of(body);
    let gain = velocity - velocity_of(before);
    var x = start;
    var elapsed = wide(0.0);
    var last = spheres;  // away from a convex body there is no second contact with it
    for (var contact = 0u; contact <= most_contacts; contact++) {
        if (contact == most_contacts) { at = x; break; }
        var first = spheres;
        var soonest = Touch();
        for (var k = 0u; k < spheres; k++) {
            if (!is_continuous(k) || k == last) { continue; }
            let s = contact_of(id.z, k, 0u);
            let surface = surface_of(s, radii);
            let path = on_path(id.z, k, elapsed);
            let d = spot_from(x, path);
            let inside_at_start = level(s, d) < surface.innermost;
            let t = touch(s, surface.top, d, way(at, x, s.place, path));
            if (inside_at_start || !t.hit || (first < spheres && t.time >= soonest.time)) { continue; }
            first = k;
            soonest = t;
        }
        if (first == spheres) { break; }
        let s = contact_of(id.z, first, 0u);
        let surface = surface_of(s, radii);
        let end = lifted(s, leave(s, soonest, velocity - s.velocity, gain), surface.lowest, surface.top);
        at = beyond(s.place, end.d);
        velocity = s.velocity + end.velocity;
        elapsed = elapsed + wide_product(soonest.time, wide(1.0) - elapsed);
        x = beyond(on_path(id.z, first, elapsed), soonest.place);
        last = first;
    }
    if (!taken_out(id, start, radii, &at, &velocity, last < spheres)) { note(3u, id); }
    if (last == spheres && same(at, spot_of(body)) && all(velocity == velocity_of(body))) { return body; }
    return body_at(body, at, velocity);
}

// Offset "cell": each mass point keeps sqrt(R^2 + rho^2) from the centre (cpp/kernels/contact/contact_impl.hpp). The fourth
// stage leaves rho^2 in `accelerations`, or -1 for a point that is not raised.
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

fn radii_of(id: vec3<u32>, before: real) -> Radii {
    if (!cells) { return Radii(before, before); }
    let now = point_radius2(id, real(contact_of(id.z, first_continuous, 0u).excess));
    return Radii(select(before, now, stage == 4u), now);
}

// Whether a point lies deeper than its cells let it.
fn is_low(s: Contact, body: Body, radii: Radii) -> bool {
    let whole = vec3<real>(s.place.whole);
    let low = vec3<real>((s.place.whole - vec3<wide>(whole)) + s.place.low);
    let d = (body.position - whole) + (body.position_low - low);
    let n = vec3<real>(s.normal);
    let more = min(product(radii.now, real(s.of_cells)), real(s.most_of_cells));
    return inner(d, n + (n + scaled(real(s.curvature), d))) < real(s.least + s.tolerance / wide(4.0)) + more;
}

// A round of the growth of cells: points that lie too deep go outwards, and keep their velocities.
@compute @workgroup_size(group_size, group_size, 1)
fn raise(@builtin(global_invocation_id) id: vec3<u32>) {
    if (!inside(id)) { return; }
    let at = place(id);
    var body = Body(source(at), source(at + 3u * points()), vec3<real>(), vec3<real>());
    let was = spot_of(body);
    var now = was;
    var none = vec3<wide>();
    let radii = radii_of(id, accelerations[at]);
    let kept = Radii(radii.before, max(radii.before, radii.now));
    for (var k = 0u; k < spheres && accelerations[at] >= real(0.0); k++) {
        let s = contact_of(id.z, k, 0u);
        let large = is_continuous(k) && s.most_of_cells > wide(0.0) && product(radii.now, real(s.curvature)) > real(s.most_of_cells);
        if (large && level(s, spot_from(was, s.place)) <= surface_of(s, radii).top + s.tolerance) { note(2u, id); }
        if (!is_continuous(k) || !is_low(s, body, radii)) { continue; }
        if (!taken_out(id, spot_of(body_before(at)), kept, &now, &none, false)) { note(3u, id); }
        break;
    }
    if (!same(now, was)) {
        body = body_at(body, now, none);
        if (stage == 7u) { atomicStore(&results[1u + 7u * constants.members], 1u); }
    }
    if (stage == 7u) { store_state(at, body.position, body.position_low); } else { store(at, body.position, body.position_low); }
}
