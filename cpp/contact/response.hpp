// Detection and the responses of Kim et al., section 5: the state of a mass point inside a sphere
// at the end of a step, and what becomes of it.
#pragma once

#include <algorithm>
#include <cmath>

#include "model/sphere.hpp"

namespace clothsim {

struct PointState {
    Vec3 position;
    Vec3 velocity;

    bool operator==(const PointState&) const = default;
};

// The sphere at the moment of the pass.
struct Contact {
    const Sphere& sphere;
    Vec3 place;  // from which points are measured (Sphere::place_at)
    Vec3 velocity;
    double top;  // level below which points are in contact
    double dt;  // of the step that ends then [s]

    Contact(const Sphere& s, double t, double step)
        : sphere(s),
          place(s.place_at(t)),
          velocity(s.velocity_at(t)),
          top(s.level(s.offset)),
          dt(step) {}

    // Velocity on which the response acts: relative to the sphere, or absolute in the as_printed
    // reading.
    Vec3 relative(const Vec3& v) const { return sphere.as_printed ? v : Vec3(v - velocity); }
    // Along the normal at d, of length 1 on the surface.
    Vec3 gradient(const Vec3& d) const { return sphere.normal + sphere.curvature() * d; }
};

// Unit normal at d; a point at the exact centre leaves along that of the place.
inline Vec3 outward_normal(const Contact& contact, const Vec3& d) {
    const Vec3 m = contact.gradient(d);
    const double length = m.norm();
    return length > 0 ? Vec3(m / length) : contact.sphere.normal;
}

// Reflection about the tangent plane (eq 7), scaled by restitution, with Coulomb friction: the
// tangential impulse is at most friction times the normal impulse. As printed: reflected in any
// case.
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
    const Vec3 normal = outward_normal(contact, point.position - contact.place);
    return {point.position, reflected(contact, point.velocity, normal)};
}

// |v| of velocities so small or so large that their squares would vanish or overflow. Written out,
// because the summation order of Eigen's stableNorm depends on where its operand lies in memory.
inline double length_of(const Vec3& v) {
    const double largest = v.cwiseAbs().maxCoeff();
    return largest > 0 ? largest * (v / largest).norm() : 0;
}

// Method 2: cast a ray from the point back along its velocity. The point moves to the intersection
// of ray and surface, and its velocity is reflected there.
//
// With b = -v/|v| the level (contact/continuous.hpp) along the ray is f + 2 s m.b + k s^2: eq 9
// with its errata corrected, over the radius. Division by v.v makes no speed too small. The point
// lies inside, C = f - top < 0, so exactly one distance along the ray is positive:
//
//   s = (-B + sqrt(B^2 - k C)) / k   =   -C / (B + sqrt(B^2 - k C)),   B = m.b
//
// The form without cancellation is taken by the sign of B, which is what eq 11 and 12 are for.
//
// The paper leaves the point there. Each contact then loses the part s / |v| of the step. A point
// on the sphere, as with a restitution below 1, slides at (1 + e) / 2 of its speed at any time
// step. So with e < 1 or friction the point goes on from the surface for that time, at its new
// velocity. A point that starts inside goes on for the step. With e = 1 and no friction, touches
// are rare and the loss is of the order of the time step. The paper's reading then stays.
inline PointState respond_ray(const Contact& contact, const PointState& point) {
    const Sphere& sphere = contact.sphere;
    const double k = sphere.curvature();
    Vec3 d = point.position - contact.place;
    const Vec3 m = contact.gradient(d), v = contact.relative(point.velocity);
    const double speed = length_of(v), lacks = contact.top - sphere.level(d);
    double rest = 0;  // time since the point was at the surface [s]
    const Vec3 back = speed > 0 ? Vec3(-v / speed) : Vec3(Vec3::Zero());
    const double b = m.dot(back), root = std::sqrt(b * b + k * lacks);
    if (b < 0 && !sphere.as_printed) return point;  // on its way out
    if (speed > 0 && root > 0) {
        const double way = b > 0 ? lacks / (b + root) : (root - b) / k;
        d += way * back;
        rest = std::min(way / speed, contact.dt);
    } else if (const double w = m.squaredNorm(); w > 0) {
        // A point without a ray, at rest or along a plane, is projected along the normal.
        d += lacks / (w + std::sqrt(w * (1 + k * contact.top))) * m;
    } else {
        d = sphere.height(contact.top) * sphere.normal;
    }
    const Vec3 velocity = reflected(contact, point.velocity, outward_normal(contact, d));
    if (!sphere.as_printed && (sphere.restitution < 1 || sphere.friction > 0))
        d += rest * contact.relative(velocity);
    return {contact.place + d, velocity};
}

inline bool touches(const Contact& contact, const Vec3& position) {
    return contact.sphere.level(position - contact.place) < contact.top;
}

inline PointState respond(const Contact& contact, const PointState& point) {
    return contact.sphere.response == Response::ray ? respond_ray(contact, point)
                                                    : respond_reflect(contact, point);
}

}  // namespace clothsim
