// Input and output of the edge kernel, as plain data that portable and per-instruction-set files
// share.
#pragma once

#include <cstddef>
#include <cstdint>

#include "forces/penalty_arguments.hpp"
#include "kernels/gather/gather_arguments.hpp"

namespace clothsim {

// Coefficients of one vector of mass points. Every kind of spring that starts in a point has
// `stiffness`, `tension` and `damping`, a lane each. All are 0 in a lane whose point has no such
// spring. With r = root_scale / l they are scaled to
//   force / mass = unit (r (damping (w.d) r - tension) + stiffness) d
// The first class has every spring in every lane. In double `stiffness` is rounded to the product
// of tension and r at rest (see exact_at_rest).
struct EdgeCoefficientIndex {
    static constexpr int stiffness = 0, tension = 1, damping = 2, count = 3;
};

// A row is a sequence of records, one a vector of mass points; a record is a sequence of vectors.
// In single as many records of their compensation stand behind the state. So all data of a stage
// are one stream of memory.
struct StateRecord {  // x, y, z, vx, vy, vz of x_n and v_n
    static constexpr int count = 6;
};
struct WorkRecord {  // the state at the stage, a1, a2 and then a1 + 2 (a2 + a3)
    static constexpr int first = 6, sum = 9, count = 12;
};

template <class Real>
struct EdgeRowPointers {
    Real* state;
    Real* work;  // in the stage `evaluate` three vectors a record: the accelerations
    const Real* inverse_mass;  // null: uniform, and no force on points
    const Real* applied;  // accelerations by forces on points, three vectors each; null: none
    const Real* free;  // 0 for pinned and padding points, else 1; null: there are none
    int row;           // of the cloth
};

// One stage over a band of rows.
template <class Real>
struct EdgeArguments;

// The first adds to the forces on the pending row; the second returns whether forces may act on
// rows [begin, end) of a stage.
template <class Real>
using EdgeForcesKernel = void (*)(const EdgeArguments<Real>&);
template <class Real>
using EdgeNearKernel = bool (*)(const EdgeArguments<Real>&, int begin, int end);

template <class Real>
struct EdgeArguments : StepConstants<Real> {
    int vectors;  // per row, at least 2
    std::ptrdiff_t compensation;  // from a value of the state to what rounding took from it
    Stage stage;
    Features features;
    const EdgeRowPointers<Real>* rows;  // of the band, in the order of the sweep
    const Real* coefficients;  // [class][SpringKind][EdgeCoefficientIndex][lane]
    const std::uint8_t* coefficient_class;  // per vector of a row
    // The shape is [vector][columns - 1][lane]: all bits where so many columns follow, else none.
    const Real* reach;
    // The first vectors of a row, in which each lane has every spring: all but the last two of a
    // row without padding.
    int whole_vectors;
    // Scratch, three vectors for each vector of mass points and one more for forces past the row's
    // end. The rows take turns: forces received by the current row, by the next row, and by the row
    // after that.
    Real* received[2];
    Real* received_2;
    // The row whose forces are known but whose stage is not finished, -1: none; and its place for
    // the stage.
    int pending;
    const Real* pending_source;
    Real* force;  // on the pending row
    EdgeForcesKernel<Real> forces;  // beside the springs; null: there are none
    PenaltyRows<Real> contacts;
    // So many rows ahead, of `row_count`, a part of each record of the state is fetched from memory
    // while a row is worked on. The part is the elements [ahead_begin, ahead_end). 0: none.
    int ahead;
    std::ptrdiff_t ahead_begin, ahead_end;
    int row_count;
};

// Places of a row for a stage: its own records and the records of the two rows further on. They are
// null where the cloth ends.
template <class Real>
struct EdgeSources {
    const Real* here;
    const Real* below;
    const Real* below_2;
};

}  // namespace clothsim
