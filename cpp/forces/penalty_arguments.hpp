// Penalty contact (forces/penalty.hpp) as the kernels take it: plain data.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>

namespace clothsim {

// An obstacle at the time of a stage, as the kernels take it.
template <class Real>
struct PenaltyArguments {
    Real place[3];     // p0 relative to the origin of the state [m]
    Real normal[3];    // N
    Real velocity[3];  // m/s
    Real curvature;    // 1/m
    Real reach;        // offset + h: from the true surface to the edge of the layer [m]
    Real push;         // k / h^2, in the unit of the sums of forces
    Real dissipation;  // c [s/m]
    Real friction;     // mu
    Real slip2;        // v_s^2
    // The edge kernel scales depths by the root of `push`, third power; these are what the surface
    // adds to them. A `direct` obstacle has N - kappa p0 in the place of p0, and a flat one the
    // scale times N.
    Real scale, scaled_reach, scaled_radius;
    bool direct;
    // No point is in contact whose coordinate x[axis] has side * x[axis] >= bound; axis -1:
    // unknown.
    int axis;
    Real side, bound;
    int number;  // of the obstacle in the scene
    double weight;  // of the force in the impulse [N s]
    double time;  // of the state that is evaluated [s]
    bool between_steps;  // that state is one between steps: its depths and its time count
    bool moves;  // the obstacle does
};

// What the obstacles do to mass points is summed up in double, in a record for each obstacle of the
// scene, row, and group of columns of the gather kernel. Each lane of a kernel has sums of its own
// in the record, so that none waits for another, and one thread adds to a record, in the order of
// steps:
//
//     x, y, z of the impulse [N s], work [J], depth [m]: `lanes` numbers each; then the tail
struct ContactRecord {
    enum Field { impulse = 0, work = 3, depth = 4, tail = 5 };
    // The tail says whether anything was added, the time of the first contact and whether it is
    // known.
    enum Tail { touched = 0, first = 1, met = 2, tail_size = 8 };
    static constexpr std::ptrdiff_t size(int lanes) { return 5 * lanes + tail_size; }
};

// The obstacles that act on some rows, and the record of the first row and obstacle.
template <class Real>
struct PenaltyRows {
    const PenaltyArguments<Real>* obstacles = nullptr;
    int count = 0;
    double* sums = nullptr;
    std::ptrdiff_t row = 0;  // elements from a row's record to the next row's
    std::ptrdiff_t obstacle = 0;  // elements from an obstacle's record to the next one's
    int lanes = 0;
    std::uint64_t* near = nullptr;  // a bit for each obstacle near a row, row by row
};

}  // namespace clothsim
