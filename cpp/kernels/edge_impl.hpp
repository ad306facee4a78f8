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
// `received_2`. When a row is done, so is the acceleration of its points, and the Runge-Kutta stage is
// finished at once. Nothing needs the row's old stage state any more: the new one replaces it.
//
// Sweeps may start anywhere and go up or down: the force on a point is summed as
//
//     within the row + ((vertical + 2nd vertical) + (diagonal + other diagonal) of the rows before
//                      -  the same of the rows behind)
//
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

// As many as the registers hold.
#if defined(__AVX512F__)
constexpr int springs_side_by_side = 3;
#else
constexpr int springs_side_by_side = 1;
#endif

template <class V>
struct Points {
    Vector3<V> x, v;
};

// Spring vectors, each from points in registers to points in memory at `b`.
template <class V, class Real, int count>
struct Springs {
    const Points<V>* a[count];
    const Real* b[count];
    const Real* coefficients[count];
};

// `take(i, force per mass on the points at b)`; the difference d takes its second operand from memory.
template <bool damped, class V, class Real, int count, class Take>
CLOTHSIM_INLINE void spring_forces(const Springs<V, Real, count>& s, Take take) {
    if constexpr (count > springs_side_by_side) {
        each<count>(CLOTHSIM_EACH(i) {
            spring_forces<damped>(Springs<V, Real, 1>{{s.a[i]}, {s.b[i]}, {s.coefficients[i]}},
                                  [&](auto, const Vector3<V>& force) __attribute__((always_inline)) { take(i, force); });
        });
        return;
    }
    constexpr int W = int(V::size);
    Vector3<V> d[count];
    V l2[count], r[count], scale[count];
    each<count>(CLOTHSIM_EACH(i) { d[i] = s.a[i]->x - load3<V>(s.b[i], W); });
    each<count>(CLOTHSIM_EACH(i) { l2[i] = xsimd::fma(d[i].x, d[i].x, V(smallest_squared_length<Real>)); });
    each<count>(CLOTHSIM_EACH(i) { l2[i] = xsimd::fma(d[i].y, d[i].y, l2[i]); });
    each<count>(CLOTHSIM_EACH(i) { l2[i] = xsimd::fma(d[i].z, d[i].z, l2[i]); });
    if constexpr (damped) {
        const auto w = [&](auto i, int k) __attribute__((always_inline)) {
            const V& v = k == 0 ? s.a[i]->v.x : k == 1 ? s.a[i]->v.y : s.a[i]->v.z;
            return v - V::load_unaligned(s.b[i] + (3 + k) * W);
        };
        each<count>(CLOTHSIM_EACH(i) { scale[i] = w(i, 0) * d[i].x; });
        each<count>(CLOTHSIM_EACH(i) { scale[i] = xsimd::fma(w(i, 1), d[i].y, scale[i]); });
        each<count>(CLOTHSIM_EACH(i) { scale[i] = xsimd::fma(w(i, 2), d[i].z, scale[i]); });
        each<count>(CLOTHSIM_EACH(i) { scale[i] = scale[i] * V::load_aligned(s.coefficients[i] + 2 * W); });
    }
    scaled_reciprocal_roots(l2, r);
    if constexpr (damped) {
        each<count>(CLOTHSIM_EACH(i) { scale[i] = xsimd::fms(scale[i], r[i], V::load_aligned(s.coefficients[i] + W)); });
        each<count>(CLOTHSIM_EACH(i) { scale[i] = xsimd::fma(scale[i], r[i], V::load_aligned(s.coefficients[i])); });
    } else {
        each<count>(CLOTHSIM_EACH(i) {
            scale[i] = xsimd::fnma(r[i], V::load_aligned(s.coefficients[i] + W), V::load_aligned(s.coefficients[i]));
        });
    }
    each<count>(CLOTHSIM_EACH(i) { take(i, Vector3<V>{scale[i] * d[i].x, scale[i] * d[i].y, scale[i] * d[i].z}); });
}

// Elements from vector to vector of the rows at which a stage looks.
template <class V, class Real>
CLOTHSIM_INLINE std::ptrdiff_t source_stride(const EdgeArguments<Real>& e) {
    constexpr int state = sizeof(Real) == 4 ? StateRecord::count_compensated : StateRecord::count;
    return (e.stage == Stage::first || e.stage == Stage::evaluate ? state : WorkRecord::count) * int(V::size);
}

template <class V, class Real, bool damped>
struct EdgeRow {
    static constexpr int W = int(V::size);
    const EdgeArguments<Real>& e;
    std::ptrdiff_t stride;

