// Input and output of the passes of offset "cell". Plain data, shared by portable and per-instruction-set
// files.
#pragma once

#include "kernels/contact/contact_arguments.hpp"

namespace clothsim {

// Marks of a row of points: some may touch a sphere; they wait for rho of their cells; some are left to the
// pass; some were changed; some were moved outwards; some are in contact with rho above the radius.
struct CellMarks {
    static constexpr std::uint8_t near = 1, waits = 2, unresolved = 4, responded = 8, raised = 16,
                                  capped = 32;
};

// The cell of a point lies between it, its neighbour to the right and the two below. Values of points and
// cells are arrays of their own: lane l of vector j of row i at (i * vectors + j) * lanes + l.
template <class Real>
struct CellArguments {
    ContactArguments<Real> contact;
    // From a vector to its right-hand neighbours, and of the last vector of a row; from a row to the next
    // [elements].
    std::ptrdiff_t right, right_of_last, below;
    bool transposed;  // the left-hand neighbours of vector 0 are the last vector's, a lane further
    bool only_waiting;  // respond in the rows that wait alone
    bool first_round;  // of moving points outwards
    bool found;  // rho of the wanted cells is that of the state
    const std::uint64_t* cells;  // a bit a lane: whether the cell is one
    Real* cell_radii2;  // rho^2 of the cells [m^2]; an element before the first may be read
    Real* point_radii2;  // the largest of a near point's cells, before the step [m^2]
    std::uint64_t* near;  // a bit a lane: points that may touch a sphere
    std::uint64_t* raisable;  // of these, the free points that began outside
    std::uint8_t* marks;  // a value a row of points
    std::uint8_t* known;  // rows of cells whose rho is that before the step; of the rows done, after it
    const std::uint8_t* wanted;  // rows of cells whose rho is needed
};

}  // namespace clothsim
