// What row_arguments.hpp declares. Nothing is fused, and sums do not depend on the number of lanes:
// every instruction set gives the same bits.
#pragma once

#include <limits>

#include "kernels/points_impl.hpp"
#include "kernels/row_arguments.hpp"
#include "lanes/vector3.hpp"

namespace clothsim {
namespace {

template <class V, class Real, class Visit>
CLOTHSIM_INLINE void each_vector(const ComponentRows<Real>& points, const Visit& visit) {
    for (int r = 0; r < points.rows; ++r)
        for (int k = 0; k < points.vectors; ++k)
            visit(V::load_unaligned(points.first + r * points.row + k * points.vector));
}

template <class Arch, class Real>
std::uint64_t points_below(const Real* points, std::ptrdiff_t component,
                           const SurfaceLevel<Real>& level) {
    using V = Lanes<Real, Arch>;
    V f(Real(0));
    each<3>([&](auto k) __attribute__((always_inline)) {
        const V d = V::load_unaligned(points + k * component) - V(level.place[k]);
        const V n(level.normal[k]);
        f = f + d * (n + n + V(level.curvature) * d);
    });
    return (f < V(level.below)).mask();
}

template <class Arch, class Real>
Extent<Real> component_extent(const ComponentRows<Real>& points) {
    using V = Lanes<Real, Arch>;
    V low(std::numeric_limits<Real>::max());
    V high(std::numeric_limits<Real>::lowest());
    each_vector<V>(points, [&](const V& x) __attribute__((always_inline)) {
        low = xsimd::select(x < low, x, low);
        high = xsimd::select(x > high, x, high);
    });
    return {xsimd::reduce_min(low), xsimd::reduce_max(high)};
}

template <class Arch, class Real>
bool all_finite(const Real* p, const Spans& spans) {
    using V = Lanes<Real, Arch>;
    const V largest(std::numeric_limits<Real>::max());
    auto good = largest == largest;
    for (std::ptrdiff_t b = 0; b < spans.count; ++b)
        for (std::ptrdiff_t i = 0; i < spans.size; i += std::ptrdiff_t(V::size))
            good = good & (xsimd::abs(V::load_unaligned(p + b * spans.stride + i)) <= largest);
    return xsimd::all(good);
}

// Calls `compute(where in the state, where in accelerations, dx, dv)` and then `work(row, where in
// the state, dx, dv)` for every chunk of `count` vectors of the rows, which stay in registers.
template <class V, int count, class Compute, class Work>
CLOTHSIM_INLINE void each_chunk(const FieldLayout& f, int begin, int end, const Compute& compute,
                                const Work& work) {
    constexpr int W = int(V::size);
    for (int r = begin; r < end; ++r)
        for (int k = 0; k < f.runs; ++k)
            for (int o = 0; o < f.length; o += count * W) {
                const std::ptrdiff_t state = f.origin + r * f.row + k * f.run + o;
                V dx[count], dv[count];
                compute(state,
                        f.acceleration_origin + r * f.acceleration_row + k * f.acceleration_run + o,
                        dx, dv);
                work(r, state, dx, dv);
            }
}

// Computes the combination; `from` gives the velocities of the drift.
template <class V, int count, class Real>
CLOTHSIM_INLINE auto combination(const FieldLayout& f, const Real* from,
                                 const Combination<Real>& sum) {
    return [&f, from, &sum](std::ptrdiff_t state, std::ptrdiff_t at, V* dx, V* dv)
               __attribute__((always_inline)) {
                   constexpr int W = int(V::size);
                   for (int i = 0; i < count; ++i) {
                       dx[i] = V(sum.drift) * V::load_unaligned(from + state + f.velocity + i * W);
                       dv[i] = V(Real(0)) * dx[i];
                   }
                   for (int l = 0; l < sum.count; ++l) {
                       const V x(sum.x[std::size_t(l)]);
                       const V v(sum.v[std::size_t(l)]);
                       for (int i = 0; i < count; ++i) {
                           const V a = V::load_unaligned(sum.a[std::size_t(l)] + at + i * W);
                           dx[i] = dx[i] + x * a;
                           dv[i] = dv[i] + v * a;
                       }
                   }
               };
}

// Computes the sum of increments; `from` gives the velocities.
template <class V, int count, class Real>
CLOTHSIM_INLINE auto increment_sum(const FieldLayout& f, const Real* from, const Real* last,
                                   const Real* before, const ChebyshevSum<Real>& sum) {
    return [&f, from, last, before, &sum](std::ptrdiff_t state, std::ptrdiff_t at, V* dx, V* dv)
               __attribute__((always_inline)) {
                   constexpr int W = int(V::size);
                   for (int i = 0; i < count; ++i) {
                       const std::ptrdiff_t x = state + i * W;
                       const std::ptrdiff_t v = x + f.velocity;
                       const std::ptrdiff_t a = at + i * W;
                       const V velocity = V::load_unaligned(from + v);
                       dx[i] = V(sum.first_slope) * velocity;
                       dv[i] = V(sum.first_slope) * V::load_unaligned(sum.a_first + a);
                       if (sum.last != 0) {
                           const V speed = V::load_unaligned(last + v);
                           dx[i] = dx[i] + V(sum.slope) * (velocity + speed);
                           dv[i] = dv[i] + V(sum.slope) * V::load_unaligned(sum.a_last + a);
                           dx[i] = dx[i] + V(sum.last) * V::load_unaligned(last + x);
                           dv[i] = dv[i] + V(sum.last) * speed;
                       }
                       if (sum.before != 0) {
                           dx[i] = dx[i] + V(sum.before) * V::load_unaligned(before + x);
                           dv[i] = dv[i] + V(sum.before) * V::load_unaligned(before + v);
                       }
                       dx[i] = V(sum.scale_x) * dx[i];
                       dv[i] = V(sum.scale_v) * dv[i];
                   }
               };
}

// Calls `work` with the number of vectors that divides the runs of a field: the three components of
// the edge kernel's vectors or, in the gather kernel, 64 bytes.
template <class V, class Work>
CLOTHSIM_INLINE void in_chunks(const FieldLayout& f, const Work& work) {
    constexpr int W = int(V::size);
    constexpr int in_line = 64 / int(sizeof(V));
    if (f.length == 3 * W) work(std::integral_constant<int, 3>{});
    else work(std::integral_constant<int, in_line>{});
}

// `to` becomes `from` plus an increment.
template <class V, class Real>
CLOTHSIM_INLINE void add_increment(const FieldLayout& f, const Real* from, Real* to,
                                   std::ptrdiff_t at, const V& increment) {
    const V old = V::load_unaligned(from + at);
    if (f.compensation == 0) return (old + increment).store_unaligned(to + at);
    const V all = increment + V::load_unaligned(from + at + f.compensation);
    const V next = old + all;
    (all - (next - old)).store_unaligned(to + at + f.compensation);
    next.store_unaligned(to + at);
}

template <class Arch, class Real>
void advance_rows(const FieldLayout& f, int begin, int end, const Real* from, Real* to,
                  const Combination<Real>& sum) {
    using V = Lanes<Real, Arch>;
    constexpr int W = int(V::size);
    in_chunks<V>(f, [&](auto count) __attribute__((always_inline)) {
        each_chunk<V, count>(f, begin, end, combination<V, count>(f, from, sum),
                             [&](int, std::ptrdiff_t at, const V* dx, const V* dv)
                                 __attribute__((always_inline)) {
                                     for (int i = 0; i < count; ++i) {
                                         add_increment(f, from, to, at + i * W, dx[i]);
                                         add_increment(f, from, to, at + f.velocity + i * W, dv[i]);
                                     }
                                 });
    });
}

template <class Arch, class Real>
void chebyshev_rows(const FieldLayout& f, int begin, int end, const Real* from, const Real* last,
                    Real* before, Real* to, const ChebyshevSum<Real>& sum) {
    using V = Lanes<Real, Arch>;
    constexpr int W = int(V::size);
    in_chunks<V>(f, [&](auto count) __attribute__((always_inline)) {
        each_chunk<V, count>(
            f, begin, end, increment_sum<V, count, Real>(f, from, last, before, sum),
            [&](int, std::ptrdiff_t at, const V* dx, const V* dv) __attribute__((always_inline)) {
                for (int i = 0; i < count; ++i) {
                    const std::ptrdiff_t x = at + i * W;
                    const std::ptrdiff_t v = x + f.velocity;
                    dx[i].store_unaligned(before + x);
                    dv[i].store_unaligned(before + v);
                    add_increment(f, from, to, x, dx[i]);
                    add_increment(f, from, to, v, dv[i]);
                }
            });
    });
}

// Sums the squares, row by row, of what `compute_of(count)` gives.
template <class V, class ComputeOf>
CLOTHSIM_INLINE void square_chunks(const FieldLayout& f, int begin, int end, RowSquares* rows,
                                   const ComputeOf& compute_of) {
    constexpr int W = int(V::size);
    in_chunks<V>(f, [&](auto count) __attribute__((always_inline)) {
        for (int r = begin; r < end; ++r) {
            V total[2][count];
            for (int i = 0; i < 2 * count; ++i) total[i / count][i % count] = V(0);
            each_chunk<V, count>(f, r, r + 1, compute_of(count),
                                 [&](int, std::ptrdiff_t, const V* dx, const V* dv)
                                     __attribute__((always_inline)) {
                                         for (int i = 0; i < count; ++i) {
                                             total[0][i] = total[0][i] + dx[i] * dx[i];
                                             total[1][i] = total[1][i] + dv[i] * dv[i];
                                         }
                                     });
            rows[r] = {};
            for (int i = 0; i < count; ++i)
                for (int l = 0; l < W; ++l) {
                    rows[r].x += double(total[0][i].get(std::size_t(l)));
                    rows[r].v += double(total[1][i].get(std::size_t(l)));
                }
        }
    });
}

template <class Arch, class Real>
void square_rows(const FieldLayout& f, int begin, int end, const Real* state,
                 const Combination<Real>& sum, RowSquares* rows) {
    using V = Lanes<Real, Arch>;
    square_chunks<V>(f, begin, end, rows, [&](auto count) __attribute__((always_inline)) {
        return combination<V, count>(f, state, sum);
    });
}

template <class Arch, class Real>
void chebyshev_square_rows(const FieldLayout& f, int begin, int end, const Real* from,
                           const Real* last, const ChebyshevSum<Real>& sum, RowSquares* rows) {
    using V = Lanes<Real, Arch>;
    square_chunks<V>(f, begin, end, rows, [&](auto count) __attribute__((always_inline)) {
        return increment_sum<V, count, Real>(f, from, last, nullptr, sum);
    });
}

template <class Arch, class Real>
constexpr RowsKernels<Real> rows_kernels() {
    return {&points_below<Arch, Real>,
            &component_extent<Arch, Real>,
            &all_finite<Arch, Real>,
            &advance_rows<Arch, Real>,
            &square_rows<Arch, Real>,
            &chebyshev_rows<Arch, Real>,
            &chebyshev_square_rows<Arch, Real>,
            &read_points<Real>,
            &write_points<Real>};
}

}  // namespace
}  // namespace clothsim
