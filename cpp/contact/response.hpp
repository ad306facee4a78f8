// Detection and the responses of Kim et al., section 5: the state of a mass point inside a sphere at the end
// of a step, and what becomes of it.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "model/sphere.hpp"

namespace clothsim {

// The kernels' test of the end of a step takes a squared radius that is larger by this many epsilon, as its
// sum of squares may be rounded by three. With half of it the test would still be safe, with twice as much it
// would find a few more points that touch nothing.
inline constexpr double outer_epsilons = 8;

struct PointState {
    Vec3 position;
    Vec3 velocity;
};

// The sphere at the moment of the collision pass.
struct Contact {
    const Sphere& sphere;
    Vec3 center;
    Vec3 velocity;
    double time;  // [s]
    double dt;    // of the step that ends then [s]

    Contact(const Sphere& s, double t, double step)
        : sphere(s), center(s.center_at(t)), velocity(s.velocity_at(t)), time(t), dt(step) {}

    // Velocity on which the response acts: relative to the sphere, or absolute in the as_printed reading.
    Vec3 relative(const Vec3& v) const { return sphere.as_printed ? v : Vec3(v - velocity); }
};

// Unit normal at p; a point at the exact centre leaves upwards.
inline Vec3 outward_normal(const Vec3& offset_from_center) {
    const double distance = offset_from_center.norm();
    return distance > 0 ? Vec3(offset_from_center / distance) : Vec3(0, 1, 0);
}

// Reflection about the tangent plane (eq 7), scaled by restitution, with Coulomb friction: the tangential
// impulse is at most friction times the normal impulse. As printed: reflected in any case.
inline Vec3 reflected(const Contact& contact, const Vec3& velocity, const Vec3& normal) {
    const double normal_speed = contact.relative(velocity).dot(normal);
    if (normal_speed >= 0 && !contact.sphere.as_printed) return velocity;
    const double impulse = (1 + contact.sphere.restitution) * normal_speed;
    Vec3 result = velocity - impulse * normal;
    if (contact.sphere.friction > 0) {
        const Vec3 tangential = contact.relative(velocity) - normal_speed * normal;
        const double speed = tangential.norm();
        const double most = contact.sphere.friction * std::abs(impulse);
        result -= speed <= most ? tangential : Vec3(most / speed * tangential);
    }
    return result;
}

// Method 1: reflect the velocity, leave the position alone.
inline PointState respond_reflect(const Contact& contact, const PointState& point) {
    const Vec3 normal = outward_normal(point.position - contact.center);
    return {point.position, reflected(contact, point.velocity, normal)};
}

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

// Method 2: cast a ray from the point back along its velocity. The point moves to the intersection of ray and
// sphere, and its velocity is reflected there.
//
// With d = -v/|v|, m = p - center, B = m.d, C = m.m - R^2 (eq 9 with its errata corrected). Division by v.v
// makes no speed too small. The point lies inside, C < 0, so exactly one distance along the ray is positive:
//
//   s = -B + sqrt(B^2 - C)   =   -C / (B + sqrt(B^2 - C))
//
// The form without cancellation is taken by the sign of B, which is what eq 11 and 12 are for.
//
// The paper leaves the point there. Each contact then loses the part s / |v| of the step. A point on the
// sphere, as with a restitution below 1, slides at (1 + e) / 2 of its speed at any time step. So with e < 1
// or friction the point goes on from the surface for that time, at its new velocity. A point that starts
// inside goes on for the step. With e = 1 and no friction, touches are rare and the loss is of the order of
// the time step. The paper's reading then stays.
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

inline bool touches(const Contact& contact, const Vec3& position) {
    const double radius = contact.sphere.contact_radius;
    return (position - contact.center).squaredNorm() < radius * radius;
}

inline PointState respond(const Contact& contact, const PointState& point) {
    return contact.sphere.response == Response::ray ? respond_ray(contact, point)
                                                    : respond_reflect(contact, point);
}

}  // namespace clothsim
