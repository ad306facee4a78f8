// A sphere, its motion and how cloth answers to it.
#pragma once

#include <array>
#include <Eigen/Core>
#include <vector>

namespace clothsim {

using Vec3 = Eigen::Vector3d;

struct Motion {
    enum class Kind { none, linear, reciprocate, keyframes };
    Kind kind = Kind::none;
    Vec3 velocity = Vec3::Zero();    // linear [m/s]
    Vec3 direction = Vec3::Zero();   // reciprocate, unit vector
    double distance = 0;             // reciprocate, between the turning points [m]
    double period = 1;               // reciprocate, there and back [s]
    double deceleration = 0;         // reciprocate, dimensionless
    double phase = 0;                // reciprocate, fraction of a period
    std::vector<double> times;       // keyframes [s]
    std::vector<Vec3> centers;       // keyframes [m]
};

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
    bool faces = false;    // continuous: whole triangles are kept out, not only mass points
    double push_out_speed = 1;  // m/s, of points that the sphere starts on
    Motion motion;
    Vec3 origin = Vec3::Zero();  // of the positions that the centre is compared with [m]

    Vec3 center_at(double t) const;
    Vec3 velocity_at(double t) const;
};

}  // namespace clothsim
