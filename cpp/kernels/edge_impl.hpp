// The edge kernel: every spring once, for speed.
//
// Layout ("row-lifted"). With m vectors of W lanes a row, vector k, lane l holds column l m + k:
//
//     lane          0      1      2             the right-hand neighbour of a whole vector is the next
//     vector 0    0      m     2m     ...       vector, an aligned load without a shuffle; only behind
//     vector 1    1     m+1   2m+1    ...       the last vector stands vector 0 again, one lane further.
//     ...
//
// A sweep goes down the rows. A row adds the force of each of its springs to its own points and hands the
// opposite force on: within the row in registers, to the next row in `received`, to the row after it in
// `received_2`. When a row is done, so is the acceleration of its points, and the Runge-Kutta stage is
// finished at once. Nothing needs the row's old stage state any more: the new one replaces it.
//
// The order of additions at a point does not depend on where a sweep starts, because `edge_halo` repeats
// what the two rows above hand down: any number of threads gives the same bits.
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
CLOTHSIM_INLINE void spring_forces(const Springs<V, Real, count>& s, std::ptrdiff_t plane, Take take) {
    if constexpr (count > springs_side_by_side) {
        each<count>(CLOTHSIM_EACH(i) {
            spring_forces<damped>(Springs<V, Real, 1>{{s.a[i]}, {s.b[i]}, {s.coefficients[i]}}, plane,
                                  [&](auto, const Vector3<V>& force) __attribute__((always_inline)) { take(i, force); });
        });
        return;
    }
    constexpr int W = int(V::size);
    Vector3<V> d[count];
    V l2[count], r[count], scale[count];
    each<count>(CLOTHSIM_EACH(i) { d[i] = s.a[i]->x - load3<V>(s.b[i], plane); });
    each<count>(CLOTHSIM_EACH(i) { l2[i] = xsimd::fma(d[i].x, d[i].x, V(smallest_squared_length<Real>)); });
    each<count>(CLOTHSIM_EACH(i) { l2[i] = xsimd::fma(d[i].y, d[i].y, l2[i]); });
    each<count>(CLOTHSIM_EACH(i) { l2[i] = xsimd::fma(d[i].z, d[i].z, l2[i]); });
    if constexpr (damped) {
        const auto w = [&](auto i, int k) __attribute__((always_inline)) {
            const V& v = k == 0 ? s.a[i]->v.x : k == 1 ? s.a[i]->v.y : s.a[i]->v.z;
            return v - V::load_unaligned(s.b[i] + (3 + k) * plane);
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

template <class V, class Real, bool damped>
struct EdgeRow {
    static constexpr int W = int(V::size);
    const EdgeArguments<Real>& e;
    std::ptrdiff_t plane;

    CLOTHSIM_INLINE Points<V> points(const Real* source, std::ptrdiff_t at) const {
        if constexpr (damped) return {load3<V>(source + at, plane), load3<V>(source + 3 * plane + at, plane)};
        else return {load3<V>(source + at, plane), {}};
    }
    CLOTHSIM_INLINE const Real* coefficients(int k, EdgeKind kind) const {
        return e.coefficients + (e.coefficient_class[k] * edge_kind_count + kind) * EdgeCoefficientIndex::count * W;
    }
    // Where vector k of a row begins: behind the last vector stands the first, a lane on.
    CLOTHSIM_INLINE std::ptrdiff_t column(int k) const {
        return k < e.vectors ? std::ptrdiff_t(k) * W : std::ptrdiff_t(k - e.vectors) * W + 1;
    }
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
    const std::ptrdiff_t plane = std::ptrdiff_t(e.vectors) * W;
    const EdgeRow<V, Real, features.spring_damping> row{e, plane};
    constexpr bool damped = features.spring_damping;
    const Vector3<V> none{V(Real(0)), V(Real(0)), V(Real(0))};

    Vector3<V> to_next = none, to_next_2 = none;  // handed on within the row
    Vector3<V> diagonal = none;                   // of the vector before, for `received`
    for (int k = 0; k < e.vectors; ++k) {
        const std::ptrdiff_t at = std::ptrdiff_t(k) * W;
        const std::ptrdiff_t next = row.column(k + 1);
        const Points<V> here = row.points(source.here, at);
        Vector3<V> f = none, down = none;
        if constexpr (own) f = to_next + load3<V>(e.received + at, plane);
        Vector3<V> hand_next = to_next_2;
        if constexpr (features.bend && has_below) down = load3<V>(e.received_2 + at, plane);

        const Real* const right = source.here + next;
        const Real* const right_2 = source.here + row.column(k + 2);
        const auto take_right = [&](auto, const Vector3<V>& force) __attribute__((always_inline)) {
            f = f - force;
            hand_next = hand_next + force;
        };
        const auto take_right_2 = [&](auto, const Vector3<V>& force) __attribute__((always_inline)) {
            f = f - force;
            to_next_2 = force;
        };
        const auto take_below_2 = [&](auto, const Vector3<V>& force) __attribute__((always_inline)) {
            f = f - force;
            store3(e.received_2 + at, plane, force);
        };
        const auto coefficients = [&](EdgeKind kind) { return row.coefficients(k, kind); };
        if constexpr (own && features.structural && bend_down) {
            spring_forces<damped>(Springs<V, Real, 3>{{&here, &here, &here},
                                                      {right, right_2, source.below_2 + at},
                                                      {coefficients(to_right), coefficients(to_right_2), coefficients(to_below_2)}},
                                  plane, [&](auto i, const Vector3<V>& force) __attribute__((always_inline)) {
                                      if constexpr (i == 0) take_right(i, force);
                                      if constexpr (i == 1) take_right_2(i, force);
                                      if constexpr (i == 2) take_below_2(i, force);
                                  });
        } else {
            const auto one = [&](const Real* b, EdgeKind kind) {
                return Springs<V, Real, 1>{{&here}, {b}, {coefficients(kind)}};
            };
            if constexpr (own && features.structural) spring_forces<damped>(one(right, to_right), plane, take_right);
            if constexpr (own && features.bend) spring_forces<damped>(one(right_2, to_right_2), plane, take_right_2);
            if constexpr (bend_down) spring_forces<damped>(one(source.below_2 + at, to_below_2), plane, take_below_2);
        }
        const auto take_below = [&](auto, const Vector3<V>& force) __attribute__((always_inline)) {
            f = f - force;
            down = down + force;
        };
        const auto take_falling = [&](auto, const Vector3<V>& force) __attribute__((always_inline)) {
            f = f - force;
            down = down + diagonal;
            diagonal = force;
        };
        const auto take_rising = [&](auto, const Vector3<V>& force) __attribute__((always_inline)) {
            hand_next = hand_next - force;
            down = down + force;
        };
        if constexpr (shear) {
            const Points<V> there = row.points(source.here, next);
            const Real* const diagonals = coefficients(to_diagonal);
            if constexpr (vertical) {
                spring_forces<damped>(Springs<V, Real, 3>{{&here, &here, &there},
                                                          {source.below + at, source.below + next, source.below + at},
                                                          {coefficients(to_below), diagonals, diagonals}},
                                      plane, [&](auto i, const Vector3<V>& force) __attribute__((always_inline)) {
                                          if constexpr (i == 0) take_below(i, force);
                                          if constexpr (i == 1) take_falling(i, force);
                                          if constexpr (i == 2) take_rising(i, force);
                                      });
            } else {
                spring_forces<damped>(Springs<V, Real, 2>{{&here, &there},
                                                          {source.below + next, source.below + at},
                                                          {diagonals, diagonals}},
                                      plane, [&](auto i, const Vector3<V>& force) __attribute__((always_inline)) {
                                          if constexpr (i == 0) take_falling(i, force);
                                          if constexpr (i == 1) take_rising(i, force);
                                      });
            }
        } else if constexpr (vertical) {
            spring_forces<damped>(Springs<V, Real, 1>{{&here}, {source.below + at}, {coefficients(to_below)}}, plane, take_below);
        }
        if constexpr (has_below) store3(e.received + at, plane, down);
        if constexpr (own) store3(e.force + at, plane, f);
        to_next = hand_next;
    }
    // What was handed on past the last vector belongs to the first ones, a lane further.
    if constexpr (own) {
        store3(e.force, plane, load3<V>(e.force, plane) + shifted_lanes(to_next));
        if constexpr (features.bend) store3(e.force + W, plane, load3<V>(e.force + W, plane) + shifted_lanes(to_next_2));
    }
    if constexpr (shear) store3(e.received, plane, load3<V>(e.received, plane) + shifted_lanes(diagonal));
}

// Finish the stage for one row whose force is complete. `special`: something that most rows do without, mass or
// damping per point, pinned points or padding.
template <class V, class Real, Stage stage, bool special>
void edge_update(const EdgeArguments<Real>& e, int row, const Real* source) {
    constexpr int W = int(V::size);
    constexpr bool compensated = sizeof(Real) == 4;
    const std::ptrdiff_t plane = std::ptrdiff_t(e.vectors) * W;
    Real* const record = e.rows + row * e.record;
    Real* const state = record + RowPlanes::state * plane;
    Real* const target = record + RowPlanes::stage * plane;
    Real* const first = record + RowPlanes::first * plane;
    Real* const sum = record + RowPlanes::sum * plane;
    Real* const compensation = record + RowPlanes::compensation * plane;
    const V step(stage == Stage::third ? e.h : e.half_h), h(e.h), h2_6(e.h2_6), h_6(e.h_6);

    for (int j = 0; j < 3; ++j) {
        const V gravity(e.gravity[j]);
        for (std::ptrdiff_t at = j * plane; at < (j + 1) * plane; at += W) {
            const V vs = V::load_aligned(source + 3 * plane + at);
            V a = V::load_aligned(e.force + at);
            if constexpr (special) {
                const std::ptrdiff_t point = row * plane + at - j * plane;
                if (e.point_damping != 0) a = xsimd::fnma(V(e.point_damping), vs, a);
                if (e.inverse_mass) a = a * V::load_aligned(e.inverse_mass + point);
                const V zero(Real(0));
                a = xsimd::select(V::load_aligned(e.free + point) != zero, a + gravity, zero);
            } else {
                a = a + gravity;
            }
            if constexpr (stage == Stage::first || stage == Stage::evaluate) a.store_aligned(first + at);
            if constexpr (stage == Stage::second) a.store_aligned(sum + at);
            if constexpr (stage == Stage::third) (V::load_aligned(sum + at) + a).store_aligned(sum + at);
            if constexpr (stage == Stage::evaluate) continue;

            const V v = V::load_aligned(state + 3 * plane + at);
            if constexpr (stage == Stage::fourth) {
                const V a1 = V::load_aligned(first + at);
                const V middle = V::load_aligned(sum + at);
                const V dx = xsimd::fma(h, v, h2_6 * (a1 + middle));
                const V dv = h_6 * ((a1 + a) + (middle + middle));
                add_increment<compensated>(state + at, compensation + at, dx);
                add_increment<compensated>(state + 3 * plane + at, compensation + 3 * plane + at, dv);
            } else {
                xsimd::fma(step, vs, V::load_aligned(state + at)).store_aligned(target + at);
                xsimd::fma(step, a, v).store_aligned(target + 3 * plane + at);
            }
        }
    }
}

template <class V, class Real>
CLOTHSIM_INLINE void edge_finish(const EdgeArguments<Real>& e, int row, const Real* source) {
    const bool special = e.row_has_fixed[row] || e.inverse_mass || e.point_damping != 0;
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
    const std::ptrdiff_t plane = std::ptrdiff_t(e.vectors) * W;
    const Real* const state = e.rows + row * e.record + RowPlanes::state * plane;
    for (int s = 0; s < e.sphere_count; ++s) {
        const SphereOutline<Real>& sphere = e.spheres[s];
        for (int k = 0; k < e.vectors; ++k) {
            const Vector3<V> x = load3<V>(state + std::ptrdiff_t(k) * W, plane);
            const Vector3<V> m{x.x - V(sphere.center[0]), x.y - V(sphere.center[1]), x.z - V(sphere.center[2])};
            const auto inside = m.x * m.x + m.y * m.y + m.z * m.z < V(sphere.radius_squared);
            if (__builtin_expect(xsimd::any(inside), 0)) e.hit(e.context, s, row, k, inside.mask());
        }
    }
}

// Rows [begin, end) of a band; `sources(row)` for every one of them in the caller's table.
template <class Arch, class Real, int index>
void edge_rows(const EdgeArguments<Real>& e, const EdgeSources<Real>* sources, int begin, int end) {
    using V = Lanes<Real, Arch>;
    for (int row = begin; row < end; ++row) {
        const EdgeSources<Real>& source = sources[row];
        if (source.below_2) edge_row<Arch, Real, index, true, true, true>(e, source);
        else if (source.below) edge_row<Arch, Real, index, true, true, false>(e, source);
        else edge_row<Arch, Real, index, true, false, false>(e, source);
        edge_finish<V>(e, row, source.here);
        if (e.stage == Stage::fourth && e.sphere_count > 0) edge_spheres<V>(e, row);
    }
}

// What the two rows above a band hand down to its first two.
template <class Arch, class Real, int index>
void edge_halo(const EdgeArguments<Real>& e, const EdgeSources<Real>& above_2, const EdgeSources<Real>& above) {
    using V = Lanes<Real, Arch>;
    constexpr Features features = Features::from_index(index);
    const std::ptrdiff_t plane = std::ptrdiff_t(e.vectors) * int(V::size);
    for (std::ptrdiff_t i = 0; i < 3 * plane; i += int(V::size)) V(Real(0)).store_aligned(e.received_2 + i);
    if constexpr (features.bend) {
        if (above_2.here) {
            const EdgeRow<V, Real, features.spring_damping> row{e, plane};
            for (int k = 0; k < e.vectors; ++k) {
                const std::ptrdiff_t at = std::ptrdiff_t(k) * int(V::size);
                const Points<V> points = row.points(above_2.here, at);
                spring_forces<features.spring_damping>(
                    Springs<V, Real, 1>{{&points}, {above_2.below_2 + at}, {row.coefficients(k, to_below_2)}}, plane,
                    [&](auto, const Vector3<V>& force) { store3(e.received_2 + at, plane, force); });
            }
        }
    }
    edge_row<Arch, Real, index, false, true, true>(e, above);
}

}  // namespace
}  // namespace clothsim
