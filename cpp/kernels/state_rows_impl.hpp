// What state_rows.hpp declares, in squares of doubles.
#pragma once

#include <algorithm>
#include <limits>

#include "kernels/lanes.hpp"
#include "kernels/state_rows.hpp"

namespace clothsim {
namespace {

// Four doubles, or two. By hand from and to single: g++ 12 leaves out the rounding of a conversion
// there and back.
#if defined(__AVX2__)
using Doubles = Lanes<double, xsimd::fma3<xsimd::avx2>>;
CLOTHSIM_INLINE Doubles doubles(const float* p) { return Doubles(_mm256_cvtps_pd(_mm_loadu_ps(p))); }
CLOTHSIM_INLINE void put(float* p, const Doubles& a) { _mm_storeu_ps(p, _mm256_cvtpd_ps(a)); }
#elif defined(CLOTHSIM_PORTABLE)
using Doubles = Lanes<double, ThisArch>;
CLOTHSIM_INLINE Doubles doubles(const float* p) { return Doubles(double(p[0]), double(p[1])); }
CLOTHSIM_INLINE void put(float* p, const Doubles& a) {
    for (int i = 0; i < 2; ++i) p[i] = float(a.get(std::size_t(i)));
    asm volatile("" ::: "memory");
}
#else
using Doubles = Lanes<double, ThisArch>;
CLOTHSIM_INLINE Doubles doubles(const float* p) {
    return Doubles(_mm_cvtps_pd(_mm_castsi128_ps(_mm_loadu_si64(p))));
}
CLOTHSIM_INLINE void put(float* p, const Doubles& a) {
    _mm_storel_epi64(reinterpret_cast<__m128i*>(p), _mm_castps_si128(_mm_cvtpd_ps(a)));
}
#endif
CLOTHSIM_INLINE Doubles doubles(const double* p) { return Doubles::load_unaligned(p); }
CLOTHSIM_INLINE void put(double* p, const Doubles& a) { a.store_unaligned(p); }
inline constexpr int square_size = int(Doubles::size);

// A square: element i of lane l is at outside[l * stride + i], and in the layout at inside[place[i] + l]. The
// rounding of a number to single is not finite where the number has become so.
template <class Real, class Outside>
CLOTHSIM_INLINE void put_square(const Outside* outside, std::ptrdiff_t stride, const double* shift,
                                Real* inside, std::ptrdiff_t compensation, const std::ptrdiff_t* place,
                                Doubles::batch_bool_type& finite) {
    Doubles row[square_size];
    for (int l = 0; l < square_size; ++l) row[l] = doubles(outside + l * stride);
    xsimd::transpose(row, row + square_size);
    for (int i = 0; i < square_size; ++i) {
        Real* const to = inside + place[i];
        Doubles value = row[i];
        if constexpr (sizeof(Real) == 4) {
            const Doubles shifted = value + Doubles(shift[i]);
            put(to, shifted);
            value = shifted - doubles(to);
            put(to + compensation, value);
        } else {
            put(to, value);
        }
        finite = finite & (xsimd::abs(value) <= Doubles(std::numeric_limits<double>::max()));
    }
}
template <bool compensated, class Real, class Outside>
CLOTHSIM_INLINE void take_square(const Real* inside, std::ptrdiff_t compensation, const std::ptrdiff_t* place,
                                 const double* shift, Outside* outside, std::ptrdiff_t stride) {
    Doubles row[square_size];
    for (int i = 0; i < square_size; ++i) {
        const Real* const from = inside + place[i];
        row[i] = doubles(from);
        if constexpr (compensated) row[i] = row[i] + doubles(from + compensation) + Doubles(shift[i]);
    }
    xsimd::transpose(row, row + square_size);
    for (int l = 0; l < square_size; ++l) put(outside + l * stride, row[l]);
}

// `square(lane, element)` over the lanes that have all their columns, `one(lane, element)` over the elements
// of the others. A lane's columns stand square_size by square_size in the row, 3 vectors elements of it.
template <class Square, class One>
CLOTHSIM_INLINE void each_square(const TransposedRow& row, const Square& square, const One& one) {
    const int elements = 3 * row.vectors;
    const int whole = std::min(row.columns / row.vectors, row.lanes) / square_size * square_size;
    for (int lane = 0; lane < whole; lane += square_size) {
        int element = 0;
        for (; element + square_size <= elements; element += square_size) square(lane, element);
        if (element < elements) square(lane, elements - square_size);  // some a second time
    }
    for (int lane = whole; lane < row.lanes; ++lane) {
        const int columns = std::clamp(row.columns - lane * row.vectors, 0, row.vectors);
        for (int element = 0; element < 3 * columns; ++element) one(lane, element);
    }
}

template <class Real, class Outside>
bool put_transposed(const Outside* row, const RowShift& shift, Real* records, std::ptrdiff_t compensation,
                    const TransposedRow& given) {
    const TransposedRow transposed = given;  // nothing that is written can be part of it
    const std::ptrdiff_t width = 3 * transposed.vectors;
    auto squares_finite = Doubles(0.0) == Doubles(0.0);
    bool finite = true;
    each_square(
        transposed,
        [&](int lane, int element) __attribute__((always_inline)) {
            put_square(row + lane * width + element, width, shift.of + element % 3, records + lane,
                       compensation, transposed.place + element, squares_finite);
        },
        [&](int lane, int element) __attribute__((always_inline)) {
            finite &= put_one(row[lane * width + element], shift.of[element % 3],
                              records + transposed.place[element] + lane, compensation);
        });
    return finite & xsimd::all(squares_finite);
}

template <bool compensated, class Real, class Outside>
void take_transposed(const Real* records, std::ptrdiff_t compensation, const TransposedRow& transposed,
                     const RowShift& shift, Outside* row) {
    if constexpr (sizeof(Real) == 4 && !compensated)
        if (compensation != 0) return take_transposed<true>(records, compensation, transposed, shift, row);
    const std::ptrdiff_t width = 3 * transposed.vectors;
    each_square(
        transposed,
        [&](int lane, int element) __attribute__((always_inline)) {
            take_square<compensated>(records + lane, compensation, transposed.place + element,
                                     shift.of + element % 3, row + lane * width + element, width);
        },
        [&](int lane, int element) __attribute__((always_inline)) {
            take_one<compensated>(records + transposed.place[element] + lane, compensation,
                                  shift.of[element % 3], row + lane * width + element);
        });
}

template <class Real>
constexpr StateRowKernels<Real> state_row_kernels() {
    return {{&put_transposed<Real, float>, &take_transposed<false, Real, float>},
            {&put_transposed<Real, double>, &take_transposed<false, Real, double>}};
}

}  // namespace
}  // namespace clothsim
