// What the edge kernel reads and writes. Plain data, shared by portable and per-instruction-set files.
#pragma once

#include <cstddef>
#include <cstdint>

#include "kernels/gather_arguments.hpp"

namespace clothsim {

// The springs that start in a mass point, each taken once, by where they lead.
enum EdgeKind : int { to_right, to_right_2, to_below, to_diagonal, to_below_2 };
inline constexpr int edge_kind_count = 5;

// Coefficients of one vector of mass points: for every kind `stiffness`, `tension` and `damping`, a lane
// each; all 0 in a lane whose point has no such spring. Scaled so that with r = scale / l
//   force / mass = (r (damping (w.d) r - tension) + stiffness) d
struct EdgeCoefficientIndex {
    static constexpr int stiffness = 0, tension = 1, damping = 2, count = 3;
};

template <class Real>
struct SphereOutline {
    Real center[3];
    Real radius_squared;
};

// A row is a record of planes, each `vectors` vectors long:
//   0-5 state x_n, v_n   6-11 stage state   12-14 a1   15-17 a2 + a3   18-23 compensation (single)
struct RowPlanes {
    static constexpr int state = 0, stage = 6, first = 12, sum = 15, compensation = 18;
    static constexpr int count = 18, count_compensated = 24;
};

template <class Real>
struct EdgeArguments {
    int vectors;  // per row, at least 2
    Stage stage;
    std::ptrdiff_t record;     // elements from row to row
    Real* rows;                // record of the band's first row
    const Real* coefficients;  // [class][EdgeKind][EdgeCoefficientIndex][lane]
    const std::uint8_t* coefficient_class;  // per vector of a row
    Real gravity[3];
    Real half_h, h, h2_6, h_6;
    Real point_damping;
    const Real* inverse_mass;  // one plane a row; null: uniform
    const Real* free;          // one plane a row, 0 for pinned and padding points, else 1
    const std::uint8_t* row_has_fixed;
    // Scratch, three planes each: what the next row and the row after it have received so far, and the
    // force on the current row.
    Real* received;
    Real* received_2;
    Real* force;
    const SphereOutline<Real>* spheres;
    int sphere_count;
    void (*hit)(void* context, int sphere, int row, int vector, std::uint64_t lanes);
    void* context;
};

// Sources of a row: the planes at which the stage looks, in this row and the two below it; null where the
// cloth ends.
template <class Real>
struct EdgeSources {
    const Real* here;
    const Real* below;
    const Real* below_2;
};

}  // namespace clothsim
