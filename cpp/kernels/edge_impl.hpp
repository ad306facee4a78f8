// The edge kernel: every spring once, for speed.
//
// Layout ("row-lifted"). With m vectors of W lanes a row, vector k, lane l holds column l m + k:
//
//     lane          0      1      2             the right-hand neighbour of a whole vector is the next
//     vector 0    0      m     2m     ...       vector, an aligned load without a shuffle; only behind
//     vector 1    1     m+1   2m+1    ...       the last vector stands vector 0 again, one lane further.
//     ...
//
// A row is stored vector by vector, all components of vector 0, then all of vector 1: one stream of memory.
//
// A sweep goes from row to row. A row adds the force of each of its springs to its own points and hands the
// opposite force on: within the row in registers, to the next row in `received`, to the row after it in
// `received_2`; what passes the row's end belongs to its first vectors, a lane further, and reaches them last.
// When the force on a vector is complete, its Runge-Kutta stage is finished at once. Nothing needs the row's
// old stage state any more: the new one replaces it.
//
// Sweeps may start anywhere and go up or down: the force on a point is summed as
//
//     within the row + ((vertical + 2nd vertical) + (diagonal + other diagonal) of the rows before
//                      -  the same of the rows behind)
//
// (what passes the row's end likewise, in a sum of its own)
// which gives the same bits either way, and `edge_halo` repeats what the two rows before a band hand on. So
// do any number of threads.
#pragma once

#include "kernels/edge_arguments.hpp"
#include "kernels/kernel_table.hpp"
#include "kernels/vector3.hpp"

