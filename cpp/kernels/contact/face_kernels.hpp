// Which triangles of a cloth a plane beside each keeps from a sphere throughout a step, many at once. One for
// each instruction set.
#pragma once

#include "kernels/instruction_set.hpp"

namespace clothsim {

// A row of cells. Each number is that of the cell's first corner, or of a triangle of the cell.
struct CellRow {
    using Places = const double* [3];  // x, y, z [m], in the sphere's frame
    Places start, end;  // of the row of points
    Places start_below, end_below;  // of the row after it
    const double*
        planes[2][6];  // of the first and the second triangle: direction at the start, direction at the end
    int cells;
};

// The least height of each triangle above its turning plane (contact/triangle.hpp), above the centre of the
// sphere [m].
using CellHeights = void (*)(const CellRow&, double* first, double* second);

struct FaceKernels {
    CellHeights heights;
};

template <InstructionSet set>
struct FaceKernelsOf {
    static const FaceKernels kernels;
};

}  // namespace clothsim
