// Contact as a force: the law of response "penalty", for one mass point and one obstacle.
//
//          |
//          |      o x     e = x - p0          a surface point p0, the outward normal N there
//          |     /                            and the curvature kappa = 1/R; planes have 0
//     gap  |    / e
//          |   /          f = 2 N.e + kappa e.e,  gap = f / (1 + sqrt(1 + kappa f)) - offset
//     -----+--p0-----     normal n = (N + kappa e) / sqrt(1 + kappa f)
//
// In the layer of thickness h over the surface, at the depth d = h - gap > 0, with the velocity u
// of the point relative to the obstacle:
//
//     push      F = k d^3 / h^2 (1 - w / sqrt(1 + w^2)),  w = c u.n       on the point: + F n
//     friction  - mu F s / sqrt(s.s + v_s^2),             s = u - (u.n) n
//     energy    k d^4 / (4 h^2)
//
// The push is twice differentiable at the edge of the layer, so that a method of order 4 keeps its
// order. Damping in proportion to the push goes back to Hunt and Crossley (Coefficient of
// restitution interpreted as damping in vibroimpact, J. Appl. Mech. 42 (1975) 440); the form is
// bounded here, so that contact never pulls. No large numbers cancel in the gap.
#pragma once

#include <algorithm>
#include <cmath>

#include "forces/penalty_arguments.hpp"
#include "model/sphere.hpp"

namespace clothsim {

// Returns the normal of a sphere at the surface point nearest to a place relative to an origin, or
// that which it has in its centre.
inline Vec3 normal_towards(const Sphere& sphere, const Vec3& place, double t, const Vec3& origin) {
    const Vec3 center = sphere.center_at(t) - origin;
    const Vec3 away = place - center;
    const double distance = away.norm();
    const bool has_direction = !sphere.flat() && std::isfinite(distance) && distance > 0;
    return has_direction ? Vec3(away / distance) : sphere.normal;
}

// The law in scalar double, for energies, bounds and derivatives.
struct PenaltyContact {
    const Sphere& obstacle;
    Surface surface;
    Vec3 velocity;  // of the obstacle [m/s]

    // `origin`: of the places of points [m].
    PenaltyContact(const Sphere& sphere, const StageTime& time, const Vec3& origin = Vec3::Zero())
        : obstacle(sphere),
          surface(sphere.surface_at(time, origin)),
          velocity(sphere.velocity_at(time)) {}

    // Returns whether a point is so far off that it cannot be in the layer, quicker than its gap.
    bool is_beyond_layer(const Vec3& x) const {
        return level(x - surface.place) > surface.level_at(obstacle.reach());
    }
    struct Gap {
        double depth;  // in the layer: above 0 in contact [m]
        Vec3 normal;
        double radius;  // from the centre to the point; infinite for a plane [m]
    };
    Gap at(const Vec3& x) const {
        const Vec3 e = x - surface.place;
        const double f = level(e);
        const double root = std::sqrt(std::max(1 + surface.curvature * f, 0.0));
        const Vec3 normal = root > 0 ? Vec3(surface.gradient(e) / root) : surface.normal;
        return {obstacle.reach() - f / (1 + root), normal, obstacle.radius * root};
    }
    // The level adds 2 N first, unlike Surface::level, and its rounding is part of the bits of
    // implicit runs.
    double level(const Vec3& e) const { return e.dot(2 * surface.normal + surface.curvature * e); }

    double elastic(double depth) const {
        const double part = depth / obstacle.thickness;
        return obstacle.stiffness * depth * part * part;
    }
    double energy(double depth) const { return depth > 0 ? elastic(depth) * depth / 4 : 0; }

    // Returns push and friction on a point [N].
    Vec3 force(const Vec3& x, const Vec3& v) const {
        const Gap gap = at(x);
        if (!(gap.depth > 0)) return Vec3::Zero();
        const Vec3 u = v - velocity;
        const double closing = u.dot(gap.normal);
        const double w = obstacle.dissipation * closing;
        const Vec3 slip = u - closing * gap.normal;
        const double push = elastic(gap.depth) * (1 - w / std::sqrt(1 + w * w));
        const double speed =
            std::sqrt(slip.squaredNorm() + obstacle.slip_speed * obstacle.slip_speed);
        return push * gap.normal -
            (obstacle.friction > 0 ? obstacle.friction * push / speed : 0) * slip;
    }

    // The derivatives of the force by x and by v at one state, with the sign changed and symmetric.
    struct Derivatives {
        Eigen::Matrix3d by_x, by_v;
    };
    Derivatives derivatives(const Vec3& x, const Vec3& v) const {
        const Gap gap = at(x);
        Derivatives d{Eigen::Matrix3d::Zero(), Eigen::Matrix3d::Zero()};
        if (!(gap.depth > 0)) return d;
        const Vec3 &n = gap.normal, u = v - velocity;
        const double closing = u.dot(n);
        const double w = obstacle.dissipation * closing;
        const double root = std::sqrt(1 + w * w);
        const double damped = 1 - w / root;
        const double elastic_push = elastic(gap.depth);
        const double push = elastic_push * damped;
        const Eigen::Matrix3d along = n * n.transpose();
        const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - along;
        const double slope = obstacle.dissipation * elastic_push / (root * root * root);
        d.by_x = 3 * push / gap.depth * along;
        if (!std::isinf(gap.radius)) d.by_x -= push / gap.radius * across;
        d.by_v = slope * along;
        if (obstacle.friction > 0) {
            const Vec3 slip = u - closing * n;
            const double speed =
                std::sqrt(slip.squaredNorm() + obstacle.slip_speed * obstacle.slip_speed);
            const Vec3 t = slip / speed;
            d.by_v += obstacle.friction * push / speed * (across - t * t.transpose());
            const Eigen::Matrix3d mixed = obstacle.friction * slope * t * n.transpose();
            d.by_v -= (mixed + mixed.transpose()) / 2;
            const Eigen::Matrix3d pressed =
                3 * obstacle.friction * push / gap.depth * t * n.transpose();
            d.by_x -= (pressed + pressed.transpose()) / 2;
        }
        return d;
    }
    // Leaves out the parts that may make a matrix indefinite: what softens, and what friction
    // mixes.
    static Derivatives positive_definite(const Derivatives& d) {
        const auto diagonal = [](const Eigen::Matrix3d& m) {
            return Eigen::Matrix3d(m.diagonal().cwiseMax(0.0).asDiagonal());
        };
        return {diagonal(d.by_x), diagonal(d.by_v)};
    }
};

}  // namespace clothsim
