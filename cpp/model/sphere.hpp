// A sphere, its motion and how cloth responds to it.
#pragma once

#include <array>

#include "model/motion.hpp"

namespace clothsim {

enum class Response { reflect, ray, continuous };
inline constexpr std::array<const char*, 3> response_names{"reflect", "ray", "continuous"};

struct Sphere {
    Vec3 center = Vec3::Zero();
    double radius = 0;          // m
    double contact_radius = 0;  // m, radius + offset, computed once
    double restitution = 1;
    double friction = 0;
    Response response = Response::ray;
    bool as_printed = false;  // Kim et al. word for word: absolute velocity, approaching or not
    bool cells = false;    // continuous: each point stands off by what its cells need as they are
    double push_out_speed = 1;  // m/s, of points that the sphere starts on
    Motion motion;
    Vec3 origin = Vec3::Zero();  // of the positions that the centre is compared with [m]

    // No point keeps a larger distance from the centre; of cells the root of 2 times the radius, and a
    // little.
    double reach() const { return cells ? 1.4143 * contact_radius : contact_radius; }
    Vec3 center_at(double t) const { return motion.place(center, motion.at(t)) - origin; }
    Vec3 velocity_at(double t) const { return motion.at(t).velocity; }
};

}  // namespace clothsim
