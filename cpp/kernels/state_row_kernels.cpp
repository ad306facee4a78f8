// CMake compiles this file for each instruction set.
#include "kernels/state_row_kernels.hpp"

#if defined(__x86_64__)
#include <immintrin.h>
#endif
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>

#include "kernels/this_instruction_set.hpp"

namespace clothsim {
namespace {

using std::ptrdiff_t;

// Four doubles, in two registers where there are no longer ones.
#if !defined(__x86_64__)
// Vectors of the compiler's own, for every processor that g++ and clang know.
using Four [[gnu::vector_size(32)]] = double;
using FourSingles [[gnu::vector_size(16)]] = float;
template <class V, class T>
CLOTHSIM_INLINE V loaded(const T* p, std::size_t bytes = sizeof(V)) {
    V a{};
    std::memcpy(&a, p, bytes);
    return a;
}
CLOTHSIM_INLINE Four four(const double* p) { return loaded<Four>(p); }
CLOTHSIM_INLINE Four four(FourSingles a) { return __builtin_convertvector(a, Four); }
CLOTHSIM_INLINE Four four(const float* p) { return four(loaded<FourSingles>(p)); }
CLOTHSIM_INLINE Four four_of(double a) { return Four{a, a, a, a}; }
CLOTHSIM_INLINE Four two(const double* p) { return loaded<Four>(p, 16); }
CLOTHSIM_INLINE Four least(Four a, Four b) { return a < b ? a : b; }
CLOTHSIM_INLINE Four most(Four a, Four b) { return a > b ? a : b; }
CLOTHSIM_INLINE FourSingles rounded(Four a) { return __builtin_convertvector(a, FourSingles); }
CLOTHSIM_INLINE void put(double* p, Four a) { std::memcpy(p, &a, sizeof a); }
CLOTHSIM_INLINE void put(float* p, FourSingles a) { std::memcpy(p, &a, sizeof a); }
CLOTHSIM_INLINE void put_two(double* p, Four a) { std::memcpy(p, &a, 16); }
CLOTHSIM_INLINE Four sum(Four a, Four b) { return a + b; }
CLOTHSIM_INLINE Four difference(Four a, Four b) { return a - b; }
template <class V>
CLOTHSIM_INLINE V times_zero(V a) {
    return a * V{};
}
// Zeros of either sign and what is no number: their sum is a zero or no number, as the bits of both are.
template <class V>
CLOTHSIM_INLINE V bits_of_both(V a, V b) {
    return a + b;
}
template <class V>
CLOTHSIM_INLINE bool all_numbers(V a) {
    const auto equal = a == a;
    bool all = true;
    for (std::size_t i = 0; i < sizeof equal / sizeof equal[0]; ++i) all &= equal[i] != 0;
    return all;
}
CLOTHSIM_INLINE void transpose(Four (&r)[4]) {
    const Four a = r[0], b = r[1], c = r[2], d = r[3];
    for (int i = 0; i < 4; ++i) r[i] = Four{a[i], b[i], c[i], d[i]};
}
#elif defined(__AVX2__)
using FourSingles = __m128;
using Four = __m256d;
CLOTHSIM_INLINE Four four(const double* p) { return _mm256_loadu_pd(p); }
CLOTHSIM_INLINE Four four(const float* p) { return _mm256_cvtps_pd(_mm_loadu_ps(p)); }
CLOTHSIM_INLINE Four four(__m128 a) { return _mm256_cvtps_pd(a); }
CLOTHSIM_INLINE Four four_of(double a) { return _mm256_set1_pd(a); }
CLOTHSIM_INLINE Four two(const double* p) { return _mm256_castpd128_pd256(_mm_loadu_pd(p)); }
CLOTHSIM_INLINE Four least(Four a, Four b) { return _mm256_min_pd(a, b); }  // b where a is no number
CLOTHSIM_INLINE Four most(Four a, Four b) { return _mm256_max_pd(a, b); }
CLOTHSIM_INLINE __m128 rounded(Four a) { return _mm256_cvtpd_ps(a); }
CLOTHSIM_INLINE void put(double* p, Four a) { _mm256_storeu_pd(p, a); }
CLOTHSIM_INLINE void put_two(double* p, Four a) { _mm_storeu_pd(p, _mm256_castpd256_pd128(a)); }
CLOTHSIM_INLINE Four sum(Four a, Four b) { return _mm256_add_pd(a, b); }
CLOTHSIM_INLINE Four difference(Four a, Four b) { return _mm256_sub_pd(a, b); }
CLOTHSIM_INLINE Four times_zero(Four a) { return _mm256_mul_pd(a, _mm256_setzero_pd()); }
CLOTHSIM_INLINE Four bits_of_both(Four a, Four b) { return _mm256_or_pd(a, b); }
CLOTHSIM_INLINE bool all_numbers(Four a) {
    return _mm256_movemask_pd(_mm256_cmp_pd(a, a, _CMP_UNORD_Q)) == 0;
}
CLOTHSIM_INLINE void transpose(Four (&r)[4]) {
    const Four a = _mm256_unpacklo_pd(r[0], r[1]), b = _mm256_unpackhi_pd(r[0], r[1]);
    const Four c = _mm256_unpacklo_pd(r[2], r[3]), d = _mm256_unpackhi_pd(r[2], r[3]);
    r[0] = _mm256_permute2f128_pd(a, c, 0x20);
    r[1] = _mm256_permute2f128_pd(b, d, 0x20);
    r[2] = _mm256_permute2f128_pd(a, c, 0x31);
    r[3] = _mm256_permute2f128_pd(b, d, 0x31);
}
#else
using FourSingles = __m128;
struct Four {
    __m128d low, high;
};
CLOTHSIM_INLINE Four four(const double* p) { return {_mm_loadu_pd(p), _mm_loadu_pd(p + 2)}; }
CLOTHSIM_INLINE Four four(__m128 a) { return {_mm_cvtps_pd(a), _mm_cvtps_pd(_mm_movehl_ps(a, a))}; }
CLOTHSIM_INLINE Four four(const float* p) { return four(_mm_loadu_ps(p)); }
CLOTHSIM_INLINE Four four_of(double a) { return {_mm_set1_pd(a), _mm_set1_pd(a)}; }
CLOTHSIM_INLINE Four two(const double* p) { return {_mm_loadu_pd(p), _mm_setzero_pd()}; }
CLOTHSIM_INLINE Four least(Four a, Four b) { return {_mm_min_pd(a.low, b.low), _mm_min_pd(a.high, b.high)}; }
CLOTHSIM_INLINE Four most(Four a, Four b) { return {_mm_max_pd(a.low, b.low), _mm_max_pd(a.high, b.high)}; }
CLOTHSIM_INLINE __m128 rounded(Four a) { return _mm_movelh_ps(_mm_cvtpd_ps(a.low), _mm_cvtpd_ps(a.high)); }
CLOTHSIM_INLINE void put(double* p, Four a) {
    _mm_storeu_pd(p, a.low);
    _mm_storeu_pd(p + 2, a.high);
}
CLOTHSIM_INLINE void put_two(double* p, Four a) { _mm_storeu_pd(p, a.low); }
CLOTHSIM_INLINE Four sum(Four a, Four b) { return {_mm_add_pd(a.low, b.low), _mm_add_pd(a.high, b.high)}; }
CLOTHSIM_INLINE Four difference(Four a, Four b) {
    return {_mm_sub_pd(a.low, b.low), _mm_sub_pd(a.high, b.high)};
}
CLOTHSIM_INLINE Four times_zero(Four a) {
    return {_mm_mul_pd(a.low, _mm_setzero_pd()), _mm_mul_pd(a.high, _mm_setzero_pd())};
}
CLOTHSIM_INLINE Four bits_of_both(Four a, Four b) {
    return {_mm_or_pd(a.low, b.low), _mm_or_pd(a.high, b.high)};
}
CLOTHSIM_INLINE bool all_numbers(Four a) {
    return _mm_movemask_pd(_mm_or_pd(_mm_cmpunord_pd(a.low, a.low), _mm_cmpunord_pd(a.high, a.high))) == 0;
}
CLOTHSIM_INLINE void transpose(Four (&r)[4]) {
    const Four a = r[0], b = r[1], c = r[2], d = r[3];
    r[0] = {_mm_unpacklo_pd(a.low, b.low), _mm_unpacklo_pd(c.low, d.low)};
    r[1] = {_mm_unpackhi_pd(a.low, b.low), _mm_unpackhi_pd(c.low, d.low)};
    r[2] = {_mm_unpacklo_pd(a.high, b.high), _mm_unpacklo_pd(c.high, d.high)};
    r[3] = {_mm_unpackhi_pd(a.high, b.high), _mm_unpackhi_pd(c.high, d.high)};
}
#endif
#if defined(__x86_64__)
CLOTHSIM_INLINE void put(float* p, FourSingles a) { _mm_storeu_ps(p, a); }
CLOTHSIM_INLINE bool all_numbers(__m128 a) { return _mm_movemask_ps(_mm_cmpunord_ps(a, a)) == 0; }
#endif
CLOTHSIM_INLINE void put(float* p, Four a) { put(p, rounded(a)); }

// Whether all numbers are finite in the layout. Of four at a time, so that none waits for the last.
template <class Real>
struct NotFinite {
    Four bits[4] = {};
    // Finite ones times 0 are 0.
    CLOTHSIM_INLINE void note(int i, Four a) { bits[i] = bits_of_both(bits[i], times_zero(a)); }
    CLOTHSIM_INLINE bool none() const {
        return all_numbers(bits_of_both(bits_of_both(bits[0], bits[1]), bits_of_both(bits[2], bits[3])));
    }
};
template <>
struct NotFinite<float> {
    FourSingles sum[4] = {};
    // The rounding of a number is infinite or NaN where the number has become so, else so small that the sum
    // is finite.
    CLOTHSIM_INLINE void note(int i, FourSingles lost) { sum[i] = sum[i] + lost; }
    CLOTHSIM_INLINE bool none() const {
        return all_numbers(((sum[0] + sum[1]) + (sum[2] + sum[3])) * FourSingles{});
    }
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
            const Four value = shifted ? sum(row[i], four_of(shift[i])) : row[i];
            const FourSingles high = rounded(value), lost = rounded(difference(value, four(high)));
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
        if constexpr (compensated) row[i] = sum(row[i], four(from + compensation));
        if constexpr (shifted) row[i] = sum(row[i], four_of(shift[i]));
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
