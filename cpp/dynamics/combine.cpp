#include "dynamics/combine.hpp"

#include <algorithm>

// One version of each function for every instruction set, chosen when the library is loaded.
#if defined(__x86_64__) && defined(__linux__)
#define CLOTHSIM_VERSIONS __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define CLOTHSIM_VERSIONS
#endif
#define CLOTHSIM_INLINE inline __attribute__((always_inline))

namespace clothsim {
namespace {

// Elements worked on at a time; their sums stay in the first-level cache.
constexpr int chunk = 64;
// Accelerations added at a time: fewer passes over the sums.
constexpr int together = 4;

template <class Real>
struct Increments {
    alignas(64) Real x[chunk], v[chunk];
};

// The sums of `n` elements from `at` on; `velocity` is null where nothing drifts.
template <class Real>
CLOTHSIM_INLINE void sum_up(const Combination<Real>& sum, std::ptrdiff_t at, const Real* velocity, int n,
                            Increments<Real>& d) {
    if (velocity)
        for (int i = 0; i < n; ++i) d.x[i] = sum.drift * velocity[i];
    else
        for (int i = 0; i < n; ++i) d.x[i] = 0;
    for (int i = 0; i < n; ++i) d.v[i] = 0;
    int l = 0;
    for (; l + together <= sum.count; l += together) {
        const Real *a0 = sum.a[l] + at, *a1 = sum.a[l + 1] + at, *a2 = sum.a[l + 2] + at, *a3 = sum.a[l + 3] + at;
        const Real x0 = sum.x[l], x1 = sum.x[l + 1], x2 = sum.x[l + 2], x3 = sum.x[l + 3];
        const Real v0 = sum.v[l], v1 = sum.v[l + 1], v2 = sum.v[l + 2], v3 = sum.v[l + 3];
        for (int i = 0; i < n; ++i) {
            d.x[i] += (x0 * a0[i] + x1 * a1[i]) + (x2 * a2[i] + x3 * a3[i]);
            d.v[i] += (v0 * a0[i] + v1 * a1[i]) + (v2 * a2[i] + v3 * a3[i]);
        }
    }
    for (; l < sum.count; ++l) {
        const Real* a0 = sum.a[l] + at;
        const Real x0 = sum.x[l], v0 = sum.v[l];
        for (int i = 0; i < n; ++i) {
            d.x[i] += x0 * a0[i];
            d.v[i] += v0 * a0[i];
        }
    }
}

// `work(state offset, n, increments)` for every chunk of the rows. `from` gives the velocities.
template <class Real, class Work>
CLOTHSIM_INLINE void for_each_chunk(const FieldLayout& f, int begin, int end, const Real* from,
                                    const Combination<Real>& sum, Work work) {
    Increments<Real> d;
    for (int r = begin; r < end; ++r)
        for (int k = 0; k < f.runs; ++k) {
            const std::ptrdiff_t state = f.origin + r * f.row + k * f.run;
            const std::ptrdiff_t acceleration = f.acceleration_origin + r * f.acceleration_row + k * f.acceleration_run;
            for (int o = 0; o < f.length; o += chunk) {
                const int n = std::min(chunk, f.length - o);
                sum_up(sum, acceleration + o, from ? from + state + o + f.velocity : nullptr, n, d);
                work(r, state + o, n, d);
            }
        }
}

template <class Real>
CLOTHSIM_INLINE void combine_any(const FieldLayout& f, int begin, int end, const Real* from, Real* to,
                                 const Combination<Real>& sum) {
    for_each_chunk(f, begin, end, from, sum, [&](int, std::ptrdiff_t at, int n, const Increments<Real>& d)
                   __attribute__((always_inline)) {
        const Real *x = from + at, *v = x + f.velocity;
        Real *to_x = to + at, *to_v = to_x + f.velocity;
#pragma GCC ivdep
        for (int i = 0; i < n; ++i) to_x[i] = x[i] + d.x[i];
#pragma GCC ivdep
        for (int i = 0; i < n; ++i) to_v[i] = v[i] + d.v[i];
    });
}

// Kahan's compensated summation, as in the kernels.
template <class Real>
CLOTHSIM_INLINE void add(Real* value, std::ptrdiff_t compensation, const Real* increment, int n) {
    if (compensation == 0) {
#pragma GCC ivdep
        for (int i = 0; i < n; ++i) value[i] += increment[i];
        return;
    }
    Real* const kept = value + compensation;
#pragma GCC ivdep
    for (int i = 0; i < n; ++i) {
        const Real all = increment[i] + kept[i];
        const Real next = value[i] + all;
        kept[i] = all - (next - value[i]);
        value[i] = next;
    }
}

template <class Real>
CLOTHSIM_INLINE void advance_any(const FieldLayout& f, int begin, int end, Real* state, const Combination<Real>& sum) {
    for_each_chunk(f, begin, end, static_cast<const Real*>(state), sum,
                   [&](int, std::ptrdiff_t at, int n, const Increments<Real>& d) __attribute__((always_inline)) {
        add(state + at, f.compensation, d.x, n);
        add(state + at + f.velocity, f.compensation, d.v, n);
    });
}

template <class Real>
CLOTHSIM_INLINE void square_any(const FieldLayout& f, int begin, int end, const Combination<Real>& sum,
                                RowSquares* rows) {
    for (int r = begin; r < end; ++r) {
        Increments<Real> total{};
        for_each_chunk(f, r, r + 1, static_cast<const Real*>(nullptr), sum,
                       [&](int, std::ptrdiff_t, int n, const Increments<Real>& d) __attribute__((always_inline)) {
            for (int i = 0; i < n; ++i) {
                total.x[i] += d.x[i] * d.x[i];
                total.v[i] += d.v[i] * d.v[i];
            }
        });
        rows[r] = {};
        for (int i = 0; i < chunk; ++i) {
            rows[r].x += double(total.x[i]);
            rows[r].v += double(total.v[i]);
        }
    }
}

}  // namespace

CLOTHSIM_VERSIONS void combine(const FieldLayout& field, int begin, int end, const float* from, float* to,
                               const Combination<float>& sum) {
    combine_any(field, begin, end, from, to, sum);
}
CLOTHSIM_VERSIONS void combine(const FieldLayout& field, int begin, int end, const double* from, double* to,
                               const Combination<double>& sum) {
    combine_any(field, begin, end, from, to, sum);
}
CLOTHSIM_VERSIONS void advance_rows(const FieldLayout& field, int begin, int end, float* state,
                                    const Combination<float>& sum) {
    advance_any(field, begin, end, state, sum);
}
CLOTHSIM_VERSIONS void advance_rows(const FieldLayout& field, int begin, int end, double* state,
                                    const Combination<double>& sum) {
    advance_any(field, begin, end, state, sum);
}
CLOTHSIM_VERSIONS void square_rows(const FieldLayout& field, int begin, int end, const Combination<float>& sum,
                                   RowSquares* rows) {
    square_any(field, begin, end, sum, rows);
}
CLOTHSIM_VERSIONS void square_rows(const FieldLayout& field, int begin, int end, const Combination<double>& sum,
                                   RowSquares* rows) {
    square_any(field, begin, end, sum, rows);
}

}  // namespace clothsim
