// A sphere, its motion and how cloth responds to it.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "model/motion.hpp"

namespace clothsim {

// "penalty" is a force (forces/penalty.hpp); the paper's two act after a step
// (responses/paper.hpp).
enum class Response { reflect, ray, penalty };
inline constexpr std::array<const char*, 3> response_names{"reflect", "ray", "penalty"};

// Returns the offset of Kim et al., eq 13: O = sqrt((D/2)^2 + R^2) - R. Both ends of a spring of
// length D lie at distance R + O from the centre. Then the spring's midpoint just touches the
// sphere of radius R. The printed form cancels; this one does not.
inline double edge_offset(double radius, double rest_length) {
    const double half = rest_length / 2;
    return half * (half / (std::hypot(half, radius) + radius));
}

// A surface of one curvature, from a place on which points are measured. At d from there, with the
// normal n and the curvature k,
//     level  f = 2 n.d + k d.d,   gradient  n + k d,  half of that of the level
//     height = f / (1 + sqrt(1 + k f)),   f = height (2 + k height)
// No large numbers cancel, and a plane is the case k = 0. gpu/shaders/contact.wgsl has the same.
struct Surface {
    Vec3 place;        // m
    Vec3 normal;       // outward, of length 1
    double curvature;  // 1/m

    Vec3 gradient(const Vec3& d) const { return normal + curvature * d; }
    double level(const Vec3& d) const { return d.dot(normal + gradient(d)); }
    double level_at(double height) const { return height * (2 + curvature * height); }
    double height(double level) const {
        return level / (1 + std::sqrt(std::max(1 + curvature * level, 0.0)));
    }
};

// A sphere, or a plane: a sphere of no curvature.
struct Sphere {
    Vec3 center = Vec3::Zero();  // m; of a plane, a place on it
    double radius = 0;           // m; infinite: a plane
    double offset = 0;           // m, from the surface to where points are in contact
    double restitution = 1;
    double friction = 0;
    Response response = Response::ray;
    double thickness = 0;     // penalty: h, of the layer [m]
    double stiffness = 0;     // penalty: k [N/m]
    double dissipation = 0;   // penalty: c [s/m]
    double slip_speed = 0;    // penalty: v_s [m/s]
    double speed = 0;         // m/s, the largest of the motion
    bool as_printed = false;  // Kim et al. word for word: absolute velocity, approaching or not
    Motion motion;
    Vec3 normal = Vec3::UnitY();  // at the place of the surface from which points are measured

    bool penalty() const { return response == Response::penalty; }
    bool flat() const { return std::isinf(radius); }
    double contact_radius() const { return radius + offset; }
    // Distance from the true surface to the edge of the layer [m].
    double reach() const { return offset + thickness; }
    Vec3 center_at(double t) const { return center_at(StageTime::at_rest(t)); }
    Vec3 center_at(const StageTime& time) const {
        return motion.place(center, motion.at(time.t, time.inside));
    }
    Vec3 velocity_at(double t) const { return motion.at(t).velocity; }
    // Where a velocity jumps, the piece of the motion that lies in the step counts.
    Vec3 velocity_at(const StageTime& time) const {
        return motion.at(time.t, time.inside).velocity;
    }
    // Relative to an origin [m].
    Surface surface_at(double t, const Vec3& origin = Vec3::Zero()) const {
        return surface_at(StageTime::at_rest(t), origin);
    }
    Surface surface_at(const StageTime& time, const Vec3& origin = Vec3::Zero()) const {
        const Vec3 middle = center_at(time) - origin;
        return {flat() ? middle : Vec3(middle + radius * normal), normal, 1 / radius};
    }
};

}  // namespace clothsim