namespace clothsim {
namespace {

template <class V>
CLOTHSIM_INLINE Vector3<V> shifted_lanes(const Vector3<V>& a) {
    return {next_lane(a.x), next_lane(a.y), next_lane(a.z)};
}

#define CLOTHSIM_EACH(i) [&](auto i) __attribute__((always_inline))

template <class V>
struct Points {
    Vector3<V> x, v;
};

// One vector of springs from points in registers to points in memory at `b`: force / mass on the points at b.
// `complete`: no lane lacks its spring and all families are damped alike, so that the damping constant is folded
// into `force_scale`.
template <bool damped, bool complete, class V, class Real>
CLOTHSIM_INLINE Vector3<V> spring_force(const Points<V>& a, const Real* b, const Real* coefficients) {
    constexpr int W = int(V::size);
    const Vector3<V> d = a.x - load3<V>(b, W);
    V l2 = xsimd::fma(d.x, d.x, V(smallest_squared_length<Real>));
    l2 = xsimd::fma(d.y, d.y, l2);
    l2 = xsimd::fma(d.z, d.z, l2);
    const V r = scaled_reciprocal_root(l2);
    const V stiffness = V::load_aligned(coefficients + EdgeCoefficientIndex::stiffness * W);
    const V tension = V::load_aligned(coefficients + EdgeCoefficientIndex::tension * W);
    V scale;
    if constexpr (damped) {
        const Vector3<V> w = a.v - load3<V>(b + 3 * W, W);
        scale = w.x * d.x;
        scale = xsimd::fma(w.y, d.y, scale);
        scale = xsimd::fma(w.z, d.z, scale);
        if constexpr (!complete) scale = scale * V::load_aligned(coefficients + EdgeCoefficientIndex::damping * W);
        scale = xsimd::fms(scale, r, tension);
        scale = xsimd::fma(scale, r, stiffness);
    } else {
        scale = xsimd::fnma(r, tension, stiffness);
    }
    return {scale * d.x, scale * d.y, scale * d.z};
}

// Elements from vector to vector of the rows at which a stage looks.
template <class V, class Real>
CLOTHSIM_INLINE std::ptrdiff_t source_stride(const EdgeArguments<Real>& e) {
    constexpr int state = sizeof(Real) == 4 ? StateRecord::count_compensated : StateRecord::count;
    return (e.stage == Stage::first || e.stage == Stage::evaluate ? state : WorkRecord::count) * int(V::size);
}

// Finish the stage for one vector whose force is complete.
template <class V, class Real, bool special, Stage stage>
CLOTHSIM_INLINE void finish_stage(const EdgeArguments<Real>& e, const EdgeRowPointers<Real>& row, int k, const Real* source,
                                  const V (&force)[3]) {
    constexpr int W = int(V::size);
    constexpr bool compensated = sizeof(Real) == 4;
    constexpr int state_stride = (compensated ? StateRecord::count_compensated : StateRecord::count) * W;
    Real* const state = row.state + k * state_stride;
    Real* const work = row.work + k * (WorkRecord::count * W);
    each<3>(CLOTHSIM_EACH(j) {
        const V vs = V::load_aligned(source + (3 + j) * W);
        V a = force[j];
        const V gravity(e.gravity[j]);
        if constexpr (special) {
            if (e.point_damping != 0) a = xsimd::fnma(V(e.point_damping), vs, a);
            const V scale = row.inverse_mass ? V::load_aligned(row.inverse_mass + k * W) : V(e.force_scale);
            const V zero(Real(0));
            a = xsimd::select(V::load_aligned(row.free + k * W) != zero, xsimd::fma(a, scale, gravity), zero);
        } else {
            a = xsimd::fma(a, V(e.force_scale), gravity);
        }
        Real* const first = work + (WorkRecord::first + j) * W;
        Real* const sum = work + (WorkRecord::sum + j) * W;
        Real* const x = state + j * W;
        Real* const v = state + (3 + j) * W;
        if constexpr (stage == Stage::evaluate) {
            a.store_aligned(first);
        } else if constexpr (stage == Stage::fourth) {
            const V a1 = V::load_aligned(first);
            const V middle = V::load_aligned(sum);
            const V dx = xsimd::fma(V(e.h), V::load_aligned(v), V(e.h2_6) * (a1 + middle));
            const V dv = V(e.h_6) * ((a1 + a) + (middle + middle));
            add_increment<compensated>(x, x + StateRecord::compensation * W, dx);
            add_increment<compensated>(v, v + StateRecord::compensation * W, dv);
        } else {
            const V step(stage == Stage::third ? e.h : e.half_h);
            if constexpr (stage == Stage::first) a.store_aligned(first);
            if constexpr (stage == Stage::second) a.store_aligned(sum);
            if constexpr (stage == Stage::third) (V::load_aligned(sum) + a).store_aligned(sum);
            xsimd::fma(step, vs, V::load_aligned(x)).store_aligned(work + j * W);
            xsimd::fma(step, a, V::load_aligned(v)).store_aligned(work + (3 + j) * W);
        }
    });
}

// Rows with something that most do without: mass or damping per point, pinned points or padding.
template <class V, class Real>
__attribute__((noinline)) void finish_special(const EdgeArguments<Real>& e, const EdgeRowPointers<Real>& row, int k, const Real* source) {
    const Real* const force = e.force + 6 * int(V::size);
    const V f[3] = {V::load_aligned(force), V::load_aligned(force + int(V::size)), V::load_aligned(force + 2 * int(V::size))};
    switch (e.stage) {
        case Stage::first: return finish_stage<V, Real, true, Stage::first>(e, row, k, source, f);
        case Stage::second: return finish_stage<V, Real, true, Stage::second>(e, row, k, source, f);
        case Stage::third: return finish_stage<V, Real, true, Stage::third>(e, row, k, source, f);
        case Stage::fourth: return finish_stage<V, Real, true, Stage::fourth>(e, row, k, source, f);
        case Stage::evaluate: return finish_stage<V, Real, true, Stage::evaluate>(e, row, k, source, f);
    }
}

template <class V, class Real>
CLOTHSIM_INLINE void finish(const EdgeArguments<Real>& e, const EdgeRowPointers<Real>& row, int k, const Real* source,
                            const Vector3<V>& force) {
    if (__builtin_expect(row.special, 0)) {
        store3(e.force + 6 * int(V::size), int(V::size), force);
        finish_special<V, Real>(e, row, k, source);
        return;
    }
    const V f[3] = {force.x, force.y, force.z};
    switch (e.stage) {
        case Stage::first: return finish_stage<V, Real, false, Stage::first>(e, row, k, source, f);
        case Stage::second: return finish_stage<V, Real, false, Stage::second>(e, row, k, source, f);
        case Stage::third: return finish_stage<V, Real, false, Stage::third>(e, row, k, source, f);
        case Stage::fourth: return finish_stage<V, Real, false, Stage::fourth>(e, row, k, source, f);
        case Stage::evaluate: return finish_stage<V, Real, false, Stage::evaluate>(e, row, k, source, f);
    }
}

// Where a vector stands among those of its row: how many of its springs along the row lead past the last vector.
enum class Place { inner, second_last, last, any };

// All springs that start in a row (own), or only what they hand down to rows below (a halo row above a band).
template <class Arch, class Real, int index, bool own, bool has_below, bool has_below_2>
CLOTHSIM_INLINE void edge_row(const EdgeArguments<Real>& e, int row_index, const EdgeSources<Real>& source) {
    using V = Lanes<Real, Arch>;
    constexpr int W = int(V::size);
    constexpr Features features = Features::from_index(index);
    constexpr bool damped = features.spring_damping;
    constexpr bool vertical = features.structural && has_below;
    constexpr bool shear = features.shear && has_below;
    constexpr bool bend_down = features.bend && has_below_2;
    const std::ptrdiff_t stride = source_stride<V>(e);
    const int m = e.vectors;
    const Vector3<V> none{V(Real(0)), V(Real(0)), V(Real(0))};
    const Real* const received = e.received[0];
    Real* const hand_down = e.received[1];
    const auto points = [&](const Real* p) __attribute__((always_inline)) -> Points<V> {
        if constexpr (damped) return {load3<V>(p, W), load3<V>(p + 3 * W, W)};
        else return {load3<V>(p, W), {}};
    };
    // Behind the last vector stands the first, a lane on.
    const auto place_of = [&](int k) __attribute__((always_inline)) { return k < m ? k * stride : (k - m) * stride + 1; };

    Vector3<V> to_next = none, to_next_2 = none;  // handed on within the row
    Vector3<V> falling = none, rising = none;     // the half of a diagonal pair that the vector before has

    const auto column = [&]<Place place>(int k) __attribute__((always_inline)) {
        const std::ptrdiff_t at = k * stride;
        const std::ptrdiff_t next = place == Place::any ? place_of(k + 1) : place == Place::last ? 1 : at + stride;
        const std::ptrdiff_t next_2 = place == Place::any           ? place_of(k + 2)
                                      : place == Place::last        ? stride + 1
                                      : place == Place::second_last ? 1
                                                                    : at + 2 * stride;
        constexpr bool down_complete = place != Place::any;
        constexpr bool next_complete = place == Place::inner || place == Place::second_last;
        constexpr bool next_2_complete = place == Place::inner;
        const Real* const table = e.coefficients + (place == Place::any ? std::ptrdiff_t(e.coefficient_class[k]) : 0) * (edge_kind_count * EdgeCoefficientIndex::count * W);
        const Real* const cut = place == Place::any ? table : e.coefficients + std::ptrdiff_t(e.coefficient_class[k]) * (edge_kind_count * EdgeCoefficientIndex::count * W);
        const auto coefficients = [&](EdgeKind kind, bool complete) __attribute__((always_inline)) {
            return (complete ? table : cut) + kind * (EdgeCoefficientIndex::count * W);
        };
        const std::ptrdiff_t vector = std::ptrdiff_t(k) * 3 * W;

        Vector3<V> handed = falling, pair = rising, behind = none;
        if constexpr (shear) {
            const Vector3<V> force = spring_force<damped, next_complete>(points(source.here + next), source.below + at, coefficients(to_diagonal, next_complete));
            handed = falling + force;
            rising = force;
        }
        const Points<V> here = points(source.here + at);
        if constexpr (vertical) {
            const Vector3<V> force = spring_force<damped, down_complete>(here, source.below + at, coefficients(to_below, down_complete));
            behind = force;
            const Vector3<V> straight = features.bend ? force + load3<V>(e.received_2 + vector, W) : force;
            handed = shear ? straight + handed : straight;
        } else if constexpr (has_below && features.bend) {
            const Vector3<V> straight = load3<V>(e.received_2 + vector, W);
            handed = shear ? straight + handed : straight;
        }
        if constexpr (has_below) store3(hand_down + vector, W, handed);
        if constexpr (shear) {
            falling = spring_force<damped, next_complete>(here, source.below + next, coefficients(to_diagonal, next_complete));
            pair = pair + falling;
        }
        if constexpr (bend_down) {
            const Vector3<V> force = spring_force<damped, down_complete>(here, source.below_2 + at, coefficients(to_below_2, down_complete));
            store3(e.received_2 + vector, W, force);
            behind = vertical ? behind + force : force;
        }
        if constexpr (own) {
            if constexpr (shear) behind = vertical || bend_down ? behind + pair : pair;
            Vector3<V> before = load3<V>(received + vector, W);
            if constexpr (vertical || shear || bend_down) before = before - behind;
            Vector3<V> within = to_next;
            to_next = to_next_2;
            if constexpr (features.structural) {
                const Vector3<V> force = spring_force<damped, next_complete>(here, source.here + next, coefficients(to_right, next_complete));
                within = within - force;
                to_next = features.bend ? to_next + force : force;
            }
            if constexpr (features.bend) {
                to_next_2 = spring_force<damped, next_2_complete>(here, source.here + next_2, coefficients(to_right_2, next_2_complete));
                within = within - to_next_2;
            }
            const Vector3<V> force = within + before;
            // What is handed on past the last vector belongs to the first ones, a lane further: they wait for it.
            if (k < (features.bend ? 2 : 1)) store3(e.force + vector, W, force);
            else finish<V>(e, e.rows[row_index], k, source.here + at, force);
        }
    };
    if (e.complete) {
        for (int k = 0; k < m - 2; ++k) column.template operator()<Place::inner>(k);
        column.template operator()<Place::second_last>(m - 2);
        column.template operator()<Place::last>(m - 1);
    } else {
        for (int k = 0; k < m; ++k) column.template operator()<Place::any>(k);
    }

    const std::ptrdiff_t past = std::ptrdiff_t(m) * 3 * W;
    if constexpr (shear) store3(hand_down + past, W, falling);
    if constexpr (own) {
        const EdgeRowPointers<Real>& row = e.rows[row_index];
        Vector3<V> past_last = to_next;
        if constexpr (features.shear) {
            const Vector3<V> before = load3<V>(received + past, W);
            past_last = (shear ? before - rising : before) + past_last;
        }
        finish<V>(e, row, 0, source.here, load3<V>(e.force, W) + shifted_lanes(past_last));
        if constexpr (features.bend)
            finish<V>(e, row, 1, source.here + stride, load3<V>(e.force + 3 * W, W) + shifted_lanes(to_next_2));
    }
}

template <class V, class Real>
CLOTHSIM_INLINE void edge_spheres(const EdgeArguments<Real>& e, int row) {
    constexpr int W = int(V::size);
    constexpr int state_stride = (sizeof(Real) == 4 ? StateRecord::count_compensated : StateRecord::count) * W;
    for (int s = 0; s < e.sphere_count; ++s) {
        const SphereOutline<Real>& sphere = e.spheres[s];
        const Vector3<V> center{V(sphere.center[0]), V(sphere.center[1]), V(sphere.center[2])};
        for (int k = 0; k < e.vectors; ++k) {
            const Vector3<V> m = load3<V>(e.rows[row].state + k * state_stride, W) - center;
            const auto inside = m.x * m.x + m.y * m.y + m.z * m.z < V(sphere.radius_squared);
            if (__builtin_expect(xsimd::any(inside), 0)) e.hit(e.context, s, row, k, inside.mask());
        }
    }
}

// One stage of one row.
template <class Arch, class Real, int index>
void edge_stage(EdgeArguments<Real>& e, int row, const EdgeSources<Real>& source) {
    using V = Lanes<Real, Arch>;
    if (source.below_2) edge_row<Arch, Real, index, true, true, true>(e, row, source);
    else if (source.below) edge_row<Arch, Real, index, true, true, false>(e, row, source);
    else edge_row<Arch, Real, index, true, false, false>(e, row, source);
    std::swap(e.received[0], e.received[1]);
    if (e.stage == Stage::fourth && e.sphere_count > 0) edge_spheres<V>(e, row);
}

// The stages of `stages`, each `lag` rows behind the one before, the first of them over rows [begin, end); all
// rows that are met have two more behind them in the band.
template <class Arch, class Real, int index>
void edge_waves(EdgeArguments<Real>* stages, int stage_count, int lag, int begin, int end) {
    for (int front = begin; front < end; ++front)
        for (int s = 0; s < stage_count; ++s) {
            EdgeArguments<Real>& e = stages[s];
            const int row = front - s * lag;
            const auto source = [&](int r) { return e.stage == Stage::first ? e.rows[r].state : e.rows[r].work; };
            edge_stage<Arch, Real, index>(e, row, {source(row), source(row + 1), source(row + 2)});
        }
}

// What the two rows before a band hand on to its first two.
template <class Arch, class Real, int index>
void edge_halo(EdgeArguments<Real>& e, const EdgeSources<Real>& before_2, const EdgeSources<Real>& before) {
    using V = Lanes<Real, Arch>;
    constexpr Features features = Features::from_index(index);
    constexpr int W = int(V::size);
    if constexpr (features.bend) {
        const std::ptrdiff_t stride = source_stride<V>(e);
        for (int k = 0; k < e.vectors; ++k) {
            const Real* const p = before_2.here + k * stride;
            Points<V> points{load3<V>(p, W), {}};
            if constexpr (features.spring_damping) points.v = load3<V>(p + 3 * W, W);
            const Real* const below_2 = before_2.below_2 + k * stride;
            const auto force = [&]<bool complete>(int which) {
                const Real* const c = e.coefficients + (which * edge_kind_count + to_below_2) * (EdgeCoefficientIndex::count * W);
                store3(e.received_2 + k * 3 * W, W, spring_force<features.spring_damping, complete>(points, below_2, c));
            };
            if (e.complete) force.template operator()<true>(0);
            else force.template operator()<false>(e.coefficient_class[k]);
        }
    }
    edge_row<Arch, Real, index, false, true, true>(e, 0, before);
    std::swap(e.received[0], e.received[1]);
}

}  // namespace
}  // namespace clothsim
