// Rows of mass points between an array of (x, y, z) and lane-transposed records: the kernels of one
// instruction set. A row passes through registers once, in squares of elements, which are
// converted, shifted and transposed there. Plain loops take 1.07 to 1.35 of a `cs.step` of one step.
#pragma once

#include <cmath>
#include <cstddef>

namespace clothsim {

// Where the elements of a row are in lane-transposed records (see cpp/kernels/edge/edge_row.hpp). Component
// c of column l vectors + k is lane l of the vector at place[3 k + c].
struct TransposedRow {
    int columns, lanes, vectors;
    const std::ptrdiff_t* place;
};

// A shift of the components of a point, stored twice over, so that four may be read from any of the first
// three. A shift by -0 changes nothing, not even the sign of 0.
struct RowShift {
    double of[6] = {-0.0, -0.0, -0.0, -0.0, -0.0, -0.0};
};

// An element into and out of a layout; whether it is finite there.
namespace {
template <class Real, class Outside>
inline __attribute__((always_inline)) bool put_one(Outside outside, double shift, Real* inside,
                                                   std::ptrdiff_t compensation) {
    if constexpr (sizeof(Real) == 4) {
        const double shifted = double(outside) + shift;
        *inside = Real(shifted);
        inside[compensation] = Real(shifted - double(*inside));
    } else {
        *inside = Real(outside);
    }
    return std::isfinite(*inside);
}
template <bool compensated, class Real, class Outside>
inline __attribute__((always_inline)) void take_one(const Real* inside, std::ptrdiff_t compensation,
                                                    double shift, Outside* outside) {
    if constexpr (compensated) *outside = Outside(double(*inside) + double(inside[compensation]) + shift);
    else *outside = Outside(*inside);
}
}  // namespace

// `Real`: of the layout; `Outside`: of the array. `compensation`: elements from a value to its rounding to
// single; 0: none is kept. Only single has it, and shifts. Putting a row returns whether all its numbers are
// finite in the layout.
template <class Real, class Outside>
struct RowKernels {
    bool (*put_transposed)(const Outside* row, const RowShift&, Real* records, std::ptrdiff_t compensation,
                           const TransposedRow&);
    void (*take_transposed)(const Real* records, std::ptrdiff_t compensation, const TransposedRow&,
                            const RowShift&, Outside* row);
};

template <class Real>
struct StateRowKernels {
    RowKernels<Real, float> of_float;
    RowKernels<Real, double> of_double;

    template <class Outside>
    const RowKernels<Real, Outside>& of() const {
        if constexpr (sizeof(Outside) == 4) return of_float;
        else return of_double;
    }
};

}  // namespace clothsim
