// Response "continuous": the time of impact within the step, in float64 and in the sphere's frame. The core's
// cpp/kernels/contact/continuous.hpp and exact.hpp have the derivations; the names are the same.
//
// A point that meets one sphere is answered by its own invocation at the end of the fourth stage. What depends on the
// neighbours as they are now (bounces that fly for longer than a step, whose energy is balanced with the springs') and
// points near several spheres are left over: their state before the step goes to buffers that the fourth stage is
// done with, and `settle`, one invocation a member, answers them one after the other in the cloth's order.
struct Swept {
    start: vec3<wide>,
    finish: vec3<wide>,
    velocity: vec3<wide>,
    radius: wide,   // below it a point is inside
    surface: wide,  // on to which points are put
    slop: wide,     // surface - radius
    restitution: wide,
    friction: wide,
    push: wide,     // how far a point that was inside is pushed outwards in a step, at most
    dt: wide,
}

struct Motion {
    position: vec3<wide>,
    velocity: vec3<wide>,
}

struct Touch {
    hit: bool,
    inside: bool,        // at the start, by more than rounding
    time: wide,          // of the hit, part of the way that was left
    normal: vec3<wide>,
    place: vec3<wide>,   // of the hit, from the centre
    depth: wide,         // how far the rest of the way leads below the tangent plane
    along: vec3<wide>,   // the rest of the way along that plane
    speed: wide,         // normal speed at the free end
    press: wide,         // mean acceleration towards the sphere
    bounce: wide,        // normal speed after the contact
}

const zero = wide(0.0);
const one = wide(1.0);

fn swept_of(member: u32, sphere: u32) -> Swept {
    let at = contact_place(member, sphere);
    return Swept(
        vec3<wide>(contacts[at], contacts[at + 1u], contacts[at + 2u]),
        vec3<wide>(contacts[at + 3u], contacts[at + 4u], contacts[at + 5u]),
        vec3<wide>(contacts[at + 6u], contacts[at + 7u], contacts[at + 8u]),
        contacts[at + 9u], contacts[at + 13u], contacts[at + 14u], contacts[at + 10u],
        contacts[at + 11u], contacts[at + 15u], contacts[at + 12u]);
}

fn touch_of(s: Swept, p0: vec3<wide>, q: vec3<wide>, v: vec3<wide>, gain: vec3<wide>) -> Touch {
    let surface2 = wide_product(s.surface, s.surface);
    let innermost = s.surface - wide(2.0) * s.slop;
    let start2 = wide_inner(p0, p0);
    let inside = start2 < wide_product(innermost, innermost);
    let a = wide_inner(q, q);
    let b = wide_inner(p0, q);
    var closest = zero;
    if (a > zero) {
        closest = -b / a;
    }
    let m = p0 + wide_scaled(closest, q);
    let below = surface2 - wide_inner(m, m);
    let c = max(start2 - surface2, zero);
    let down = sqrt(max(wide_product(a, below), zero)) - b;
    var time = zero;
    if (down > zero) {
        time = c / down;
    }
    let hit = b < zero && below > zero && time <= one && !inside;
    let rest = one - time;
    let contact = p0 + wide_scaled(time, q);
    let distance2 = wide_inner(contact, contact);
    var inverse = zero;
    if (distance2 > zero) {
        inverse = one / sqrt(distance2);
    }
    let normal = wide_scaled(inverse, contact);
    let normal_way = min(wide_inner(q, normal), zero);
    let depth = wide_product(-rest, normal_way);
    let speed = wide_inner(v, normal);
    let press = -wide_inner(gain, normal) / s.dt;
    let arrival2 = wide_product(speed, speed) - wide_product(wide(2.0) * press, depth);
    let bounce = wide_product(s.restitution, sqrt(max(arrival2, zero)));
    return Touch(
        hit, inside, time, normal, contact, depth, wide_scaled(rest, q - wide_scaled(normal_way, normal)), speed, press, bounce);
}

// Whether a bounce is still in the air when the step after it begins.
fn flies(s: Swept, t: Touch) -> bool {
    return t.hit && t.bounce > zero && wide(2.0) * t.bounce > wide_product(t.press, s.dt);
}

// From the centre and relative to the sphere, `height` above the tangent plane.
fn leave(s: Swept, t: Touch, height: wide, normal_speed: wide, v: vec3<wide>) -> Motion {
    let tangential = v - wide_scaled(t.speed, t.normal);
    var kept = one;
    if (s.friction > zero) {
        let slip = sqrt(wide_inner(tangential, tangential));
        let most = wide_product(s.friction, max(normal_speed - t.speed, zero));
        kept = zero;
        if (slip > most) {
            kept = one - most / slip;
        }
    }
    return Motion(
        t.place + wide_scaled(kept, t.along) + wide_scaled(height, t.normal),
        wide_scaled(kept, tangential) + wide_scaled(normal_speed, t.normal));
}