    CLOTHSIM_INLINE Points<V> points(const Real* source) const {
        if constexpr (damped) return {load3<V>(source, W), load3<V>(source + 3 * W, W)};
        else return {load3<V>(source, W), {}};
    }
    CLOTHSIM_INLINE const Real* coefficients(int k, EdgeKind kind) const {
        return e.coefficients + (e.coefficient_class[k] * edge_kind_count + kind) * EdgeCoefficientIndex::count * W;
    }
    // Where vector k of a row begins: behind the last vector stands the first, a lane on.
    CLOTHSIM_INLINE std::ptrdiff_t column(int k) const { return k < e.vectors ? k * stride : (k - e.vectors) * stride + 1; }
};

// All springs that start in a row (own), or only what they hand down to rows below (a halo row above a band).
template <class Arch, class Real, int index, bool own, bool has_below, bool has_below_2>
CLOTHSIM_INLINE void edge_row(const EdgeArguments<Real>& e, const EdgeSources<Real>& source) {
    using V = Lanes<Real, Arch>;
    constexpr int W = int(V::size);
    constexpr Features features = Features::from_index(index);
    constexpr bool vertical = features.structural && has_below;
    constexpr bool shear = features.shear && has_below;
    constexpr bool bend_down = features.bend && has_below_2;
    const EdgeRow<V, Real, features.spring_damping> row{e, source_stride<V>(e)};
    constexpr bool damped = features.spring_damping;
    const Vector3<V> none{V(Real(0)), V(Real(0)), V(Real(0))};

    Vector3<V> to_next = none, to_next_2 = none;  // handed on within the row
    // The diagonals behind the last vector reach the first one, a lane further: they are taken before it.
    Vector3<V> falling = none, rising = none, last_falling = none, last_rising = none;
    if constexpr (shear) {
        const int k = e.vectors - 1;
        const std::ptrdiff_t at = row.column(k), next = row.column(k + 1);
        const Points<V> here = row.points(source.here + at), there = row.points(source.here + next);
        const Real* const diagonals = row.coefficients(k, to_diagonal);
        spring_forces<damped>(Springs<V, Real, 2>{{&here, &there}, {source.below + next, source.below + at}, {diagonals, diagonals}}, [&](auto i, const Vector3<V>& force) __attribute__((always_inline)) {
                                  (i == 0 ? last_falling : last_rising) = force;
                              });
        falling = shifted_lanes(last_falling);
        rising = shifted_lanes(last_rising);
    }

    const auto column = [&]<bool last>(int k) __attribute__((always_inline)) {
        const std::ptrdiff_t at = row.column(k), next = row.column(k + 1);
        const std::ptrdiff_t vector = std::ptrdiff_t(k) * 3 * W;
        const Points<V> here = row.points(source.here + at);
        const auto coefficients = [&](EdgeKind kind) __attribute__((always_inline)) { return row.coefficients(k, kind); };

        // Handed on within the row: by the vector before, and by the one before that.
        Vector3<V> within = to_next, hand_next = to_next_2;
        Vector3<V> straight = none, straight_2 = none;  // to the next row and the one after it
        // A diagonal pair of a point: one spring of this vector, one of the vector before.
        Vector3<V> own_pair = rising, handed_pair = falling;

        const auto take_right = [&](auto, const Vector3<V>& force) __attribute__((always_inline)) {
            within = within - force;
            hand_next = features.bend ? hand_next + force : force;
        };
        const auto take_right_2 = [&](auto, const Vector3<V>& force) __attribute__((always_inline)) {
            within = within - force;
            to_next_2 = force;
        };
        const auto take_below_2 = [&](auto, const Vector3<V>& force) __attribute__((always_inline)) { straight_2 = force; };
        const auto take_below = [&](auto, const Vector3<V>& force) __attribute__((always_inline)) { straight = force; };
        const auto take_falling = [&](auto, const Vector3<V>& force) __attribute__((always_inline)) {
            own_pair = own_pair + force;
            falling = force;
        };
        const auto take_rising = [&](auto, const Vector3<V>& force) __attribute__((always_inline)) {
            handed_pair = handed_pair + force;
            rising = force;
        };
        const auto one = [&](const Real* b, EdgeKind kind) __attribute__((always_inline)) {
            return Springs<V, Real, 1>{{&here}, {b}, {coefficients(kind)}};
        };

        if constexpr (own && features.structural && bend_down) {
            spring_forces<damped>(Springs<V, Real, 3>{{&here, &here, &here},
                                                      {source.here + next, source.here + row.column(k + 2), source.below_2 + at},
                                                      {coefficients(to_right), coefficients(to_right_2), coefficients(to_below_2)}}, [&](auto i, const Vector3<V>& force) __attribute__((always_inline)) {
                                      if constexpr (i == 0) take_right(i, force);
                                      if constexpr (i == 1) take_right_2(i, force);
                                      if constexpr (i == 2) take_below_2(i, force);
                                  });
        } else {
            if constexpr (own && features.structural) spring_forces<damped>(one(source.here + next, to_right), take_right);
            if constexpr (own && features.bend)
                spring_forces<damped>(one(source.here + row.column(k + 2), to_right_2), take_right_2);
            if constexpr (bend_down) spring_forces<damped>(one(source.below_2 + at, to_below_2), take_below_2);
        }
        if constexpr (shear && !last) {
            const Points<V> there = row.points(source.here + next);
            const Real* const diagonals = coefficients(to_diagonal);
            if constexpr (vertical) {
                spring_forces<damped>(Springs<V, Real, 3>{{&here, &here, &there},
                                                          {source.below + at, source.below + next, source.below + at},
                                                          {coefficients(to_below), diagonals, diagonals}}, [&](auto i, const Vector3<V>& force) __attribute__((always_inline)) {
                                          if constexpr (i == 0) take_below(i, force);
                                          if constexpr (i == 1) take_falling(i, force);
                                          if constexpr (i == 2) take_rising(i, force);
                                      });
            } else {
                spring_forces<damped>(Springs<V, Real, 2>{{&here, &there}, {source.below + next, source.below + at}, {diagonals, diagonals}}, [&](auto i, const Vector3<V>& force) __attribute__((always_inline)) {
                                          if constexpr (i == 0) take_falling(i, force);
                                          if constexpr (i == 1) take_rising(i, force);
                                      });
            }
        } else {
            if constexpr (vertical) spring_forces<damped>(one(source.below + at, to_below), take_below);
            if constexpr (shear) {
                take_falling(0, last_falling);
                take_rising(0, last_rising);
            }
        }

        if constexpr (own) {
            // What is not there is not added either: a compiler may not leave out + 0.
            Vector3<V> behind = bend_down ? straight + straight_2 : straight;
            if constexpr (shear) behind = behind + own_pair;
            store3(e.force + vector, W, within + (load3<V>(e.received + vector, W) - behind));
        }
        if constexpr (has_below) {
            Vector3<V> handed = straight;
            if constexpr (features.bend) handed = handed + load3<V>(e.received_2 + vector, W);
            if constexpr (shear) handed = handed + handed_pair;
            store3(e.received + vector, W, handed);
        }
        if constexpr (bend_down) store3(e.received_2 + vector, W, straight_2);
        to_next = hand_next;
    };
    for (int k = 0; k < e.vectors - 1; ++k) column.template operator()<false>(k);
    column.template operator()<true>(e.vectors - 1);

    // What was handed on past the last vector belongs to the first ones, a lane further.
    if constexpr (own) {
        store3(e.force, W, load3<V>(e.force, W) + shifted_lanes(to_next));
        if constexpr (features.bend)
            store3(e.force + 3 * W, W, load3<V>(e.force + 3 * W, W) + shifted_lanes(to_next_2));
    }
}

