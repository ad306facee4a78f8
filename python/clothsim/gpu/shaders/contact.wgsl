// The collision pass of section 5 of Kim et al. (cpp/contact is the same on the CPU). The host writes `after_contacts`,
// which goes through the scene's spheres in their order.
struct Body { position: vec3<real>, position_low: vec3<real>, velocity: vec3<real>, velocity_low: vec3<real> }

// A place with its rounding error, which is 0 where `wide` has float64.
struct Spot { whole: vec3<wide>, low: vec3<wide> }
fn same(a: Spot, b: Spot) -> bool { return all(a.whole == b.whole) && all(a.low == b.low); }

// A sphere or plane at the moment of the pass (cpp/contact/continuous.hpp): a place on it, the normal there and its
// curvature, levels that start from there, and the check in `real`, which finds a point too many, but none too few.
struct Contact {
    place: Spot, velocity: vec3<wide>, normal: vec3<wide>,
    curvature: wide, least: wide, innermost: wide, band: wide, tolerance: wide, most_of_cells: wide,
    restitution: wide, friction: wide, push: wide, dt: wide, near_level: wide, near_curvature: wide, of_cells: wide,
    excess: wide,
}

// From the place.
struct Response { moved: bool, d: vec3<wide>, velocity: vec3<wide> }

fn contact_vector(at: u32) -> vec3<wide> { return vec3<wide>(contacts[at], contacts[at + 1u], contacts[at + 2u]); }

fn contact_at(member: u32, sphere: u32, steps_ago: u32) -> u32 {
    let step = select(0u, steps_done() - steps_ago, moving);
    return member * constants.contact_member_stride + sphere * contact_size + step * constants.contact_step_stride;
}

fn contact_of(member: u32, sphere: u32, steps_ago: u32) -> Contact {
    let at = contact_at(member, sphere, steps_ago);
    let c = at + 12u;
    return Contact(
        Spot(contact_vector(at), contact_vector(at + 3u)), contact_vector(at + 6u), contact_vector(at + 9u),
        contacts[c], contacts[c + 1u], contacts[c + 2u], contacts[c + 3u], contacts[c + 4u], contacts[c + 5u],
        contacts[c + 6u], contacts[c + 7u], contacts[c + 8u], contacts[c + 9u], contacts[c + 10u], contacts[c + 11u],
        contacts[c + 12u], contacts[c + 13u]);
}

fn gradient(s: Contact, d: vec3<wide>) -> vec3<wide> { return s.normal + wide_scaled(s.curvature, d); }
fn level(s: Contact, d: vec3<wide>) -> wide { return wide_inner(d, s.normal + gradient(s, d)); }
fn height_of(s: Contact, level: wide) -> wide {
    return level / (wide(1.0) + sqrt(max(wide(1.0) + wide_product(s.curvature, level), wide(0.0))));
}

fn level_of(s: Contact, height: wide) -> wide { return wide_product(height, wide(2.0) + wide_product(s.curvature, height)); }

// Whether a point may respond: `gone` is its way in the sphere's frame.
fn is_near(s: Contact, position: vec3<real>, gone: vec3<real>) -> bool {
    let d = position - vec3<real>(s.place.whole);
    let n = vec3<real>(s.normal);
    let f = inner(d, n + n + scaled(real(s.near_curvature), d));
    let more = real(s.most_of_cells) + product(real(2.0) * real(s.curvature), inner(gone, gone));
    return f < real(s.near_level) + more;
}

fn length_of(a: vec3<wide>) -> wide {
    let largest = max(abs(a.x), max(abs(a.y), abs(a.z)));
    if (!(largest > wide(0.0))) { return wide(0.0); }
    let b = a / largest;
    return wide_product(largest, sqrt(wide_inner(b, b)));
}

// A point at the exact centre leaves along the normal of the place.
fn outward_normal(s: Contact, d: vec3<wide>) -> vec3<wide> {
    let m = gradient(s, d);
    let length = sqrt(wide_inner(m, m));
    if (length > wide(0.0)) { return m / length; }
    return s.normal;
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
// point goes on for the rest of the step (cpp/contact/response.hpp).
fn ray_response(s: Contact, start: vec3<wide>, velocity: vec3<wide>, as_printed: bool, rough: bool) -> Response {
    let v = relative(s, velocity, as_printed);
    let speed = length_of(v);
    let m = gradient(s, start);
    let lacks = s.least - level(s, start);
    let back = select(vec3<wide>(), -v / speed, speed > wide(0.0));
    let b = wide_inner(m, back);
    if (b < wide(0.0) && !as_printed) { return Response(false, start, velocity); }  // on its way out
    let root = sqrt(wide_product(b, b) + wide_product(s.curvature, lacks));
    let w = wide_inner(m, m);
    var d = wide_scaled(height_of(s, s.least), s.normal);
    var rest = wide(0.0);
    if (speed > wide(0.0) && root > wide(0.0)) {
        let way = select((root - b) / s.curvature, lacks / (b + root), b > wide(0.0));
        d = start + wide_scaled(way, back);
        rest = min(way / speed, wide(constants.half_h + constants.half_h));
    } else if (w > wide(0.0)) {
        let sum = w + sqrt(wide_product(w, wide(1.0) + wide_product(s.curvature, s.least)));
        d = start + wide_scaled(lacks / sum, m);
    }
    let turned = reflected(s, velocity, outward_normal(s, d), as_printed, rough);
    if (!as_printed && (s.restitution < wide(1.0) || s.friction > wide(0.0))) {
        d = d + wide_scaled(rest, relative(s, turned, as_printed));
    }
    return Response(true, d, turned);
}

// The body after the response to one sphere. `ray`: method 2, else method 1, which leaves the position alone.
fn respond(body: Body, s: Contact, member: u32, ray: bool, as_printed: bool, rough: bool) -> Body {
    if (!is_near(s, body.position, vec3<real>())) { return body; }  // nearly all points end here
    let at = spot_of(body);
    let d = spot_from(at, s.place);
    if (!(level(s, d) < s.least)) { return body; }
    atomicAdd(&results[1u + 6u * constants.members + member], 1u);
    let velocity = velocity_of(body);
    if (!ray) { return body_at(body, at, reflected(s, velocity, outward_normal(s, d), as_printed, rough)); }
    let r = ray_response(s, d, velocity, as_printed, rough);
    if (!r.moved) { return body_at(body, at, r.velocity); }
    return body_at(body, beyond(s.place, r.d), r.velocity);
}