// p brought to the distance `surface`.
fn lifted(p: vec3<wide>, surface: wide) -> vec3<wide> {
    let distance2 = wide_inner(p, p);
    if (distance2 > zero) {
        return wide_scaled(surface / sqrt(distance2), p);
    }
    return vec3<wide>(zero, surface, zero);
}

// A point that was inside goes outwards by no more than `push`, never deeper, and not inwards any more.
fn pushed_out(s: Swept, start_distance: wide, body: Motion) -> Motion {
    let distance = sqrt(wide_inner(body.position, body.position));
    if (distance >= s.surface) {
        return body;
    }
    let aim = min(s.surface, max(distance, start_distance + s.push));
    var n = vec3<wide>(zero, one, zero);
    if (distance > zero) {
        n = body.position / distance;
    }
    return Motion(wide_scaled(aim, n), body.velocity - wide_scaled(min(wide_inner(body.velocity, n), zero), n));
}

struct Meeting {
    changed: bool,
    in_the_air: bool,
    body: Motion,
}

fn meeting_of(s: Swept, before: Motion, after: Motion) -> Meeting {
    let p0 = before.position - s.start;
    let p1 = after.position - s.finish;
    let v = after.velocity - s.velocity;
    let t = touch_of(s, p0, p1 - p0, v, after.velocity - before.velocity);
    if (flies(s, t)) {
        return Meeting(false, true, after);
    }
    var free = Motion(p1, v);
    var changed = t.hit;
    var limit = s.surface - s.slop / wide(2.0);
    if (t.hit) {
        free = leave(s, t, zero, max(t.speed, t.bounce), v);
        limit = s.surface;
    } else if (t.inside) {
        changed = sqrt(wide_inner(p1, p1)) < s.surface;
        free = pushed_out(s, sqrt(wide_inner(p0, p0)), free);
        limit = zero;
    }
    // Rounding: whoever was outside ends outside.
    if (wide_inner(free.position, free.position) < wide_product(limit, limit)) {
        free.position = lifted(free.position, s.surface);
        changed = true;
    }
    if (!changed) {
        return Meeting(false, false, after);
    }
    return Meeting(true, false, Motion(s.finish + free.position, s.velocity + free.velocity));
}

// Whether single numbers, with a margin, say that a point may touch: |m| <= R + |q|, without the root.
fn may_touch(s: Swept, x: vec3<real>, x0: vec3<real>) -> bool {
    let m = x - vec3<real>(s.finish);
    let q = (x - x0) - vec3<real>(s.finish - s.start);
    let size = abs(s.finish.x) + abs(s.finish.y) + abs(s.finish.z) + s.surface;
    let radius = s.surface + wide(4.0) * s.slop + wide(4e-6) * size;
    return inner(m, m) < real(wide(1.0157) * radius * radius) + real(65.0) * inner(q, q);
}

// The fourth stage's own part: the body after the step, from where it was before.
fn after_continuous(body: Body, before: Body, id: vec3<u32>) -> Body {
    let member = id.z;
    var near = 0u;
    var only = swept_sphere(member, 0u);
    let at_index = id.y * constants.columns + id.x;
    for (var k = 0u; k < continuous_spheres; k++) {
        let s = swept_sphere(member, k);
        if (!may_touch(s, body.position, before.position)) {
            continue;
        }
        near++;
        if (is_pinned(id)) {
            let m = widened(body.position, body.position_low) - s.finish;
            if (sqrt(wide_inner(m, m)) < s.radius) {
                atomicMin(&results[1u + constants.members + member], at_index);
            }
        }
    }
    if (near == 0u || is_pinned(id)) {
        return body;
    }
    var left_over = continuous_spheres > 1u;
    var result = body;
    if (!left_over) {
        let start = Motion(widened(before.position, before.position_low), widened(before.velocity, before.velocity_low));
        let end = Motion(widened(body.position, body.position_low), widened(body.velocity, body.velocity_low));
        let meeting = meeting_of(only, start, end);
        left_over = meeting.in_the_air;
        if (meeting.changed) {
            result = narrowed(meeting.body.position, meeting.body.velocity);
        }
    }
    if (left_over) {
        keep_before(before, place(id));
        atomicOr(&results[flags_of(member) + at_index / 32u], 1u << (at_index % 32u));
    }
    return result;
}

