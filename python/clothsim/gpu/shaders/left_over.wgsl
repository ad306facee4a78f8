// The points that `after_continuous` left over (continuous.wgsl), one after the other in the cloth's order. The core's
// cpp/contact/exact.hpp has the derivations.
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
    for (var round = 0u; round < settle_rounds; round++) {
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
    for (var contact = 0u; contact < most_contacts && !done; contact++) {
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
