// What is simulated: a cloth, its gravity and the spheres that it meets.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "model/cloth.hpp"
#include "model/sphere.hpp"

namespace clothsim {

// Positions [m] or velocities [m/s] of all mass points, row by row.
using Points = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;
using PointsView = Eigen::Map<const Points>;

struct Scene {
    Cloth cloth;
    Vec3 gravity = Vec3::Zero();  // m/s^2
    std::vector<Sphere> spheres;
    Points force;  // on each mass point [N]; no rows: none

    bool has_force() const { return force.rows() > 0; }
    // What accelerates a mass point beside springs and damping [m/s^2].
    Vec3 field_at(int point) const {
        if (!has_force()) return gravity;
        return gravity + force.row(point).transpose() / cloth.mass[std::size_t(point)];
    }
};

}  // namespace clothsim
