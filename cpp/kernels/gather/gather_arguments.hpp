// Input and output of one RK4 stage of the gather kernel, as plain data for the portable files and
// the per-instruction-set files. So the header holds no code but constant expressions.
#pragma once

#include <cstddef>
#include <cstdint>

#include "forces/penalty_arguments.hpp"
#include "model/stencil.hpp"
#include "model/thread_grid.hpp"

namespace clothsim {

// Classic RK4 on (x, v) together, in Nystroem form: with a1..a4 the accelerations at the stages,
//   x2 = x + h/2 v           v2 = v + h/2 a1
//   x3 = x + h/2 v2          v3 = v + h/2 a2
//   x4 = x + h v3            v4 = v + h a3
//   x' = x + h v + h^2/6 (a1 + a2 + a3)
//   v' = v + h/6 (a1 + 2 (a2 + a3) + a4)
// which is the same method with fewer arrays kept. `evaluate` stores the acceleration only.
enum class Stage : int { first, second, third, fourth, evaluate };

// Whether the edge kernel rounds the stiffness as it rounds the tension of a spring at rest, and
// multiplies and subtracts apart. A spring at rest then gives no force to the last bit. All rest
// lengths of a family are shifted by the rounding of one. That is nothing in double, but as much as
// all other errors of a run together in single.
template <class Real>
inline constexpr bool exact_at_rest = sizeof(Real) == 8;

// Constants of all points of a cloth in a step, in either kernel. The edge kernel sums
// accelerations in a unit in which the damping constant is 1 where all families are damped alike,
// which saves a product for each spring. Gravity, drag and applied accelerations are in that unit;
// the factors of accelerations hold it.
template <class Real>
struct StepConstants {
    Real unit;  // m / s^2; 1 in the gather kernel
    Real gravity[3];
    Real drag;  // divided by mass where it is uniform; 0: none
    Real half_h, h;  // of a velocity
    Real half_h_a, h_a, h2_6, h_6;  // of an acceleration
};

// Coefficients are scaled by 1/mass where the mass is uniform.
template <class Real>
struct SpringCoefficients {
    Real stiffness, rest, damping;
};

// The lanes of a vector of points in a row whose point has a neighbour so many columns on.
struct LanesWithNeighbour {
    std::uint16_t bits[2 * stencil_reach] = {};
    static constexpr int index(int column) {
        return column < 0 ? column + stencil_reach : column + stencil_reach - 1;
    }
};

template <class Real>
struct GatherArguments : StepConstants<Real> {
    std::ptrdiff_t stride;  // elements from row to row
    std::ptrdiff_t plane;  // elements from component to component
    int rows;
    Stage stage;
    Features features;
    SpringCoefficients<Real> spring[spring_kind_count];
    const LanesWithNeighbour* lanes;  // for each vector of a row
    const Real* inverse_mass;  // null: uniform, and no force on points
    const Real* applied;  // three planes: accelerations by forces on points; null: none
    const Real* free;  // one plane, 0 for pinned and padding points, else 1
    const std::uint8_t* row_has_fixed;
    // These have six planes each (x, y, z, vx, vy, vz).
    const Real* source;  // state that this stage reads
    Real* state;  // x_n, v_n; stage four writes the new state here
    Real* target;  // state for the next stage
    Real* compensation;  // what rounding took from x and v; null: not compensated
    // These have three planes each.
    Real* first_acceleration;
    Real* acceleration_sum;  // a2 + a3
    PenaltyRows<Real> contacts;  // sums of rows and of groups of columns
};

}  // namespace clothsim
