// Response "penalty": a force in the layer over a sphere or plane. cpp/forces/penalty.hpp has the
// law, and operations and their order are those of cpp/forces/penalty_lanes.hpp. The curvature of a
// plane is 0, which costs no digit.
struct Layer {
    place: vec3<real>, velocity: vec3<real>, normal: vec3<real>,
    curvature: real, reach: real, push: real, dissipation: real, friction: real, slip2: real,
    deepest: real,
}

// An obstacle at the time of this stage, which the host places at the start, the middle and the end
// of each step.
fn layer_of(member: u32, obstacle: u32) -> Layer {
    let at = contact_at(member, obstacle, u32(stage == 4u));
    let now = at + 6u * (stage / 2u);
    let c = at + 21u;
    return Layer(
        vec3<real>(contact_vector(now)), vec3<real>(contact_vector(now + 3u)),
        vec3<real>(contact_vector(at + 18u)),
        real(contacts[c]), real(contacts[c + 1u]), real(contacts[c + 2u]), real(contacts[c + 3u]),
        real(contacts[c + 4u]), real(contacts[c + 5u]), real(contacts[c + 6u]));
}

// `force` plus that of an obstacle. A pinned point does not move by it. Findings are of states from
// which a step starts.
fn pressed(force: vec3<real>, x: vec3<real>, v: vec3<real>, id: vec3<u32>,
           obstacle: u32) -> vec3<real> {
    let s = layer_of(id.z, obstacle);
    let one = real(1.0);
    let e = x - s.place;
    var across = scaled(s.curvature, e) + s.normal;  // the normal, times the root
    let level = inner(e, s.normal + across);
    var square = max(product(s.curvature, level) + one, real(1e-36));
    let root = sqrt(square);
    var reciprocal = one / root;
    let depth = s.reach - level / (one + root);
    if (!(depth > real(0.0))) { return force; }
    if (is_pinned(id)) {
        if (stage == 1u && depth > s.reach) { note(pinned_inside, id); }
    } else if (stage == 1u) {
        note_value(first_contact, id.z, steps_done());
        if (depth > s.deepest) {
            let point = id.y * constants.columns + id.x;
            note_value(passed, id.z, obstacle * points() + point);
        }
    }
    if (square <= real(1e-36)) {  // in the centre
        across = s.normal;
        square = one;
        reciprocal = one;
    }
    let u = v - s.velocity;
    let closing = inner(u, across);  // times the root
    let q = product(s.dissipation, closing);
    let damped = product(q, one / sqrt(product(q, q) + square));
    let elastic = product(product(s.push, product(depth, depth)), depth);
    let push = elastic - product(elastic, damped);
    let slip = u - scaled(product(closing, product(reciprocal, reciprocal)), across);
    let resisting = product(product(s.friction, push), one / sqrt(s.slip2 + inner(slip, slip)));
    return force + (scaled(product(push, reciprocal), across) - scaled(resisting, slip));
}
