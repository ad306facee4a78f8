// CMake compiles this file for each instruction set.
#include "kernels/state_row_kernels.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
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

// A square: element i of lane l is at outside[l * stride + i], and in the layout at inside[place(i) + l]. The
// first `kept` of four elements are moved; the others are only read, or written where a later square writes
// again.
template <int lanes, int kept, bool shifted, class Real, class Outside, class Place>
CLOTHSIM_INLINE void put_square(const Outside* outside, ptrdiff_t stride, const double* shift, Real* inside,
                                ptrdiff_t compensation, Place place, NotFinite<Real>& bad) {
    Four row[4];
    for (int l = 0; l < 4; ++l) row[l] = four(outside + l % lanes * stride);
    transpose(row);
    for (int i = 0; i < kept; ++i) {
        Real* const to = inside + place(i);
        if constexpr (sizeof(Real) == 4) {
            const Four value = shifted ? row[i] + four_of(shift[i]) : row[i];
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
template <int lanes, int kept, bool compensated, bool shifted, class Real, class Outside, class Place>
CLOTHSIM_INLINE void take_square(const Real* inside, ptrdiff_t compensation, Place place, const double* shift,
                                 Outside* outside, ptrdiff_t stride) {
    Four row[4];
    for (int i = 0; i < 4; ++i) {
        const Real* const from = inside + place(std::min(i, kept - 1));
        if constexpr (lanes == 4) row[i] = four(from);
        else row[i] = two(from);
        if constexpr (compensated) row[i] += four(from + compensation);
        if constexpr (shifted) row[i] += four_of(shift[i]);
    }
    transpose(row);
    for (int l = 0; l < lanes; ++l) put(outside + l * stride, row[l]);
}

template <class Real, class Outside>
CLOTHSIM_INLINE bool put_one(Outside outside, double shift, Real* inside, ptrdiff_t compensation) {
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
CLOTHSIM_INLINE void take_one(const Real* inside, ptrdiff_t compensation, double shift, Outside* outside) {
    if constexpr (compensated) *outside = Outside(double(*inside) + double(inside[compensation]) + shift);
    else *outside = Outside(*inside);
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

// `work` with whether there is a shift, and whether there is compensation, known to the compiler; only single
// has them.
CLOTHSIM_INLINE bool any(const RowShift& shift) {
    return shift.of[0] != 0 || shift.of[1] != 0 || shift.of[2] != 0;
}
template <class Real, class Work>
CLOTHSIM_INLINE auto with_shift(const RowShift& shift, Work work) {
    if constexpr (sizeof(Real) == 4)
        if (any(shift)) return work(std::true_type{});
    return work(std::false_type{});
}

template <bool shifted, class Real, class Outside>
CLOTHSIM_INLINE bool put_transposed_any(const Outside* row, const RowShift& shift, Real* records,
                                        ptrdiff_t compensation, const TransposedRow& given) {
    constexpr int lanes = lanes_at_once<Real>;
    const TransposedRow transposed = given;  // nothing that is written can be part of it
    const ptrdiff_t width = 3 * transposed.vectors;
    NotFinite<Real> bad;
    bool finite = true;
    each_transposed<lanes>(
        transposed,
        [&](int lane, int element) __attribute__((always_inline)) {
            const auto place = [&](int i) { return transposed.place[element + i] + lane; };
            put_square<lanes, 4, shifted>(row + lane * width + element, width, shift.of + element % 3,
                                          records, compensation, place, bad);
        },
        [&](int lane, int element) __attribute__((always_inline)) {
            finite &= put_one(row[lane * width + element], shift.of[element % 3],
                              records + transposed.place[element] + lane, compensation);
        });
    return finite & bad.none();
}
template <class Real, class Outside>
bool put_transposed(const Outside* row, const RowShift& shift, Real* records, ptrdiff_t compensation,
                    const TransposedRow& transposed) {
    return with_shift<Real>(shift, [&](auto shifted) __attribute__((always_inline)) {
        return put_transposed_any<shifted.value>(row, shift, records, compensation, transposed);
    });
}

template <bool compensated, bool shifted, class Real, class Outside>
CLOTHSIM_INLINE void take_transposed_any(const Real* records, ptrdiff_t compensation,
                                         const TransposedRow& transposed, const RowShift& shift,
                                         Outside* row) {
    constexpr int lanes = lanes_at_once<Real>;
    const ptrdiff_t width = 3 * transposed.vectors;
    each_transposed<lanes>(
        transposed,
        [&](int lane, int element) __attribute__((always_inline)) {
            const auto place = [&](int i) { return transposed.place[element + i] + lane; };
            take_square<lanes, 4, compensated, shifted>(records, compensation, place, shift.of + element % 3,
                                                        row + lane * width + element, width);
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
            return with_shift<Real>(shift, [&](auto shifted) __attribute__((always_inline)) {
                take_transposed_any<true, shifted.value>(records, compensation, transposed, shift, row);
            });
    take_transposed_any<false, false>(records, compensation, transposed, shift, row);
}

// Squares of four columns, of whose four elements the last is the next column's x: the last column of all is
// no part of one.
template <class Square, class One>
CLOTHSIM_INLINE void each_of_planes(int columns, Square square, One one) {
    int column = 0;
    for (; column + 4 < columns; column += 4) square(column);
    for (; column < columns; ++column)
        for (int k = 0; k < 3; ++k) one(column, k);
}

template <class Real, class Outside>
bool put_planes(const Outside* row, const RowShift& shift, Real* planes, ptrdiff_t compensation,
                ptrdiff_t plane, int columns) {
    NotFinite<Real> bad;
    bool finite = true;
    each_of_planes(
        columns,
        [&](int column) __attribute__((always_inline)) {
            put_square<4, 3, sizeof(Real) == 4>(
                row + 3 * column, 3, shift.of, planes + column, compensation,
                [=](int i) { return i * plane; }, bad);
        },
        [&](int column, int k) __attribute__((always_inline)) {
            finite &= put_one(row[3 * column + k], shift.of[k], planes + k * plane + column, compensation);
        });
    return finite & bad.none();
}

template <bool compensated, class Real, class Outside>
CLOTHSIM_INLINE void take_planes_any(const Real* planes, ptrdiff_t compensation, ptrdiff_t plane, int columns,
                                     const RowShift& shift, Outside* row) {
    each_of_planes(
        columns,
        [&](int column) __attribute__((always_inline)) {
            take_square<4, 3, compensated, compensated>(
                planes + column, compensation, [=](int i) { return i * plane; }, shift.of, row + 3 * column,
                3);
        },
        [&](int column, int k) __attribute__((always_inline)) {
            take_one<compensated>(planes + k * plane + column, compensation, shift.of[k],
                                  row + 3 * column + k);
        });
}
template <class Real, class Outside>
void take_planes(const Real* planes, ptrdiff_t compensation, ptrdiff_t plane, int columns,
                 const RowShift& shift, Outside* row) {
    if constexpr (sizeof(Real) == 4)
        if (compensation != 0) return take_planes_any<true>(planes, compensation, plane, columns, shift, row);
    take_planes_any<false>(planes, compensation, plane, columns, shift, row);
}

// Three vectors of four at a time: as many elements as make whole points.
template <class Outside>
void extent(const Outside* x, ptrdiff_t points, double (&low)[3], double (&high)[3]) {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    Four l[3], h[3];
    for (int k = 0; k < 3; ++k) {
        l[k] = four_of(infinity);
        h[k] = four_of(-infinity);
    }
    ptrdiff_t point = 0;
    for (; point + 4 <= points; point += 4)
        for (int k = 0; k < 3; ++k) {
            const Four value = four(x + 3 * point + 4 * k);
            l[k] = least(value, l[k]);
            h[k] = most(value, h[k]);
        }
    double lows[12], highs[12];
    for (int k = 0; k < 3; ++k) {
        put(lows + 4 * k, l[k]);
        put(highs + 4 * k, h[k]);
    }
    for (int k = 0; k < 3; ++k) {
        low[k] = infinity;
        high[k] = -infinity;
    }
    const auto take = [&](int k, double a, double b) {
        low[k] = a < low[k] ? a : low[k];
        high[k] = b > high[k] ? b : high[k];
    };
    for (int i = 0; i < 12; ++i) take(i % 3, lows[i], highs[i]);
    for (; point < points; ++point)
        for (int k = 0; k < 3; ++k) take(k, double(x[3 * point + k]), double(x[3 * point + k]));
}

template <class Real, class Outside>
constexpr RowKernels<Real, Outside> row_kernels() {
    return {&put_transposed<Real, Outside>, &take_transposed<Real, Outside>, &put_planes<Real, Outside>,
            &take_planes<Real, Outside>, &extent<Outside>};
}

}  // namespace

template <>
constinit const StateRowKernels StateRowKernelsOf<this_instruction_set>::kernels{
    row_kernels<float, float>(), row_kernels<float, double>(), row_kernels<double, float>(),
    row_kernels<double, double>()};

}  // namespace clothsim