// The state before the step, to where the fourth stage is done with what there was.
fn keep_before(before: Body, at: u32) {
    let n = points();
    for (var k = 0u; k < 3u; k++) {
        stage_b[at + k * n] = before.position[k];
        stage_b[at + (3u + k) * n] = before.velocity[k];
        accelerations[at + k * n] = before.position_low[k];
        accelerations[at + (3u + k) * n] = before.velocity_low[k];
    }
}

fn flags_of(member: u32) -> u32 {
    return 1u + 4u * constants.members + member * ((points() + 31u) / 32u);
}

// The points left over -------------------------------------------------------------------------------------------

fn before_of(at: u32) -> Motion {
    let n = points();
    let x = vec3<real>(stage_b[at], stage_b[at + n], stage_b[at + 2u * n]);
    let v = vec3<real>(stage_b[at + 3u * n], stage_b[at + 4u * n], stage_b[at + 5u * n]);
    let x_low = vec3<real>(accelerations[at], accelerations[at + n], accelerations[at + 2u * n]);
    let v_low = vec3<real>(accelerations[at + 3u * n], accelerations[at + 4u * n], accelerations[at + 5u * n]);
    return Motion(widened(x, x_low), widened(v, v_low));
}

fn now_of(at: u32, first: u32) -> vec3<wide> {
    let n = points();
    let base = at + first * n;
    let value = vec3<real>(state[base], state[base + n], state[base + 2u * n]);
    if (compensated) {
        return widened(value, vec3<real>(compensation[base], compensation[base + n], compensation[base + 2u * n]));
    }
    return widened(value, vec3<real>());
}

fn set_now(at: u32, value: Motion) {
    store_body(at, narrowed(value.position, value.velocity));
}

struct Owner {
    member: u32,
    row: u32,
    column: u32,
    at: u32,
}

// What the energy of a point is made of, member after member at the front of `contacts`: gravity (3), stiffness of
// each kind of spring, their rest lengths, and one mass, or one a point.
fn energy_place(o: Owner) -> u32 {
    return o.member * constants.energy_stride;
}

fn mass_of(o: Owner) -> wide {
    let at = energy_place(o) + 3u + 2u * spring_kinds;
    if (mass_per_point) {
        return contacts[at + o.row * constants.columns + o.column];
    }
    return contacts[at];
}

fn spring_energy(o: Owner, x: vec3<wide>, row: i32, column: i32, kind: u32) -> wide {
    let r = i32(o.row) + row;
    let c = i32(o.column) + column;
    if (r < 0 || r >= i32(constants.rows) || c < 0 || c >= i32(constants.columns)) {
        return zero;
    }
    let other = u32(i32(o.at) + row * i32(constants.columns) + column);
    let d = now_of(other, 0u) - x;
    let at = energy_place(o) + 3u + kind;
    let stretch = sqrt(wide_inner(d, d)) - contacts[at + spring_kinds];
    return wide_product(wide_product(contacts[at] / wide(2.0), stretch), stretch);
}

// Of all springs of a point and of gravity, if it were at x. The host writes `spring_energies`.
fn potential(o: Owner, x: vec3<wide>) -> wide {
    let at = energy_place(o);
    let gravity = vec3<wide>(contacts[at], contacts[at + 1u], contacts[at + 2u]);
    return spring_energies(o, x) - wide_product(mass_of(o), wide_inner(gravity, x));
}

fn answer_of(o: Owner, s: Swept, t: Touch, end: Motion) -> Motion {
    var normal_speed = max(t.speed, t.bounce);
    var height = zero;
    if (flies(s, t)) {
        let mass = mass_of(o);
        let plane = end.position + wide_scaled(t.depth, t.normal);
        let mirrored = wide_product(s.restitution, t.depth);
        let at_plane = potential(o, plane);
        let arrival = max(wide_product(t.speed, t.speed) + wide(2.0) * (potential(o, end.position) - at_plane) / mass, zero);
        let leaving2 = wide_product(wide_product(s.restitution, s.restitution), arrival);
        let last2 = leaving2 + wide(2.0) * (at_plane - potential(o, plane + wide_scaled(mirrored, t.normal))) / mass;
        if (last2 >= zero) {
            height = mirrored;
            normal_speed = sqrt(last2);
        } else {
            normal_speed = sqrt(leaving2);
        }
    }
    var left = leave(s, t, height, normal_speed, end.velocity - s.velocity);
    if (wide_inner(left.position, left.position) < wide_product(s.surface, s.surface)) {
        left.position = lifted(left.position, s.surface);
    }
    return Motion(s.finish + left.position, s.velocity + left.velocity);
}

