#include "simulation/row_copies.hpp"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <emmintrin.h>
#include <limits>
#include <xmmintrin.h>

#include "simulation/versions.hpp"

#define CLOTHSIM_INLINE inline __attribute__((always_inline))

namespace clothsim {
namespace {

template <class In, class Real>
CLOTHSIM_INLINE void split_any(const In* x, const double* shift, Real* __restrict high, Real* __restrict low, int count) {
    if (!low) {
        for (int i = 0; i < count; ++i) high[i] = Real(double(x[i]) + shift[i]);
        return;
    }
    for (int i = 0; i < count; ++i) {
        const double value = double(x[i]) + shift[i];
        high[i] = Real(value);
        low[i] = Real(value - double(Real(value)));
    }
}

template <class Real, class Out>
CLOTHSIM_INLINE void join_any(const Real* high, const Real* low, const double* shift, Out* __restrict x, int count) {
    if (!low) {
        for (int i = 0; i < count; ++i) x[i] = Out(double(high[i]) + shift[i]);
        return;
    }
    for (int i = 0; i < count; ++i) x[i] = Out(double(high[i]) + double(low[i]) + shift[i]);
}

// Squares of as many rows and columns as a vector has elements. The least instruction set has them, and memory
// is what more would wait for.
template <class Real>
struct Square;

template <>
struct Square<float> {
    static constexpr int size = 4;
    __m128 row[size];
    CLOTHSIM_INLINE void load(int i, const float* p) { row[i] = _mm_loadu_ps(p); }
    CLOTHSIM_INLINE void store(int i, float* p) const { _mm_storeu_ps(p, row[i]); }
    CLOTHSIM_INLINE void transpose() { _MM_TRANSPOSE4_PS(row[0], row[1], row[2], row[3]); }
};

template <>
struct Square<double> {
    static constexpr int size = 2;
    __m128d row[size];
    CLOTHSIM_INLINE void load(int i, const double* p) { row[i] = _mm_loadu_pd(p); }
    CLOTHSIM_INLINE void store(int i, double* p) const { _mm_storeu_pd(p, row[i]); }
    CLOTHSIM_INLINE void transpose() {
        const __m128d first = row[0];
        row[0] = _mm_unpacklo_pd(first, row[1]);
        row[1] = _mm_unpackhi_pd(first, row[1]);
    }
};

// `square(lane, element)` over all squares of the lanes that have all their columns, `one(lane, element)` over the
// elements of the others. A lane's columns stand side by side in the row, 3 vectors elements of it.
template <int size, class OfSquare, class OfOne>
CLOTHSIM_INLINE void for_each_lane(const LiftedRow& lifted, OfSquare square, OfOne one) {
    const int elements = 3 * lifted.vectors;
    const int whole = std::min(lifted.columns / lifted.vectors, lifted.lanes) / size * size;
    for (int lane = 0; lane < whole; lane += size) {
        int element = 0;
        for (; element + size <= elements; element += size) square(lane, element);
        if (element < elements) square(lane, elements - size);  // some a second time
    }
    for (int lane = whole; lane < lifted.lanes; ++lane) {
        const int columns = std::clamp(lifted.columns - lane * lifted.vectors, 0, lifted.vectors);
        for (int element = 0; element < 3 * columns; ++element) one(lane, element);
    }
}

template <class In>
CLOTHSIM_INLINE void extent_any(const In* x, std::ptrdiff_t points, double (&low)[3], double (&high)[3]) {
    constexpr int block = 12;  // as many elements as make whole points and whole vectors
    double least[block], most[block];
    std::fill_n(least, block, std::numeric_limits<double>::infinity());
    std::fill_n(most, block, -std::numeric_limits<double>::infinity());
    const std::ptrdiff_t count = 3 * points;
    std::ptrdiff_t i = 0;
    for (; i + block <= count; i += block)
        for (int k = 0; k < block; ++k) {
            const double value = double(x[i + k]);
            least[k] = value < least[k] ? value : least[k];
            most[k] = value > most[k] ? value : most[k];
        }
    for (int k = 0; i + k < count; ++k) {
        least[k] = std::min(least[k], double(x[i + k]));
        most[k] = std::max(most[k], double(x[i + k]));
    }
    for (int k = 0; k < 3; ++k) {
        low[k] = std::min(std::min(least[k], least[k + 3]), std::min(least[k + 6], least[k + 9]));
        high[k] = std::max(std::max(most[k], most[k + 3]), std::max(most[k + 6], most[k + 9]));
    }
}

}  // namespace

#define CLOTHSIM_SPLIT_AND_JOIN(Outside, Real)                                                                           \
    namespace {                                                                                                          \
    CLOTHSIM_VERSIONS void split_versions(const Outside* x, const double* shift, Real* high, Real* low, int count) {     \
        split_any(x, shift, high, low, count);                                                                           \
    }                                                                                                                    \
    CLOTHSIM_VERSIONS void join_versions(const Real* high, const Real* low, const double* shift, Outside* x, int count) { \
        join_any(high, low, shift, x, count);                                                                            \
    }                                                                                                                    \
    }                                                                                                                    \
    void split(const Outside* x, const double* shift, Real* high, Real* low, int count) {                                \
        split_versions(x, shift, high, low, count);                                                                      \
    }                                                                                                                    \
    void join(const Real* high, const Real* low, const double* shift, Outside* x, int count) {                           \
        join_versions(high, low, shift, x, count);                                                                       \
    }
CLOTHSIM_SPLIT_AND_JOIN(double, double)
CLOTHSIM_SPLIT_AND_JOIN(float, double)
CLOTHSIM_SPLIT_AND_JOIN(double, float)
CLOTHSIM_SPLIT_AND_JOIN(float, float)
#undef CLOTHSIM_SPLIT_AND_JOIN

#define CLOTHSIM_EXTENT(Real)                                                                                            \
    namespace {                                                                                                          \
    CLOTHSIM_VERSIONS void extent_versions(const Real* x, std::ptrdiff_t points, double (&low)[3], double (&high)[3]) {  \
        extent_any(x, points, low, high);                                                                                \
    }                                                                                                                    \
    }                                                                                                                    \
    void extent(const Real* x, std::ptrdiff_t points, double (&low)[3], double (&high)[3]) {                             \
        extent_versions(x, points, low, high);                                                                           \
    }
CLOTHSIM_EXTENT(float)
CLOTHSIM_EXTENT(double)
#undef CLOTHSIM_EXTENT

template <class Real>
void to_planes(const Real* row, Real* planes, std::ptrdiff_t plane, int columns) {
    Real* __restrict const x = planes;
    Real* __restrict const y = planes + plane;
    Real* __restrict const z = planes + 2 * plane;
    for (int c = 0; c < columns; ++c) {
        x[c] = row[3 * c];
        y[c] = row[3 * c + 1];
        z[c] = row[3 * c + 2];
    }
}

template <class Real>
void from_planes(const Real* planes, std::ptrdiff_t plane, Real* __restrict row, int columns) {
    for (int c = 0; c < columns; ++c) {
        row[3 * c] = planes[c];
        row[3 * c + 1] = planes[c + plane];
        row[3 * c + 2] = planes[c + 2 * plane];
    }
}

template <class Real>
void to_lanes(const Real* row, Real* records, const LiftedRow& lifted) {
    constexpr int size = Square<Real>::size;
    const std::ptrdiff_t width = 3 * lifted.vectors;
    const std::ptrdiff_t* const place = lifted.place;
    for_each_lane<size>(
        lifted,
        [&](int lane, int element) {
            Square<Real> s;
            for (int i = 0; i < size; ++i) s.load(i, row + (lane + i) * width + element);
            s.transpose();
            for (int i = 0; i < size; ++i) s.store(i, records + place[element + i] + lane);
        },
        [&](int lane, int element) { records[place[element] + lane] = row[lane * width + element]; });
}

template <class Real>
void from_lanes(const Real* records, Real* row, const LiftedRow& lifted) {
    constexpr int size = Square<Real>::size;
    const std::ptrdiff_t width = 3 * lifted.vectors;
    const std::ptrdiff_t* const place = lifted.place;
    for_each_lane<size>(
        lifted,
        [&](int lane, int element) {
            Square<Real> s;
            for (int i = 0; i < size; ++i) s.load(i, records + place[element + i] + lane);
            s.transpose();
            for (int i = 0; i < size; ++i) s.store(i, row + (lane + i) * width + element);
        },
        [&](int lane, int element) { row[lane * width + element] = records[place[element] + lane]; });
}

void copy_past_caches(const void* from, void* to, std::size_t bytes) {
    constexpr std::size_t size = sizeof(__m128i);
    const char* next = static_cast<const char*>(from);
    char* place = static_cast<char*>(to);
    const auto copy = [&](std::size_t count) {
        std::memcpy(place, next, count);
        next += count, place += count, bytes -= count;
    };
    copy(std::min(bytes, -reinterpret_cast<std::uintptr_t>(place) % size));
    for (; bytes >= size; next += size, place += size, bytes -= size)
        _mm_stream_si128(reinterpret_cast<__m128i*>(place), _mm_loadu_si128(reinterpret_cast<const __m128i*>(next)));
    copy(bytes);
    _mm_sfence();
}

template void to_planes(const float*, float*, std::ptrdiff_t, int);
template void to_planes(const double*, double*, std::ptrdiff_t, int);
template void from_planes(const float*, std::ptrdiff_t, float*, int);
template void from_planes(const double*, std::ptrdiff_t, double*, int);
template void to_lanes(const float*, float*, const LiftedRow&);
template void to_lanes(const double*, double*, const LiftedRow&);
template void from_lanes(const float*, float*, const LiftedRow&);
template void from_lanes(const double*, double*, const LiftedRow&);

}  // namespace clothsim
