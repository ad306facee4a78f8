// CMake compiles this file for each instruction set. The compiler makes vectors of the loop.
#include "kernels/contact/face_kernels.hpp"

#include "kernels/this_instruction_set.hpp"

namespace clothsim {
namespace {

#define CLOTHSIM_ALWAYS inline __attribute__((always_inline))

CLOTHSIM_ALWAYS double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
CLOTHSIM_ALWAYS double lower(double a, double b) { return a < b ? a : b; }

// Of a corner: the three Bernstein coefficients of its height, of degree 2 in time.
CLOTHSIM_ALWAYS double least(const double n0[3], const double n1[3], const CellRow::Places& start,
                             const CellRow::Places& end, int i) {
    const double p0[3] = {start[0][i], start[1][i], start[2][i]}, p1[3] = {end[0][i], end[1][i], end[2][i]};
    return lower(lower(dot(n0, p0), dot(n1, p1)), (dot(n0, p1) + dot(n1, p0)) / 2);
}

void cell_heights(const CellRow& row, double* __restrict first, double* __restrict second) {
    const CellRow r = row;
    for (int i = 0; i < r.cells; ++i) {
        const double (&n)[2][6] = {{r.planes[0][0][i], r.planes[0][1][i], r.planes[0][2][i],
                                    r.planes[0][3][i], r.planes[0][4][i], r.planes[0][5][i]},
                                   {r.planes[1][0][i], r.planes[1][1][i], r.planes[1][2][i],
                                    r.planes[1][3][i], r.planes[1][4][i], r.planes[1][5][i]}};
        first[i] = lower(
            lower(least(n[0], n[0] + 3, r.start, r.end, i), least(n[0], n[0] + 3, r.start, r.end, i + 1)),
            least(n[0], n[0] + 3, r.start_below, r.end_below, i));
        second[i] = lower(lower(least(n[1], n[1] + 3, r.start, r.end, i + 1),
                                least(n[1], n[1] + 3, r.start_below, r.end_below, i + 1)),
                          least(n[1], n[1] + 3, r.start_below, r.end_below, i));
    }
}

}  // namespace

template <>
constinit const FaceKernels FaceKernelsOf<this_instruction_set>::kernels{&cell_heights};

}  // namespace clothsim
