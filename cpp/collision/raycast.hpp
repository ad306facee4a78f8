// Kim et al., method 2: cast a ray from the point back along its velocity, move the point to where the
// ray meets the sphere, reflect the velocity there.
//
// With d = -v, m = p - center, A = d.d, B = m.d, C = m.m - R^2 (eq 9 with its errata mended) the point
// lies inside, C < 0, so exactly one root is positive:
//
//   t = (-B + sqrt(B^2 - A C)) / A   =   -C / (B + sqrt(B^2 - A C))
//
// The form without cancellation is taken by the sign of B, which is what eq 11 and 12 are for.
#pragma once

#include <cmath>

#include "collision/contact.hpp"

namespace clothsim {

inline double ray_time(double a, double b, double c) {
    const double root = std::sqrt(b * b - a * c);
    return b > 0 ? -c / (b + root) : (root - b) / a;
}

inline PointState respond_ray(const Contact& contact, const PointState& point) {
    const double radius = contact.sphere.contact_radius;
    const Vec3 m = point.position - contact.center;
    const Vec3 v = contact.relative(point.velocity);
    const double a = v.squaredNorm();
    const double b = -m.dot(v);
    if (b < 0 && !contact.sphere.literal) return point;  // on its way out

    // A point without a ray, at rest in the sphere's frame, is projected along the normal.
    Vec3 on_surface = radius * outward_normal(m);
    if (a > 0) {
        const double t = ray_time(a, b, m.squaredNorm() - radius * radius);
        if (std::isfinite(t)) on_surface = m - t * v;
    }
    return {contact.center + on_surface,
            reflected(contact, point.velocity, outward_normal(on_surface))};
}

}  // namespace clothsim
