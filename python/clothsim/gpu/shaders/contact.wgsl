// The collision pass of section 5 of Kim et al. (cpp/contact is the same on the CPU). The host writes `after_contacts`,
// which goes through the scene's spheres in their order.
struct Body {
    position: vec3<real>,
    position_low: vec3<real>,
    velocity: vec3<real>,
    velocity_low: vec3<real>,
}

// A sphere at the moment of the pass.
struct Contact {
    center: vec3<wide>,
    center_low: vec3<wide>,  // where `wide` is too narrow for the centre
    velocity: vec3<wide>,
    radius: wide,            // with the offset
    restitution: wide,
    friction: wide,
    outer_radius_squared: wide,
}

struct Response {
    moved: bool,
    on_surface: vec3<wide>,  // from the centre
    velocity: vec3<wide>,
}

fn contact_place(member: u32, sphere: u32) -> u32 {
    let at = member * constants.contact_member_stride + sphere * contact_size;
    if (moving) {
        return at + (atomicLoad(&results[0]) - 1u) * constants.contact_step_stride;
    }
    return at;
}

fn contact_of(member: u32, sphere: u32) -> Contact {
    let at = contact_place(member, sphere);
    return Contact(
        vec3<wide>(contacts[at], contacts[at + 1u], contacts[at + 2u]),
        vec3<wide>(contacts[at + 3u], contacts[at + 4u], contacts[at + 5u]),
        vec3<wide>(contacts[at + 6u], contacts[at + 7u], contacts[at + 8u]),
        contacts[at + 9u], contacts[at + 10u], contacts[at + 11u], contacts[at + 12u]);
}

fn wide_product(a: wide, b: wide) -> wide {
    if (strict) {
        return keep_wide(a * b);
    }
    return a * b;
}

fn wide_scaled(a: wide, b: vec3<wide>) -> vec3<wide> {
    return vec3<wide>(wide_product(a, b.x), wide_product(a, b.y), wide_product(a, b.z));
}

// In the order in which the core's vectors of double sum.
fn wide_inner(a: vec3<wide>, b: vec3<wide>) -> wide {
    return (wide_product(a.x, b.x) + wide_product(a.y, b.y)) + wide_product(a.z, b.z);
}

fn length_of(a: vec3<wide>) -> wide {
    let largest = max(abs(a.x), max(abs(a.y), abs(a.z)));
    if (largest > wide(0.0)) {
        let b = a / largest;
        return wide_product(largest, sqrt(wide_inner(b, b)));
    }
    return wide(0.0);
}

// A point at the exact centre leaves upwards.
fn outward_normal(m: vec3<wide>) -> vec3<wide> {
    let distance = sqrt(wide_inner(m, m));
    if (distance > wide(0.0)) {
        return m / distance;
    }
    return vec3<wide>(wide(0.0), wide(1.0), wide(0.0));
}

// Velocity that a response reflects: relative to the sphere, or absolute as printed.
fn relative(contact: Contact, velocity: vec3<wide>, as_printed: bool) -> vec3<wide> {
    if (as_printed) {
        return velocity;
    }
    return velocity - contact.velocity;
}

// Eq 7, scaled by restitution, with Coulomb friction.
fn reflected(
    contact: Contact, velocity: vec3<wide>, normal: vec3<wide>, as_printed: bool, rough: bool
) -> vec3<wide> {
    let approach = relative(contact, velocity, as_printed);
    let normal_speed = wide_inner(approach, normal);
    if (normal_speed >= wide(0.0) && !as_printed) {
        return velocity;
    }
    let impulse = wide_product(wide(1.0) + contact.restitution, normal_speed);
    var result = velocity - wide_scaled(impulse, normal);
    if (rough) {
        let tangential = approach - wide_scaled(normal_speed, normal);
        let speed = sqrt(wide_inner(tangential, tangential));
        let most = wide_product(contact.friction, abs(impulse));
        if (speed <= most) {
            result = result - tangential;
        } else {
            result = result - wide_scaled(most / speed, tangential);
        }
    }
    return result;
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
        if (b < wide(0.0) && !as_printed) {
            return Response(false, m, velocity);  // on its way out
        }
        let c = wide_inner(m, m) - wide_product(contact.radius, contact.radius);
        let root = sqrt(wide_product(b, b) - c);
        var distance = root - b;
        if (b > wide(0.0)) {
            distance = -c / (b + root);
        }
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
    if (!(inner(from_center, from_center) < real(contact.outer_radius_squared))) {
        return body;  // outside by rounded numbers, with a margin: nearly all points end here
    }
    let m = position_from(body, contact);
    if (!(wide_inner(m, m) < wide_product(contact.radius, contact.radius))) {
        return body;
    }
    atomicAdd(&results[1u + constants.members + member], 1u);
    let velocity = velocity_of(body);
    if (ray) {
        return moved_body(body, contact, ray_response(contact, m, velocity, as_printed, rough));
    }
    let turned = reflected(contact, velocity, outward_normal(m), as_printed, rough);
    return moved_body(body, contact, Response(false, m, turned));
}
