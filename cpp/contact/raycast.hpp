// Kim et al., method 2: cast a ray from the point back along its velocity. The point moves to the
// intersection of ray and sphere, and its velocity is reflected there.
//
// With d = -v/|v|, m = p - center, B = m.d, C = m.m - R^2 (eq 9 with its errata corrected). Division by v.v
// makes no speed too small. The point lies inside, C < 0, so exactly one distance along the ray is positive:
//
//   s = -B + sqrt(B^2 - C)   =   -C / (B + sqrt(B^2 - C))
//
// The form without cancellation is taken by the sign of B, which is what eq 11 and 12 are for.
//
// The paper leaves the point there. Each contact then loses the part s / |v| of the
// step. A point on the sphere, as with a restitution below 1, slides at (1 + e) / 2
// of its speed at any time step. So with e < 1 or friction the point goes on from
// the surface for that time, at its new velocity. A point that starts inside goes on
// for the step. With e = 1 and no friction,
// touches are rare and the loss is of the order of the time step. The paper's
// reading then stays.
#pragma once

#include <algorithm>
#include <cmath>

#include "contact/contact.hpp"

namespace clothsim {

inline double distance_to_surface(double b, double c) {
    const double root = std::sqrt(b * b - c);
    return b > 0 ? -c / (b + root) : root - b;
}

// |v| of velocities so small or so large that their squares would vanish or overflow. Written out, because
// the summation order of Eigen's stableNorm depends on where its operand lies in memory.
inline double length_of(const Vec3& v) {
    const double largest = v.cwiseAbs().maxCoeff();
    return largest > 0 ? largest * (v / largest).norm() : 0;
}

inline PointState respond_ray(const Contact& contact, const PointState& point) {
    const double radius = contact.sphere.contact_radius;
    const Vec3 m = point.position - contact.center;
    const Vec3 v = contact.relative(point.velocity);
    const double speed = length_of(v);

    // A point without a ray, at rest in the sphere's frame, is projected along the normal.
    Vec3 on_surface = radius * outward_normal(m);
    double rest = 0;  // time since the point was at the surface [s]
    if (speed > 0) {
        const Vec3 back = -v / speed;
        const double b = m.dot(back);
        if (b < 0 && !contact.sphere.as_printed) return point;  // on its way out
        const double way = distance_to_surface(b, m.squaredNorm() - radius * radius);
        on_surface = m + way * back;
        rest = std::min(way / speed, contact.dt);
    }
    const Vec3 velocity = reflected(contact, point.velocity, outward_normal(on_surface));
    const Sphere& sphere = contact.sphere;
    if (!sphere.as_printed && (sphere.restitution < 1 || sphere.friction > 0))
        on_surface += rest * contact.relative(velocity);
    return {contact.center + on_surface, velocity};
}

}  // namespace clothsim
