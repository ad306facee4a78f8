// Common parts of both responses: the state of a mass point in a sphere's frame, and the velocity change.
#pragma once

#include <cmath>

#include "model/sphere.hpp"

namespace clothsim {

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

}  // namespace clothsim
