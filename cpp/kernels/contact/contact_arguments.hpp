// Input and output of the contact pass. Plain data, shared by portable and per-instruction-set files.
#pragma once

#include <cstddef>
#include <cstdint>

#include "kernels/contact/continuous.hpp"

namespace clothsim {

// A layout seen as rows of vectors: component k of vector j of row i lies at i * row + j * vector + k *
// component. Both engines' layouts have this form.
struct VectorGeometry {
    std::ptrdiff_t row, vector, component;
    std::ptrdiff_t compensation;  // from a value to what rounding took from it; 0: not compensated
    int rows, vectors;
};

// Marks of a row of points: some may touch a sphere; they wait for rho of their cells; some were changed;
// some were lifted.
struct ContactMarks {
    static constexpr std::uint8_t near = 1, waits = 2, responded = 4, lifted = 8;
};

// Sums of a row, of one sphere.
struct RowSums {
    double depth;  // deepest end of a point [m]
    double work;  // of lifts, times the step [J s]
};

// Values of points and cells are arrays of their own: lane l of vector j of row i at (i * vectors + j) *
// lanes + l. Sets of points are a bit a lane, a value a vector. The cell of a point lies between it, its
// neighbour to the right and the two below.
template <class Real>
struct ContactArguments {
    VectorGeometry geometry;
    Real* state;
    Real* before;  // the state at the start of the step, in the same layout
    const SweptSphere* spheres;
    int sphere_count;
    const std::uint64_t* free;  // points that are neither pinned nor padding
    const Real* mass;  // [kg]
    double*
        impulses;  // on the sphere, if it is one: x, y and z of a row, `impulse_row` from row to row [N s]
    std::ptrdiff_t impulse_row;
    RowSums* sums;  // a value a row
    bool bounces;  // whether velocities before the step are needed; those of `before` are old otherwise
    std::uint8_t* marks;  // a value a row: ContactMarks
    std::uint64_t* near;  // points that may touch a sphere
    std::uint64_t* unresolved;  // points without a response here: bounces that fly; all among several
                                // spheres; pinned points in a sphere
    std::uint64_t* inside;  // points that began inside
    // Offset "cell".
    bool cells;
    bool only_waiting;  // respond in the rows that wait alone
    bool first_round;  // of lifts
    std::ptrdiff_t right, right_of_last, below;  // from a vector to its right-hand neighbours, and of the
                                                 // last of a row; from a row to the next [elements]
    bool transposed;  // the left-hand neighbours of vector 0 are the last vector's, a lane further
    const std::uint64_t* cell_lanes;  // whether the cell is one
    Real* cell_radii2;  // rho^2 of the cells [m^2]; an element before the first may be read
    Real* point_radii2;  // the largest of a near point's cells, before the step [m^2]
    Real* press;  // of a near point: speed that the contact took in this step (VectorResponse) [m/s]
    std::uint8_t* known;  // rows of cells whose rho is that before the step
    const std::uint8_t* wanted;  // rows of cells whose rho is needed
};

}  // namespace clothsim
