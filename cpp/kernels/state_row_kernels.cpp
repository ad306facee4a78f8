// CMake compiles this file for each instruction set.
#include "kernels/state_row_kernels.hpp"

#include <algorithm>
#include <type_traits>

#include "kernels/four.hpp"
#include "kernels/this_instruction_set.hpp"

namespace clothsim {
namespace {

using std::ptrdiff_t;

// Whether all numbers are finite in the layout. Of four at a time, so that none waits for the last. Finite
// ones times 0 are 0. The rounding of a number to single is infinite or NaN where the number has become so,
// else so small that the sum is finite.
template <class Real>
struct NotFinite {
    using V = std::conditional_t<sizeof(Real) == 4, FourSingles, Four>;
    V sum[4] = {};
    CLOTHSIM_INLINE void note(int i, V a) { sum[i] += sizeof(Real) == 4 ? a : a * V{}; }
    CLOTHSIM_INLINE bool none() const { return all_zero(((sum[0] + sum[1]) + (sum[2] + sum[3])) * V{}); }
};

// A square: element i of lane l is at outside[l * stride + i], and in the layout at inside[place[i] + l].
template <int lanes, class Real, class Outside>
CLOTHSIM_INLINE void put_square(const Outside* outside, ptrdiff_t stride, const double* shift, Real* inside,
                                ptrdiff_t compensation, const ptrdiff_t* place, NotFinite<Real>& bad) {
    Four row[4];
    for (int l = 0; l < 4; ++l) row[l] = four(outside + l % lanes * stride);
    transpose(row);
    for (int i = 0; i < 4; ++i) {
        Real* const to = inside + place[i];
        if constexpr (sizeof(Real) == 4) {
            const Four value = row[i] + four_of(shift[i]);
            const FourSingles high = rounded(value), lost = rounded(value - four(high));
            bad.note(i, lost);
            put(to, high);
            put(to + compensation, lost);
        } else {
            bad.note(i, row[i]);
            if constexpr (lanes == 4) put(to, row[i]);
            else put_two(to, row[i]);
        }
    }
}
template <int lanes, bool compensated, class Real, class Outside>
CLOTHSIM_INLINE void take_square(const Real* inside, ptrdiff_t compensation, const ptrdiff_t* place,
                                 const double* shift, Outside* outside, ptrdiff_t stride) {
    Four row[4];
    for (int i = 0; i < 4; ++i) {
        const Real* const from = inside + place[i];
        if constexpr (lanes == 4) row[i] = four(from);
        else row[i] = two(from);
        if constexpr (compensated) row[i] = row[i] + four(from + compensation) + four_of(shift[i]);
    }
    transpose(row);
    for (int l = 0; l < lanes; ++l) put(outside + l * stride, row[l]);
}

// `square(lane, element)` over the lanes that have all their columns, `one(lane, element)` over the elements
// of the others. A lane's columns stand side by side in the row, 3 vectors elements of it.
template <int lanes, class Square, class One>
CLOTHSIM_INLINE void each_transposed(const TransposedRow& row, Square square, One one) {
    const int elements = 3 * row.vectors;
    const int whole = std::min(row.columns / row.vectors, row.lanes) / lanes * lanes;
    for (int lane = 0; lane < whole; lane += lanes) {
        int element = 0;
        for (; element + 4 <= elements; element += 4) square(lane, element);
        if (element < elements) square(lane, elements - 4);  // some a second time
    }
    for (int lane = whole; lane < row.lanes; ++lane) {
        const int columns = std::clamp(row.columns - lane * row.vectors, 0, row.vectors);
        for (int element = 0; element < 3 * columns; ++element) one(lane, element);
    }
}

template <class Real>
constexpr int lanes_at_once = std::min(4, int(Lanes<Real, ThisArch>::size));

template <class Real, class Outside>
bool put_transposed(const Outside* row, const RowShift& shift, Real* records, ptrdiff_t compensation,
                    const TransposedRow& given) {
    constexpr int lanes = lanes_at_once<Real>;
    const TransposedRow transposed = given;  // nothing that is written can be part of it
    const ptrdiff_t width = 3 * transposed.vectors;
    NotFinite<Real> bad;
    bool finite = true;
    each_transposed<lanes>(
        transposed,
        [&](int lane, int element) __attribute__((always_inline)) {
            put_square<lanes>(row + lane * width + element, width, shift.of + element % 3, records + lane,
                              compensation, transposed.place + element, bad);
        },
        [&](int lane, int element) __attribute__((always_inline)) {
            finite &= put_one(row[lane * width + element], shift.of[element % 3],
                              records + transposed.place[element] + lane, compensation);
        });
    return finite & bad.none();
}

template <bool compensated, class Real, class Outside>
CLOTHSIM_INLINE void take_transposed_any(const Real* records, ptrdiff_t compensation,
                                         const TransposedRow& transposed, const RowShift& shift,
                                         Outside* row) {
    constexpr int lanes = lanes_at_once<Real>;
    const ptrdiff_t width = 3 * transposed.vectors;
    each_transposed<lanes>(
        transposed,
        [&](int lane, int element) __attribute__((always_inline)) {
            take_square<lanes, compensated>(records + lane, compensation, transposed.place + element,
                                            shift.of + element % 3, row + lane * width + element, width);
        },
        [&](int lane, int element) __attribute__((always_inline)) {
            take_one<compensated>(records + transposed.place[element] + lane, compensation,
                                  shift.of[element % 3], row + lane * width + element);
        });
}
template <class Real, class Outside>
void take_transposed(const Real* records, ptrdiff_t compensation, const TransposedRow& transposed,
                     const RowShift& shift, Outside* row) {
    if constexpr (sizeof(Real) == 4)
        if (compensation != 0)
            return take_transposed_any<true>(records, compensation, transposed, shift, row);
    take_transposed_any<false>(records, compensation, transposed, shift, row);
}

template <class Real, class Outside>
constexpr RowKernels<Real, Outside> row_kernels() {
    return {&put_transposed<Real, Outside>, &take_transposed<Real, Outside>};
}

}  // namespace

template <>
constinit const StateRowKernels StateRowKernelsOf<this_instruction_set>::kernels{
    row_kernels<float, float>(), row_kernels<float, double>(), row_kernels<double, float>(),
    row_kernels<double, double>()};

}  // namespace clothsim