// Finish the stage for one row whose force is complete. `special`: something that most rows do without, mass or
// damping per point, pinned points or padding.
template <class V, class Real, Stage stage, bool special>
void edge_update(const EdgeArguments<Real>& e, int row, const Real* source) {
    constexpr int W = int(V::size);
    constexpr bool compensated = sizeof(Real) == 4;
    constexpr int state_stride = (compensated ? StateRecord::count_compensated : StateRecord::count) * W;
    const EdgeRowPointers<Real>& pointers = e.rows[row];
    const V step(stage == Stage::third ? e.h : e.half_h), h(e.h), h2_6(e.h2_6), h_6(e.h_6);
    const V gravity[3] = {V(e.gravity[0]), V(e.gravity[1]), V(e.gravity[2])};
    const std::ptrdiff_t stride = source_stride<V>(e);

    for (int k = 0; k < e.vectors; ++k) {
        Real* const state = pointers.state + k * state_stride;
        Real* const work = pointers.work + k * (WorkRecord::count * W);
        each<3>(CLOTHSIM_EACH(j) {
            const V vs = V::load_aligned(source + k * stride + (3 + j) * W);
            V a = V::load_aligned(e.force + (3 * k + j) * W);
            if constexpr (special) {
                if (e.point_damping != 0) a = xsimd::fnma(V(e.point_damping), vs, a);
                if (pointers.inverse_mass) a = a * V::load_aligned(pointers.inverse_mass + k * W);
                const V zero(Real(0));
                a = xsimd::select(V::load_aligned(pointers.free + k * W) != zero, a + gravity[j], zero);
            } else {
                a = a + gravity[j];
            }
            Real* const first = work + (WorkRecord::first + j) * W;
            Real* const sum = work + (WorkRecord::sum + j) * W;
            if constexpr (stage == Stage::first || stage == Stage::evaluate) a.store_aligned(first);
            if constexpr (stage == Stage::second) a.store_aligned(sum);
            if constexpr (stage == Stage::third) (V::load_aligned(sum) + a).store_aligned(sum);
            if constexpr (stage != Stage::evaluate) {
                Real* const x = state + j * W;
                Real* const v = state + (3 + j) * W;
                const V v_old = V::load_aligned(v);
                if constexpr (stage == Stage::fourth) {
                    const V a1 = V::load_aligned(first);
                    const V middle = V::load_aligned(sum);
                    const V dx = xsimd::fma(h, v_old, h2_6 * (a1 + middle));
                    const V dv = h_6 * ((a1 + a) + (middle + middle));
                    add_increment<compensated>(x, x + StateRecord::compensation * W, dx);
                    add_increment<compensated>(v, v + StateRecord::compensation * W, dv);
                } else {
                    xsimd::fma(step, vs, V::load_aligned(x)).store_aligned(work + j * W);
                    xsimd::fma(step, a, v_old).store_aligned(work + (3 + j) * W);
                }
            }
        });
    }
}

