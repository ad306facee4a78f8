// The collision pass of section 5 of Kim et al. (cpp/contact is the same on the CPU). The host writes `after_contacts`,
// which goes through the scene's spheres in their order.
struct Body { position: vec3<real>, position_low: vec3<real>, velocity: vec3<real>, velocity_low: vec3<real> }

// A sphere at the moment of the pass.
struct Contact {
    center: vec3<wide>, center_low: vec3<wide>, velocity: vec3<wide>,  // low: where `wide` is too narrow
    radius: wide, restitution: wide, friction: wide,                   // radius: with the offset
    outer_radius_squared: wide,  // of the test in `real`, which finds a point too many, but none too few
    // Of a continuous sphere: radius - slop is the contact radius; a point that began inside goes outwards by `push` in
    // a step at most; epsilon of `real`; `band`, `rounding` and `excess` of offset "cell" (CellBand).
    slop: wide, push: wide, dt: wide, band: wide, epsilon: wide, rounding: wide, excess: wide,
}

// From the centre.
struct Response { moved: bool, on_surface: vec3<wide>, velocity: vec3<wide> }

fn contact_of(member: u32, sphere: u32, steps_ago: u32) -> Contact {
    var at = member * constants.contact_member_stride + sphere * contact_size;
    if (moving) { at += (atomicLoad(&results[0]) - steps_ago) * constants.contact_step_stride; }
    return Contact(
        vec3<wide>(contacts[at], contacts[at + 1u], contacts[at + 2u]),
        vec3<wide>(contacts[at + 3u], contacts[at + 4u], contacts[at + 5u]),
        vec3<wide>(contacts[at + 6u], contacts[at + 7u], contacts[at + 8u]),
        contacts[at + 9u], contacts[at + 10u], contacts[at + 11u], contacts[at + 12u], contacts[at + 13u],
        contacts[at + 14u], contacts[at + 15u], contacts[at + 16u], contacts[at + 17u], contacts[at + 18u],
        contacts[at + 19u]);
}

fn length_of(a: vec3<wide>) -> wide {
    let largest = max(abs(a.x), max(abs(a.y), abs(a.z)));
    if (!(largest > wide(0.0))) { return wide(0.0); }
    let b = a / largest;
    return wide_product(largest, sqrt(wide_inner(b, b)));
}

// A point at the exact centre leaves upwards.
fn outward_normal(m: vec3<wide>) -> vec3<wide> {
    let distance = sqrt(wide_inner(m, m));
    if (distance > wide(0.0)) { return m / distance; }
    return vec3<wide>(wide(0.0), wide(1.0), wide(0.0));
}

// Velocity that a response reflects: relative to the sphere, or absolute as printed.
fn relative(contact: Contact, velocity: vec3<wide>, as_printed: bool) -> vec3<wide> {
    return select(velocity - contact.velocity, velocity, as_printed);
}

// Eq 7, scaled by restitution, with Coulomb friction.
fn reflected(contact: Contact, velocity: vec3<wide>, normal: vec3<wide>, as_printed: bool, rough: bool) -> vec3<wide> {
    let approach = relative(contact, velocity, as_printed);
    let normal_speed = wide_inner(approach, normal);
    if (normal_speed >= wide(0.0) && !as_printed) { return velocity; }
    let impulse = wide_product(wide(1.0) + contact.restitution, normal_speed);
    let result = velocity - wide_scaled(impulse, normal);
    if (!rough) { return result; }
    let tangential = approach - wide_scaled(normal_speed, normal);
    let speed = sqrt(wide_inner(tangential, tangential));
    let most = wide_product(contact.friction, abs(impulse));
    if (speed <= most) { return result - tangential; }
    return result - wide_scaled(most / speed, tangential);
}

// Method 2 (eq 8-12): back along the ray to the surface, reflected there. With a restitution below 1 or friction the
// point goes on for the rest of the step (cpp/contact/raycast.hpp).
fn ray_response(contact: Contact, m: vec3<wide>, velocity: vec3<wide>, as_printed: bool, rough: bool) -> Response {
    let v = relative(contact, velocity, as_printed);
    let speed = length_of(v);
    var on_surface = wide_scaled(contact.radius, outward_normal(m));
    var rest = wide(0.0);
    if (speed > wide(0.0)) {
        let back = -v / speed;
        let b = wide_inner(m, back);
        if (b < wide(0.0) && !as_printed) { return Response(false, m, velocity); }  // on its way out
        let c = wide_inner(m, m) - wide_product(contact.radius, contact.radius);
        let root = sqrt(wide_product(b, b) - c);
        let distance = select(root - b, -c / (b + root), b > wide(0.0));
        on_surface = m + wide_scaled(distance, back);
        rest = min(distance / speed, wide(constants.half_h + constants.half_h));
    }
    let turned = reflected(contact, velocity, outward_normal(on_surface), as_printed, rough);
    if (!as_printed && (contact.restitution < wide(1.0) || contact.friction > wide(0.0))) {
        on_surface = on_surface + wide_scaled(rest, relative(contact, turned, as_printed));
    }
    return Response(true, on_surface, turned);
}

// The body after the response to one sphere. `ray`: method 2, else method 1, which leaves the position alone.
fn respond(body: Body, contact: Contact, member: u32, ray: bool, as_printed: bool, rough: bool) -> Body {
    let from_center = body.position - vec3<real>(contact.center);
    // Outside by rounded numbers, with a margin: nearly all points end here.
    if (!(inner(from_center, from_center) < real(contact.outer_radius_squared))) { return body; }
    let m = position_from(body, contact);
    if (!(wide_inner(m, m) < wide_product(contact.radius, contact.radius))) { return body; }
    atomicAdd(&results[1u + 3u * constants.members + member], 1u);
    let velocity = velocity_of(body);
    if (ray) { return moved_body(body, contact, ray_response(contact, m, velocity, as_printed, rough)); }
    return moved_body(body, contact, Response(false, m, reflected(contact, velocity, outward_normal(m), as_printed, rough)));
}
