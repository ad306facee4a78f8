// Prescribed motions of spheres and driven pins: pieces, which python/clothsim/model/motion.py
// makes.
#pragma once

#include <algorithm>
#include <Eigen/Core>
#include <vector>

namespace clothsim {

using Vec3 = Eigen::Vector3d;

// With u = (t - begin) / length, the displacement on a piece is
//     p0 + u p1 + u^2 p2 + ... + u^5 p5 + amplitude g(u)
//     g(u) = sin(angle u)     or, where decay > 0,     (1 - exp(-decay u)) / (1 - exp(-decay))
// All members are doubles, in the order of PIECE in motion.py.
struct MotionPiece {
    double begin, length;  // s; of a periodic motion parts of the period
    Vec3 p0, p1, p2, p3, p4, p5;  // m
    Vec3 amplitude;  // m
    double angle;  // rad
    double decay;
};
static_assert(sizeof(MotionPiece) == 25 * sizeof(double));

struct MotionState {
    Vec3 displacement = Vec3::Zero();  // m
    Vec3 velocity = Vec3::Zero();  // m/s
};

// A time of a step at which pins and obstacles are placed. Where the velocity of a motion jumps at
// an end of the step, `inside` selects the piece that counts.
struct StageTime {
    double t, inside;

    // A jump that lies within this part of a step from its ends is not inside it.
    static constexpr double end_part = 1e-6;
    static StageTime at_rest(double t) { return {t, t}; }
    static StageTime of_stage(double t0, double h, double part) {
        return {t0 + part * h, t0 + std::clamp(part, end_part, 1 - end_part) * h};
    }
    // The time is the end of a step, where the next one starts.
    static StageTime of_end(double t1, double h) { return {t1, t1 + end_part * h}; }
};

struct Motion {
    std::vector<MotionPiece> pieces{};  // by their beginnings; none: no motion
    double period = 0;  // s; 0: not periodic
    double phase = 0;  // part of the period that is over at t = 0
    bool relative = true;  // displacements count from the start, not from the origin

    // Returns the state at a time, by the piece in which `inside` lies: the velocity may jump where
    // a piece ends.
    MotionState at(double t, double inside) const;
    MotionState at(double t) const { return at(t, t); }
    Vec3 place(const Vec3& start, const MotionState& state) const {
        return relative ? Vec3(start + state.displacement) : state.displacement;
    }
};

}  // namespace clothsim
