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
