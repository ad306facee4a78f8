#include "reference/contact.hpp"

#include <algorithm>
#include <cmath>
#include <Eigen/Geometry>

namespace clothsim::reference {
namespace {

Vec3 direction(const Vec3& p) {
    const double length = p.norm();
    if (length == 0) return Vec3::UnitY();
    return p / length;
}

// "reflect" and "ray" on a plane: the same with a straight way back.
State respond_to_plane(const Sphere& plane, double t, double dt, const State& point) {
    const Vec3& n = plane.normal;
    const double depth = (plane.center_at(t) - point.x).dot(n);
    const Vec3 relative = point.v - plane.velocity_at(t);
    const double approach = relative.dot(n);
    if (depth <= 0 || (approach >= 0 && (plane.response == Response::reflect || approach > 0))) return point;
    State after = point;
    double since = 0;
    if (plane.response == Response::ray) {
        if (approach < 0) since = std::min(depth / -approach, dt);
        after.x += approach < 0 ? Vec3(depth / approach * relative) : Vec3(depth * n);
    }
    after.v -= (1 + plane.restitution) * approach * n;
    const Vec3 tangential = relative - approach * n;
    const double slip = tangential.norm(), most = -plane.friction * (1 + plane.restitution) * approach;
    if (plane.friction > 0 && slip > 0) after.v -= std::min(1.0, most / slip) * tangential;
    if (plane.restitution < 1 || plane.friction > 0) after.x += since * (after.v - plane.velocity_at(t));
    return after;
}

// |v|, also where v.v would overflow or vanish.
double speed_of(const Vec3& v) { return std::hypot(v[0], v[1], v[2]); }

}  // namespace

State respond(const Sphere& sphere, double t, double dt, const State& point) {
    if (sphere.flat()) return respond_to_plane(sphere, t, dt, point);
    const Vec3 center = sphere.center_at(t), m = point.x - center;
    if (m.squaredNorm() >= sphere.contact_radius() * sphere.contact_radius()) return point;
    const Vec3 moved = sphere.as_printed ? Vec3(Vec3::Zero()) : sphere.velocity_at(t),
               relative = point.v - moved;
    State after = point;
    Vec3 n = direction(m);
    double since = 0;  // the surface was passed [s]
    if (sphere.response == Response::ray) {
        // Eq 8-12: back along the velocity, x - s v/|v|, to where |x - center| is the radius.
        if (const double speed = speed_of(relative); speed > 0) {
            const Vec3 back = -relative / speed;
            const double b = m.dot(back),
                         c = m.squaredNorm() - sphere.contact_radius() * sphere.contact_radius();
            if (b < 0 && !sphere.as_printed) return point;  // leaves by itself
            const double s = -b + std::sqrt(b * b - c);
            n = direction(m + s * back);
            since = std::min(s / speed, dt);
        }
        after.x = center + sphere.contact_radius() * n;
    }
    // Eq 7 with restitution, and Coulomb's friction.
    const double approach = relative.dot(n);
    if (approach >= 0 && !sphere.as_printed) return after;
    after.v -= (1 + sphere.restitution) * approach * n;
    const Vec3 tangential = relative - approach * n;
    const double slip = tangential.norm(),
                 most = sphere.friction * std::abs((1 + sphere.restitution) * approach);
    if (sphere.friction > 0 && slip > 0) after.v -= std::min(1.0, most / slip) * tangential;
    // A point that does not bounce for good travels the rest of the step.
    if (!sphere.as_printed && (sphere.restitution < 1 || sphere.friction > 0))
        after.x += since * (after.v - moved);
    return after;
}

}  // namespace clothsim::reference
