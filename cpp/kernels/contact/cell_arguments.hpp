// Input and output of the passes of offset "cell". Plain data, shared by portable and per-instruction-set
// files.
#pragma once

#include "kernels/contact/contact_arguments.hpp"

namespace clothsim {

// The cell of a point lies between it, its neighbour to the right and the two below. Values of points and
// cells are arrays of their own: lane l of vector j of row i at (i * vectors + j) * lanes + l.
template <class Real>
struct CellArguments {
    ContactArguments<Real> contact;
    // From a vector to its right-hand neighbours, and of the last vector of a row; from a row to the next
    // [elements].
    std::ptrdiff_t right, right_of_last, below;
    bool transposed;  // the left-hand neighbours of vector 0 are the last vector's, a lane further
    const std::uint64_t* cells;  // a bit a lane: whether the cell is one
    Real* cell_radii2;  // rho^2 of the cells [m^2]; an element before the first may be read
    Real* point_radii2;  // the largest of a point's cells, before the step [m^2]
    std::uint64_t* near;  // a bit a lane: points that may touch a sphere
    std::uint8_t* near_rows;
    std::uint8_t* raised_rows;  // rows in which a point was moved outwards
    std::uint8_t* capped_rows;  // rows in which a point in contact has a rho above the radius
};

}  // namespace clothsim
