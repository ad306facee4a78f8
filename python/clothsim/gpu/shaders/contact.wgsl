// The responses of Kim et al., section 5, after a step (cpp/responses/paper.hpp is the same on the
// CPU). The host writes `respond_all`, which goes through the obstacles in their order.
struct PointState {
    position: vec3<real>, position_low: vec3<real>,
    velocity: vec3<real>, velocity_low: vec3<real>,
}

// A place with its rounding error, which is 0 where `wide` has float64.
struct Spot { whole: vec3<wide>, low: vec3<wide> }

// Surface of cpp/model/sphere.hpp: its level, gradient and height have the same names here.
struct Surface { place: Spot, normal: vec3<wide>, curvature: wide }

fn gradient(surface: Surface, d: vec3<wide>) -> vec3<wide> {
    return surface.normal + wide_multiple(surface.curvature, d);
}
fn level(surface: Surface, d: vec3<wide>) -> wide {
    return wide_inner(d, surface.normal + gradient(surface, d));
}
fn height(surface: Surface, level: wide) -> wide {
    let square = max(wide(1.0) + wide_product(surface.curvature, level), wide(0.0));
    return level / (wide(1.0) + sqrt(square));
}

// A sphere or plane at the end of the step, the level below which points are in contact, and
// NearLevel of the core.
struct Contact {
    surface: Surface, velocity: vec3<wide>, top: wide, restitution: wide, friction: wide,
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
    let place = Spot(contact_vector(at), contact_vector(at + 3u));
    return Contact(
        Surface(place, contact_vector(at + 9u), contacts[c]),
        contact_vector(at + 6u), contacts[c + 1u], contacts[c + 2u], contacts[c + 3u],
        contacts[c + 4u], contacts[c + 5u]);
}

// Whether a point may be in contact, in the arithmetic of a step: no point in contact is missed.
fn is_near(contact: Contact, position: vec3<real>) -> bool {
    let d = position - vec3<real>(contact.surface.place.whole);
    let n = vec3<real>(contact.surface.normal);
    return inner(d, n + n + multiple(real(contact.near_curvature), d)) < real(contact.near_level);
}

// |a|, whose square may vanish or overflow.
fn length_of(a: vec3<wide>) -> wide {
    let largest = max(abs(a.x), max(abs(a.y), abs(a.z)));
    if (!(largest > wide(0.0))) { return wide(0.0); }
    let b = a / largest;
    return wide_product(largest, sqrt(wide_inner(b, b)));
}

// A point at the exact centre leaves along the normal of the place.
fn outward_normal(surface: Surface, d: vec3<wide>) -> vec3<wide> {
    let m = gradient(surface, d);
    let length = sqrt(wide_inner(m, m));
    if (length > wide(0.0)) { return m / length; }
    return surface.normal;
}

// Velocity on which a response acts: relative to the obstacle, or absolute as printed.
fn relative(contact: Contact, velocity: vec3<wide>, as_printed: bool) -> vec3<wide> {
    return select(velocity - contact.velocity, velocity, as_printed);
}

// Eq 7, scaled by restitution, with Coulomb friction where the obstacle is `rough`.
fn reflection(contact: Contact, velocity: vec3<wide>, normal: vec3<wide>, as_printed: bool,
              rough: bool) -> vec3<wide> {
    let approach = relative(contact, velocity, as_printed);
    let normal_speed = wide_inner(approach, normal);
    if (normal_speed >= wide(0.0) && !as_printed) { return velocity; }
    let impulse = wide_product(wide(1.0) + contact.restitution, normal_speed);
    let result = velocity - wide_multiple(impulse, normal);
    if (!rough) { return result; }
    let tangential = approach - wide_multiple(normal_speed, normal);
    let speed = sqrt(wide_inner(tangential, tangential));
    let most = wide_product(contact.friction, abs(impulse));
    if (speed <= most) { return result - tangential; }
    return result - wide_multiple(most / speed, tangential);
}

// Method 1 reflects the velocity, and leaves the position alone.
fn respond_reflect(point: PointState, contact: Contact, as_printed: bool,
                   rough: bool) -> PointState {
    let at = spot_of(point);
    let normal = outward_normal(contact.surface, spot_difference(at, contact.surface.place));
    let velocity = reflection(contact, velocity_of(point), normal, as_printed, rough);
    return state_at_spot(point, at, velocity);
}

// Method 2 (eq 8-12) moves a point back along the ray to the surface, but by no more than the way
// of the step, and reflects it there. With a restitution below 1 or friction the point goes on for
// the rest of the step.
fn respond_ray(point: PointState, contact: Contact, as_printed: bool, rough: bool) -> PointState {
    let surface = contact.surface;
    let none = wide(0.0);
    let dt = wide(constants.half_h + constants.half_h);
    let at = spot_of(point);
    let velocity = velocity_of(point);
    var d = spot_difference(at, surface.place);
    let m = gradient(surface, d);
    let v = relative(contact, velocity, as_printed);
    let speed = length_of(v);
    let deficit = contact.top - level(surface, d);
    let direction = select(vec3<wide>(), -v / speed, speed > none);
    let b = wide_inner(m, direction);
    if (b < none && !as_printed) { return state_at_spot(point, at, velocity); }  // on its way out
    let root = sqrt(wide_product(b, b) + wide_product(surface.curvature, deficit));
    let w = wide_inner(m, m);
    var rest = none;  // time since the point was at the surface [s]
    if (speed > none && root > none) {
        var way = select((root - b) / surface.curvature, deficit / (b + root), b > none);
        if (!as_printed) { way = min(way, wide_product(speed, dt)); }
        d = d + wide_multiple(way, direction);
        rest = min(way / speed, dt);
    } else if (w > none) {  // a point without a ray goes along the normal
        let square = wide_product(w, wide(1.0) + wide_product(surface.curvature, contact.top));
        d = d + wide_multiple(deficit / (w + sqrt(square)), m);
    } else {
        d = wide_multiple(height(surface, contact.top), surface.normal);
    }
    let normal = outward_normal(surface, d);
    let rebound = reflection(contact, velocity, normal, as_printed, rough);
    if (!as_printed && (contact.restitution < wide(1.0) || contact.friction > none)) {
        d = d + wide_multiple(rest, relative(contact, rebound, as_printed));
    }
    return state_at_spot(point, spot_sum(surface.place, d), rebound);
}

// The point after the response to an obstacle: method 2 if `ray`, else method 1.
fn respond(point: PointState, contact: Contact, member: u32, ray: bool, as_printed: bool,
           rough: bool) -> PointState {
    if (!is_near(contact, point.position)) { return point; }  // nearly all points end here
    let d = spot_difference(spot_of(point), contact.surface.place);
    if (!(level(contact.surface, d) < contact.top)) { return point; }
    count_response(member);
    if (ray) { return respond_ray(point, contact, as_printed, rough); }
    return respond_reflect(point, contact, as_printed, rough);
}
