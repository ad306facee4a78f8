// Copies rows of a state to arrays of points, and forces from such arrays. Nothing is fused.
#pragma once

#include "kernels/row_arguments.hpp"
#include "lanes/lanes.hpp"

namespace clothsim {
namespace {

// Four lanes are read or written at once.
inline constexpr int group = 4;
using Four = double __attribute__((vector_size(group * sizeof(double))));
// The vector lies in memory, at any place.
template <class Real>
struct FourOf;
template <>
struct FourOf<double> {
    typedef double type __attribute__((vector_size(32), aligned(8), may_alias));
};
template <>
struct FourOf<float> {
    typedef float type __attribute__((vector_size(16), aligned(4), may_alias));
};

template <class Real>
CLOTHSIM_INLINE void load(const Real* from, Four& values) {
    using There = typename FourOf<Real>::type;
    values = __builtin_convertvector(*reinterpret_cast<const There*>(from), Four);
}
template <class Real>
CLOTHSIM_INLINE void store(Real* to, const Four& values) {
    using There = typename FourOf<Real>::type;
    *reinterpret_cast<There*>(to) = __builtin_convertvector(values, There);
}
CLOTHSIM_INLINE void store_point(double* to, const Four& point, bool last) {
    if (!last) return store(to, point);
    to[0] = point[0];
    to[1] = point[1];
    to[2] = point[2];
}

// Stores points of four lanes. A point is stored with a number more, which lies in the next one:
// that is written later, but for the last vector.
template <class Real>
CLOTHSIM_INLINE void put_points(const Real* from, std::ptrdiff_t component, const double* origin,
                                std::ptrdiff_t lane, bool last, double* to) {
    Four x, y, z;
    load(from, x);
    load(from + component, y);
    load(from + 2 * component, z);
    if (origin) {
        x += origin[0];
        y += origin[1];
        z += origin[2];
    }
    const Four even = __builtin_shufflevector(x, y, 0, 4, 2, 6);
    const Four odd = __builtin_shufflevector(x, y, 1, 5, 3, 7);
    store_point(to, __builtin_shufflevector(even, z, 0, 1, 4, 5), last);
    store_point(to + lane, __builtin_shufflevector(odd, z, 0, 1, 5, 6), last);
    store_point(to + 2 * lane, __builtin_shufflevector(even, z, 2, 3, 6, 7), last);
    store_point(to + 3 * lane, __builtin_shufflevector(odd, z, 2, 3, 7, 7), last);
}

template <class Real>
void read_points(const Real* row, const RowShape& shape, const double* origin, double* x,
                 double* v) {
    const std::ptrdiff_t component = shape.component;
    const std::ptrdiff_t lane = 3 * std::ptrdiff_t(shape.vectors);
    for (int l = 0; l < shape.lanes; l += group)
        for (int k = 0; k < shape.vectors; ++k) {
            const Real* from = row + k * shape.vector + l;
            const int column = l * shape.vectors + k;
            const std::ptrdiff_t at = 3 * std::ptrdiff_t(column);
            if (l + group <= shape.lanes &&
                column + (group - 1) * shape.vectors + 1 < shape.columns) {
                const bool last = k + 1 == shape.vectors;
                put_points(from, component, origin, lane, last, x + at);
                put_points(from + 3 * component, component, nullptr, lane, last, v + at);
                continue;
            }
            for (int i = 0; i < group && l + i < shape.lanes; ++i, ++from)
                for (int j = 0; j < 3 && column + i * shape.vectors < shape.columns; ++j) {
                    x[at + i * lane + j] = double(from[j * component]) + origin[j];
                    v[at + i * lane + j] = double(from[(3 + j) * component]);
                }
        }
}

template <class Real>
void write_points(const double* values, const double* scale, const double* plus,
                  const RowShape& shape, Real* row) {
    const std::ptrdiff_t component = shape.component;
    const std::ptrdiff_t lane = 3 * std::ptrdiff_t(shape.vectors);
    for (int l = 0; l < shape.lanes; l += group)
        for (int k = 0; k < shape.vectors; ++k) {
            Real* to = row + k * shape.vector + l;
            const int column = l * shape.vectors + k;
            const std::ptrdiff_t at = 3 * std::ptrdiff_t(column);
            if (l + group <= shape.lanes &&
                column + (group - 1) * shape.vectors + 1 < shape.columns) {
                Four points[group];
                for (int i = 0; i < group; ++i) {
                    load(values + at + i * lane, points[i]);
                    points[i] *= scale[column + i * shape.vectors];
                    if (!plus) continue;
                    Four more;
                    load(plus + at + i * lane, more);
                    points[i] += more;
                }
                const Four a = __builtin_shufflevector(points[0], points[1], 0, 4, 2, 6);
                const Four b = __builtin_shufflevector(points[2], points[3], 0, 4, 2, 6);
                const Four c = __builtin_shufflevector(points[0], points[1], 1, 5, 3, 7);
                const Four d = __builtin_shufflevector(points[2], points[3], 1, 5, 3, 7);
                store(to, __builtin_shufflevector(a, b, 0, 1, 4, 5));
                store(to + component, __builtin_shufflevector(c, d, 0, 1, 4, 5));
                store(to + 2 * component, __builtin_shufflevector(a, b, 2, 3, 6, 7));
                continue;
            }
            for (int i = 0; i < group && l + i < shape.lanes; ++i, ++to)
                for (int j = 0; j < 3 && column + i * shape.vectors < shape.columns; ++j) {
                    const std::ptrdiff_t from = at + i * lane + j;
                    const double scaled = values[from] * scale[column + i * shape.vectors];
                    to[j * component] = Real(plus ? scaled + plus[from] : scaled);
                }
        }
}

}  // namespace
}  // namespace clothsim
