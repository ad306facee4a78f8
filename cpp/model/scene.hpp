// The simulated scene: a cloth, its gravity and its spheres.
#pragma once

#include <algorithm>
#include <Eigen/Core>
#include <vector>

#include "model/cloth.hpp"
#include "model/force.hpp"
#include "model/sphere.hpp"

namespace clothsim {

// Positions [m] or velocities [m/s] of all mass points, row by row.
using Points = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;
using PointsView = Eigen::Map<const Points>;

// A pinned mass point that moves.
struct DrivenPin {
    int point;
    Vec3 start;  // m
    int motion;  // number in the scene's
};

struct Scene {
    Cloth cloth;
    Vec3 gravity = Vec3::Zero();  // m/s^2
    std::vector<Sphere> spheres;
    Points force;  // on each mass point [N]; no rows: none
    std::vector<std::shared_ptr<const Force>> forces;

    std::vector<Motion> pin_motions;
    std::vector<DrivenPin> driven_pins;  // in the order of points

    // Calls `visit(pin, place, velocity)` for the driven pins among points [begin, end).
    template <class Visit>
    void each_driven_pin(const StageTime& time, int begin, int end, Visit visit) const {
        auto pin = std::partition_point(driven_pins.begin(), driven_pins.end(),
                                        [begin](const DrivenPin& p) { return p.point < begin; });
        MotionState state;
        for (int motion = -1; pin != driven_pins.end() && pin->point < end; ++pin) {
            const Motion& m = pin_motions[std::size_t(pin->motion)];
            // Pins beside each other often share a motion.
            if (pin->motion != motion) state = m.at(time.t, time.inside);
            motion = pin->motion;
            visit(pin->point, m.place(pin->start, state), state.velocity);
        }
    }
    bool has_driven_pins() const { return !driven_pins.empty(); }

    bool has_force() const { return force.rows() > 0; }
    // Returns the acceleration of a mass point beside springs and damping [m/s^2].
    Vec3 field_at(int point) const {
        if (!has_force()) return gravity;
        return gravity + force.row(point).transpose() / cloth.mass[std::size_t(point)];
    }
};

}  // namespace clothsim
