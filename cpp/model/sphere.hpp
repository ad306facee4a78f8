// A sphere, its motion and how cloth responds to it.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "model/motion.hpp"

namespace clothsim {

// "penalty" is a force (forces/penalty.hpp); the paper's two act after a step (responses/paper.hpp).
enum class Response { reflect, ray, penalty };
inline constexpr std::array<const char*, 3> response_names{"reflect", "ray", "penalty"};

// Of Kim et al., eq 13: O = sqrt((D/2)^2 + R^2) - R. Both ends of a spring of length D lie at
// distance R + O from the centre. Then the spring's midpoint just touches the sphere of radius R.
// Written without the cancellation of the printed form.
inline double edge_offset(double radius, double rest_length) {
    const double half = rest_length / 2;
    return half * (half / (std::hypot(half, radius) + radius));
}

// A sphere, or a plane: a sphere of no curvature.
struct Sphere {
    Vec3 center = Vec3::Zero();  // of a plane, a place on it
    double radius = 0;  // m; infinite: a plane
    double offset = 0;  // m, from the surface to where points are in contact, computed once
    double restitution = 1;
    double friction = 0;
    Response response = Response::ray;
    double thickness = 0;    // penalty: h, of the layer [m]
    double stiffness = 0;    // penalty: k [N/m]
    double dissipation = 0;  // penalty: c [s/m]
    double slip_speed = 0;   // penalty: v_s [m/s]
    double speed = 0;        // the largest of the motion [m/s]
    bool as_printed = false;  // Kim et al. word for word: absolute velocity, approaching or not
    Motion motion;
    // Unit normal at the place of the surface from which points are measured: the top of a sphere.
    Vec3 normal = Vec3::UnitY();
    Vec3 origin = Vec3::Zero();  // of the positions that the centre is compared with [m]

    bool penalty() const { return response == Response::penalty; }
    bool flat() const { return std::isinf(radius); }
    double curvature() const { return 1 / radius; }
    double contact_radius() const { return radius + offset; }
    Vec3 center_at(double t) const { return motion.place(center, motion.at(t)) - origin; }
    Vec3 velocity_at(double t) const { return motion.at(t).velocity; }
    // The place from which points are measured.
    Vec3 place_at(double t) const {
        return flat() ? center_at(t) : Vec3(center_at(t) + radius * normal);
    }
    // Where a velocity jumps, by the piece of the motion that counts in a step.
    Vec3 surface_at(const StageTime& time) const {
        const Vec3 middle = motion.place(center, motion.at(time.t, time.inside)) - origin;
        return flat() ? middle : Vec3(middle + radius * normal);
    }
    Vec3 velocity_at(const StageTime& time) const {
        return motion.at(time.t, time.inside).velocity;
    }
    // The level f of a point that is d from there, and heights over the surface by level. With the
    // normal n and the curvature k there
    //     f(d) = 2 n.d + k d.d,  height = f / (1 + sqrt(1 + k f)),  f = height (2 + k height)
    // No large numbers cancel.
    double level(const Vec3& d) const { return d.dot(normal + (normal + curvature() * d)); }
    double height(double level) const {
        return level / (1 + std::sqrt(std::max(1 + curvature() * level, 0.0)));
    }
    double height(const Vec3& d) const { return height(level(d)); }
    double level(double height) const { return height * (2 + curvature() * height); }
};

}  // namespace clothsim