template <class V, class Real>
CLOTHSIM_INLINE void edge_finish(const EdgeArguments<Real>& e, int row, const Real* source) {
    const bool special = e.rows[row].has_fixed || e.rows[row].inverse_mass || e.point_damping != 0;
    const auto finish = [&]<Stage stage>() {
        if (special) edge_update<V, Real, stage, true>(e, row, source);
        else edge_update<V, Real, stage, false>(e, row, source);
    };
    switch (e.stage) {
        case Stage::first: return finish.template operator()<Stage::first>();
        case Stage::second: return finish.template operator()<Stage::second>();
        case Stage::third: return finish.template operator()<Stage::third>();
        case Stage::fourth: return finish.template operator()<Stage::fourth>();
        case Stage::evaluate: return finish.template operator()<Stage::evaluate>();
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
void edge_stage(const EdgeArguments<Real>& e, int row, const EdgeSources<Real>& source) {
    using V = Lanes<Real, Arch>;
    if (source.below_2) edge_row<Arch, Real, index, true, true, true>(e, source);
    else if (source.below) edge_row<Arch, Real, index, true, true, false>(e, source);
    else edge_row<Arch, Real, index, true, false, false>(e, source);
    edge_finish<V>(e, row, source.here);
    if (e.stage == Stage::fourth && e.sphere_count > 0) edge_spheres<V>(e, row);
}

// The stages of `stages`, each `lag` rows behind the one before, the first of them over rows [begin, end); all
// rows that are met have two more behind them in the band.
template <class Arch, class Real, int index>
void edge_waves(const EdgeArguments<Real>* stages, int stage_count, int lag, int begin, int end) {
    for (int front = begin; front < end; ++front)
        for (int s = 0; s < stage_count; ++s) {
            const EdgeArguments<Real>& e = stages[s];
            const int row = front - s * lag;
            const auto source = [&](int r) { return e.stage == Stage::first ? e.rows[r].state : e.rows[r].work; };
            edge_stage<Arch, Real, index>(e, row, {source(row), source(row + 1), source(row + 2)});
        }
}

// What the two rows before a band hand on to its first two.
template <class Arch, class Real, int index>
void edge_halo(const EdgeArguments<Real>& e, const EdgeSources<Real>& before_2, const EdgeSources<Real>& before) {
    using V = Lanes<Real, Arch>;
    constexpr Features features = Features::from_index(index);
    constexpr int W = int(V::size);
    if constexpr (features.bend) {
        const EdgeRow<V, Real, features.spring_damping> row{e, source_stride<V>(e)};
        for (int k = 0; k < e.vectors; ++k) {
            const Points<V> points = row.points(before_2.here + row.column(k));
            spring_forces<features.spring_damping>(
                Springs<V, Real, 1>{{&points}, {before_2.below_2 + row.column(k)}, {row.coefficients(k, to_below_2)}},
                [&](auto, const Vector3<V>& force) { store3(e.received_2 + k * 3 * W, W, force); });
        }
    }
    edge_row<Arch, Real, index, false, true, true>(e, before);
}

}  // namespace
}  // namespace clothsim