// Nearest place outside two spheres that overlap, on the circle where their surfaces meet.
fn on_common_circle(a: Swept, b: Swept, x: vec3<wide>) -> vec3<wide> {
    let between = b.finish - a.finish;
    let distance = sqrt(wide_inner(between, between));
    if (distance == zero) {
        return x;
    }
    let axis = between / distance;
    let squares = wide_product(distance, distance) + wide_product(a.surface, a.surface) - wide_product(b.surface, b.surface);
    let along = squares / (wide(2.0) * distance);
    let height2 = wide_product(a.surface, a.surface) - wide_product(along, along);
    if (height2 <= zero) {
        return x;
    }
    var aside = x - a.finish;
    aside = aside - wide_scaled(wide_inner(aside, axis), axis);
    if (sqrt(wide_inner(aside, aside)) <= wide(1e-12) * distance) {
        if (abs(axis.x) > wide(1e-12) || abs(axis.y) > wide(1e-12)) {
            aside = vec3<wide>(-axis.y, axis.x, zero);
        } else {
            aside = vec3<wide>(zero, -axis.z, axis.y);
        }
    }
    let unit = aside / sqrt(wide_inner(aside, aside));
    return a.finish + wide_scaled(along, axis) + wide_scaled(sqrt(height2) + a.slop + b.slop, unit);
}

struct Settled {
    out: bool,
    body: Motion,
}

// Out of every sphere at the end of the step; not `out`: there is no way nearby, the spheres have shut it in.
fn settled(member: u32, start: vec3<wide>, body: Motion) -> Settled {
    var end = body;
    for (var round = 0; round < 100; round++) {
        var last = -1;
        for (var k = 0u; k < continuous_spheres; k++) {
            let s = swept_sphere(member, k);
            let p = end.position - s.finish;
            let from_start = start - s.start;
            let start_distance = sqrt(wide_inner(from_start, from_start));
            let was_inside = start_distance < s.surface - wide(2.0) * s.slop;
            var limit = s.surface;
            if (was_inside) {
                limit = min(s.surface, start_distance + s.push);
            }
            if (sqrt(wide_inner(p, p)) >= limit - s.slop / wide(2.0)) {
                continue;
            }
            if (round > 0 && last >= 0 && !was_inside) {
                end.position = on_common_circle(swept_sphere(member, u32(last)), s, end.position);
            } else {
                let began = select(s.surface, start_distance, was_inside);
                let pushed = pushed_out(s, began, Motion(p, end.velocity - s.velocity));
                end = Motion(s.finish + pushed.position, s.velocity + pushed.velocity);
            }
            last = i32(k);
        }
        if (last < 0) {
            return Settled(true, end);
        }
    }
    return Settled(false, end);
}

// Whole step of one point among all spheres, earliest contact first. False: shut in.
fn resolved(o: Owner) -> bool {
    let start = before_of(o.at);
    var end = Motion(now_of(o.at, 0u), now_of(o.at, 3u));
    let gain = end.velocity - start.velocity;
    var x = start.position;
    var elapsed = zero;
    var done = false;
    for (var contact = 0; contact < 16 && !done; contact++) {
        var first = -1;
        var soonest: Touch;
        for (var k = 0u; k < continuous_spheres; k++) {
            let s = swept_sphere(o.member, k);
            let p0 = x - (s.start + wide_scaled(elapsed, s.finish - s.start));
            let t = touch_of(s, p0, (end.position - s.finish) - p0, end.velocity - s.velocity, gain);
            if (!t.hit || (first >= 0 && t.time >= soonest.time)) {
                continue;
            }
            first = i32(k);
            soonest = t;
        }
        if (first < 0) {
            done = true;
            break;
        }
        let s = swept_sphere(o.member, u32(first));
        end = answer_of(o, s, soonest, end);
        elapsed += wide_product(soonest.time, one - elapsed);
        x = s.start + wide_scaled(elapsed, s.finish - s.start) + soonest.place;
        done = continuous_spheres == 1u;  // away from a convex body there is no second contact with it
    }
    if (!done) {
        end.position = x;
    }
    let result = settled(o.member, start.position, end);
    set_now(o.at, result.body);
    return result.out;
}

@compute @workgroup_size(1, 1, 1)
fn settle(@builtin(workgroup_id) id: vec3<u32>) {
    let member = id.z;
    let words = (points() + 31u) / 32u;
    let flags = flags_of(member);
    for (var word = 0u; word < words; word++) {
        var left = atomicLoad(&results[flags + word]);
        if (left == 0u) {
            continue;
        }
        atomicStore(&results[flags + word], 0u);
        while (left != 0u) {
            let index = 32u * word + firstTrailingBit(left);
            left = left & (left - 1u);
            let row = index / constants.columns;
            let column = index % constants.columns;
            let owner = Owner(member, row, column, place(vec3<u32>(column, row, member)));
            if (!resolved(owner)) {
                atomicMin(&results[1u + 2u * constants.members + member], index);
            }
        }
    }
}
