// Response "penalty": a force in the layer over a sphere or plane. cpp/forces/penalty.hpp has the
// law, and operations and their order are those of cpp/forces/penalty_lanes.hpp. The curvature of a
// plane is 0, which costs no digit. Place, normal and curvature are a Surface in the arithmetic of
// a step.
struct PenaltyContact {
    place: vec3<real>, velocity: vec3<real>, normal: vec3<real>,
    curvature: real, reach: real, push: real, dissipation: real, friction: real, slip2: real,
    deepest: real,
}

// An obstacle at the time of this stage, which the host places at the start, the middle and the end
// of each step.
fn penalty_contact_of(member: u32, obstacle: u32) -> PenaltyContact {
    let at = contact_at(member, obstacle, u32(stage == 4u));
    let first = at + 6u * (stage / 2u);
    let c = at + 21u;
    return PenaltyContact(
        vec3<real>(contact_vector(first)), vec3<real>(contact_vector(first + 3u)),
        vec3<real>(contact_vector(at + 18u)),
        real(contacts[c]), real(contacts[c + 1u]), real(contacts[c + 2u]), real(contacts[c + 3u]),
        real(contacts[c + 4u]), real(contacts[c + 5u]), real(contacts[c + 6u]));
}

// `force` plus that of an obstacle. A pinned point does not move by it. Findings are of states from
// which a step starts.
fn add_contact(force: vec3<real>, x: vec3<real>, v: vec3<real>, id: vec3<u32>,
               obstacle: u32) -> vec3<real> {
    let contact = penalty_contact_of(id.z, obstacle);
    let one = real(1.0);
    let e = x - contact.place;
    var across = multiple(contact.curvature, e) + contact.normal;  // the normal, times the root
    let level = inner(e, contact.normal + across);
    var square = max(product(contact.curvature, level) + one, real(1e-36));
    let root = sqrt(square);
    var reciprocal = one / root;
    let depth = contact.reach - level / (one + root);
    if (!(depth > real(0.0))) { return force; }
    if (is_pinned(id)) {
        if (stage == 1u && depth > contact.reach) { note(pinned_inside, id); }
    } else if (stage == 1u) {
        note_value(first_contact, id.z, steps_done());
        if (depth > contact.deepest) {
            let point = id.y * constants.columns + id.x;
            note_value(passed, id.z, obstacle * points() + point);
        }
    }
    if (square <= real(1e-36)) {  // in the centre
        across = contact.normal;
        square = one;
        reciprocal = one;
    }
    let u = v - contact.velocity;
    let closing = inner(u, across);  // times the root
    let q = product(contact.dissipation, closing);
    let damping = product(q, one / sqrt(product(q, q) + square));
    let elastic = product(product(contact.push, product(depth, depth)), depth);
    let push = elastic - product(elastic, damping);
    let slip = u - multiple(product(closing, product(reciprocal, reciprocal)), across);
    let slip_root = one / sqrt(contact.slip2 + inner(slip, slip));
    let friction = product(product(contact.friction, push), slip_root);
    return force + (multiple(product(push, reciprocal), across) - multiple(friction, slip));
}
