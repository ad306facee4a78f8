// A sphere, its motion and how cloth responds to it.
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
    std::vector<double> times{};     // keyframes [s]
    std::vector<Vec3> centers{};     // keyframes [m]
    bool relative = false;           // keyframes: `centers` are displacements from the start

    // Whether a place depends on where the motion starts.
    bool has_start() const { return kind != Kind::keyframes || relative; }
    // Place at a time less the start [m]; the place itself where the start does not count.
    Vec3 displacement_at(double t) const;
    Vec3 place_at(const Vec3& start, double t) const {
        return has_start() ? Vec3(start + displacement_at(t)) : displacement_at(t);
    }
    // The velocity may jump at a time of a table or at a turning point. There it is the velocity of the piece
    // in which `inside` lies.
    Vec3 velocity_at(double t, double inside) const;
    Vec3 velocity_at(double t) const { return velocity_at(t, t); }
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
    bool cells = false;    // continuous: each point stands off by what its cells need as they are
    double push_out_speed = 1;  // m/s, of points that the sphere starts on
    Motion motion;
    Vec3 origin = Vec3::Zero();  // of the positions that the centre is compared with [m]

    // No point keeps a larger distance from the centre; of cells the root of 2 times the radius, and a
    // little.
    double reach() const { return cells ? 1.4143 * contact_radius : contact_radius; }
    Vec3 center_at(double t) const;
    Vec3 velocity_at(double t) const;
};

}  // namespace clothsim
