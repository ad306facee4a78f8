// The responses of Kim et al., section 5, after a step (cpp/responses/paper.hpp is the same on the
// CPU). The host writes `respond_all`, which goes through the obstacles in their order.
struct Body {
    position: vec3<real>, position_low: vec3<real>,
    velocity: vec3<real>, velocity_low: vec3<real>,
}

// A place with its rounding error, which is 0 where `wide` has float64.
struct Spot { whole: vec3<wide>, low: vec3<wide> }

// A sphere or plane after the step: the place from which points are measured, the normal there and
// the curvature, the level below which points are in contact, and NearLevel of the core.
struct Contact {
    place: Spot, velocity: vec3<wide>, normal: vec3<wide>,
    curvature: wide, top: wide, restitution: wide, friction: wide,
    near_level: wide, near_curvature: wide,
}

fn contact_vector(at: u32) -> vec3<wide> {
    return vec3<wide>(contacts[at], contacts[at + 1u], contacts[at + 2u]);
}

fn contact_at(member: u32, obstacle: u32, steps_ago: u32) -> u32 {
    let step = select(0u, steps_done() - steps_ago, moving);
    return member * constants.contact_member_stride + obstacle * contact_size
        + step * constants.contact_step_stride;
}

fn contact_of(member: u32, obstacle: u32) -> Contact {
    let at = contact_at(member, obstacle, 0u);
    let c = at + 12u;
    return Contact(
        Spot(contact_vector(at), contact_vector(at + 3u)),
        contact_vector(at + 6u), contact_vector(at + 9u),
        contacts[c], contacts[c + 1u], contacts[c + 2u], contacts[c + 3u],
        contacts[c + 4u], contacts[c + 5u]);
}

// Whether a point may be in contact, in the arithmetic of a step: no point in contact is missed.
fn is_near(s: Contact, position: vec3<real>) -> bool {
    let d = position - vec3<real>(s.place.whole);
    let n = vec3<real>(s.normal);
    return inner(d, n + n + scaled(real(s.near_curvature), d)) < real(s.near_level);
}

// Levels and heights of model/sphere.hpp, at d from the place.
fn gradient(s: Contact, d: vec3<wide>) -> vec3<wide> {
    return s.normal + wide_scaled(s.curvature, d);
}
fn level(s: Contact, d: vec3<wide>) -> wide { return wide_inner(d, s.normal + gradient(s, d)); }
fn height(s: Contact, level: wide) -> wide {
    let square = max(wide(1.0) + wide_product(s.curvature, level), wide(0.0));
    return level / (wide(1.0) + sqrt(square));
}

// |a|, whose square may vanish or overflow.
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

// Velocity on which a response acts: relative to the obstacle, or absolute as printed.
fn relative(s: Contact, velocity: vec3<wide>, as_printed: bool) -> vec3<wide> {
    return select(velocity - s.velocity, velocity, as_printed);
}

// Eq 7, scaled by restitution, with Coulomb friction where the obstacle is `rough`.
fn reflected(s: Contact, velocity: vec3<wide>, normal: vec3<wide>, as_printed: bool,
             rough: bool) -> vec3<wide> {
    let approach = relative(s, velocity, as_printed);
    let normal_speed = wide_inner(approach, normal);
    if (normal_speed >= wide(0.0) && !as_printed) { return velocity; }
    let impulse = wide_product(wide(1.0) + s.restitution, normal_speed);
    let result = velocity - wide_scaled(impulse, normal);
    if (!rough) { return result; }
    let tangential = approach - wide_scaled(normal_speed, normal);
    let speed = sqrt(wide_inner(tangential, tangential));
    let most = wide_product(s.friction, abs(impulse));
    if (speed <= most) { return result - tangential; }
    return result - wide_scaled(most / speed, tangential);
}

// Method 1: reflects the velocity, and leaves the position alone.
fn respond_reflect(body: Body, s: Contact, as_printed: bool, rough: bool) -> Body {
    let at = spot_of(body);
    let normal = outward_normal(s, spot_from(at, s.place));
    return body_at(body, at, reflected(s, velocity_of(body), normal, as_printed, rough));
}

// Method 2 (eq 8-12): back along the ray to the surface, but by no more than the way of the step,
// and reflected there. With a restitution below 1 or friction the point goes on for the rest of
// the step.
fn respond_ray(body: Body, s: Contact, as_printed: bool, rough: bool) -> Body {
    let none = wide(0.0);
    let dt = wide(constants.half_h + constants.half_h);
    let at = spot_of(body);
    let velocity = velocity_of(body);
    var d = spot_from(at, s.place);
    let m = gradient(s, d);
    let v = relative(s, velocity, as_printed);
    let speed = length_of(v);
    let lacks = s.top - level(s, d);
    let back = select(vec3<wide>(), -v / speed, speed > none);
    let b = wide_inner(m, back);
    if (b < none && !as_printed) { return body_at(body, at, velocity); }  // on its way out
    let root = sqrt(wide_product(b, b) + wide_product(s.curvature, lacks));
    let w = wide_inner(m, m);
    var rest = none;  // time since the point was at the surface [s]
    if (speed > none && root > none) {
        var way = select((root - b) / s.curvature, lacks / (b + root), b > none);
        if (!as_printed) { way = min(way, wide_product(speed, dt)); }
        d = d + wide_scaled(way, back);
        rest = min(way / speed, dt);
    } else if (w > none) {  // a point without a ray goes along the normal
        let square = wide_product(w, wide(1.0) + wide_product(s.curvature, s.top));
        d = d + wide_scaled(lacks / (w + sqrt(square)), m);
    } else {
        d = wide_scaled(height(s, s.top), s.normal);
    }
    let after = reflected(s, velocity, outward_normal(s, d), as_printed, rough);
    if (!as_printed && (s.restitution < wide(1.0) || s.friction > none)) {
        d = d + wide_scaled(rest, relative(s, after, as_printed));
    }
    return body_at(body, beyond(s.place, d), after);
}

// The body after the response to one obstacle: method 2 if `ray`, else method 1.
fn respond(body: Body, s: Contact, member: u32, ray: bool, as_printed: bool, rough: bool) -> Body {
    if (!is_near(s, body.position)) { return body; }  // nearly all points end here
    if (!(level(s, spot_from(spot_of(body), s.place)) < s.top)) { return body; }
    count_response(member);
    if (ray) { return respond_ray(body, s, as_printed, rough); }
    return respond_reflect(body, s, as_printed, rough);
}
