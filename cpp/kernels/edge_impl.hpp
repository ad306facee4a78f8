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

#include <limits>

#include "kernels/edge_arguments.hpp"
#include "kernels/kernel_table.hpp"
#include "kernels/vector3.hpp"

namespace clothsim {
namespace {

template <class V>
CLOTHSIM_INLINE Vector3<V> shifted_lanes(const Vector3<V>& a) {
    return {next_lane(a.x), next_lane(a.y), next_lane(a.z)};
}

// One spring vector from points a (six components in registers) to points at `b`: force per mass on a.
template <bool damped, class V, class Real>
CLOTHSIM_INLINE Vector3<V> edge_force(const Vector3<V>& x, const Vector3<V>& v, const Real* b, std::ptrdiff_t plane,
                                      const Real* coefficients) {
    constexpr int W = int(V::size);
    const Vector3<V> d{V::load_unaligned(b) - x.x, V::load_unaligned(b + plane) - x.y,
                       V::load_unaligned(b + 2 * plane) - x.z};
    // The smallest normal number keeps coincident points finite and changes no other length.
    const V l2 = xsimd::fma(d.z, d.z, xsimd::fma(d.y, d.y, xsimd::fma(d.x, d.x, V(std::numeric_limits<Real>::min()))));
    const V r = scaled_reciprocal_root(l2);
    const V stiffness = V::load_aligned(coefficients);
    const V tension = V::load_aligned(coefficients + W);
    V scale;
    if constexpr (damped) {
        const Real* const bv = b + 3 * plane;
        const Vector3<V> w{V::load_unaligned(bv) - v.x, V::load_unaligned(bv + plane) - v.y,
                           V::load_unaligned(bv + 2 * plane) - v.z};
        const V rate = xsimd::fma(w.z, d.z, xsimd::fma(w.y, d.y, w.x * d.x)) * V::load_aligned(coefficients + 2 * W);
        scale = xsimd::fma(r, xsimd::fms(rate, r, tension), stiffness);
    } else {
        scale = xsimd::fnma(r, tension, stiffness);
    }
    return {scale * d.x, scale * d.y, scale * d.z};
}

template <class V, class Real, bool damped>
struct EdgeRow {
    static constexpr int W = int(V::size);
    const EdgeArguments<Real>& e;
    std::ptrdiff_t plane;

    Vector3<V> position(const Real* source, std::ptrdiff_t at) const { return load3<V>(source + at, plane); }
    Vector3<V> velocity(const Real* source, std::ptrdiff_t at) const {
        if constexpr (damped) return load3<V>(source + 3 * plane + at, plane);
        else return {};
    }
    const Real* coefficients(int k, EdgeKind kind) const {
        return e.coefficients + (e.coefficient_class[k] * edge_kind_count + kind) * EdgeCoefficientIndex::count * W;
    }
    // Where the vector `k + further` of a row begins: behind the last vector stands the first, a lane on.
    std::ptrdiff_t column(int k) const { return k < e.vectors ? std::ptrdiff_t(k) * W : std::ptrdiff_t(k - e.vectors) * W + 1; }

    CLOTHSIM_INLINE Vector3<V> force(const Vector3<V>& x, const Vector3<V>& v, const Real* source, std::ptrdiff_t at,
                                     int k, EdgeKind kind) const {
        return edge_force<damped>(x, v, source + at, plane, coefficients(k, kind));
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
    const V zero(Real(0));
    const Vector3<V> none{zero, zero, zero};

    Vector3<V> to_next = none, to_next_2 = none;  // handed on within the row
    Vector3<V> diagonal = none;                   // of the vector before, for `received`
    for (int k = 0; k < e.vectors; ++k) {
        const std::ptrdiff_t at = std::ptrdiff_t(k) * W;
        const std::ptrdiff_t next = row.column(k + 1);
        const Vector3<V> x = row.position(source.here, at);
        const Vector3<V> v = row.velocity(source.here, at);
        Vector3<V> f = none;
        if constexpr (own) f = to_next + load3<V>(e.received + at, plane);
        Vector3<V> hand_next = to_next_2;
        Vector3<V> down = none;
        if constexpr (features.bend && has_below) down = load3<V>(e.received_2 + at, plane);

        if constexpr (own && features.structural) {
            const Vector3<V> right = row.force(x, v, source.here, next, k, to_right);
            f = f + right;
            hand_next = hand_next - right;
        }
        if constexpr (own && features.bend) {
            const Vector3<V> right_2 = row.force(x, v, source.here, row.column(k + 2), k, to_right_2);
            f = f + right_2;
            to_next_2 = none - right_2;
        }
        if constexpr (vertical) {
            const Vector3<V> below = row.force(x, v, source.below, at, k, to_below);
            f = f + below;
            down = down - below;
        }
        if constexpr (shear) {
            const Vector3<V> falling = row.force(x, v, source.below, next, k, to_diagonal);
            f = f + falling;
            down = down - diagonal;
            diagonal = falling;
            const Vector3<V> rising = row.force(row.position(source.here, next), row.velocity(source.here, next),
                                                source.below, at, k, to_diagonal);
            hand_next = hand_next + rising;
            down = down - rising;
        }
        if constexpr (has_below) store3(e.received + at, plane, down);
        if constexpr (bend_down) {
            const Vector3<V> below_2 = row.force(x, v, source.below_2, at, k, to_below_2);
            f = f + below_2;
            store3(e.received_2 + at, plane, none - below_2);
        }
        if constexpr (own) store3(e.force + at, plane, f);
        to_next = hand_next;
    }
    // What was handed on past the last vector belongs to the first ones, a lane further.
    if constexpr (own) {
        store3(e.force, plane, load3<V>(e.force, plane) + shifted_lanes(to_next));
        if constexpr (features.bend) store3(e.force + W, plane, load3<V>(e.force + W, plane) + shifted_lanes(to_next_2));
    }
    if constexpr (shear) store3(e.received, plane, load3<V>(e.received, plane) - shifted_lanes(diagonal));
}

// Finish the stage for one row whose force is complete.
template <class V, class Real>
CLOTHSIM_INLINE void edge_update(const EdgeArguments<Real>& e, int row, const Real* source) {
    constexpr int W = int(V::size);
    const std::ptrdiff_t plane = std::ptrdiff_t(e.vectors) * W;
    Real* const record = e.rows + row * e.record;
    Real* const state = record + RowPlanes::state * plane;
    Real* const stage = record + RowPlanes::stage * plane;
    Real* const first = record + RowPlanes::first * plane;
    Real* const sum = record + RowPlanes::sum * plane;
    Real* const compensation = record + RowPlanes::compensation * plane;
    const bool fixed = e.row_has_fixed[row];
    const V zero(Real(0));

    for (int j = 0; j < 3; ++j) {
        const V gravity(e.gravity[j]);
        for (std::ptrdiff_t at = j * plane; at < (j + 1) * plane; at += W) {
            V a = V::load_aligned(e.force + at);
            const V vs = V::load_aligned(source + 3 * plane + at);
            if (e.point_damping != 0) a = xsimd::fnma(V(e.point_damping), vs, a);
            if (e.inverse_mass) a = a * V::load_aligned(e.inverse_mass + row * plane + at - j * plane);
            a = a + gravity;
            if (fixed) a = xsimd::select(V::load_aligned(e.free + row * plane + at - j * plane) != zero, a, zero);

            const V x = V::load_aligned(state + at);
            const V v = V::load_aligned(state + 3 * plane + at);
            const auto advance = [&](V step) {
                xsimd::fma(step, vs, x).store_aligned(stage + at);
                xsimd::fma(step, a, v).store_aligned(stage + 3 * plane + at);
            };
            switch (e.stage) {
                case Stage::evaluate:
                    a.store_aligned(first + at);
                    break;
                case Stage::first:
                    advance(V(e.half_h));
                    a.store_aligned(first + at);
                    break;
                case Stage::second:
                    advance(V(e.half_h));
                    a.store_aligned(sum + at);
                    break;
                case Stage::third:
                    advance(V(e.h));
                    (V::load_aligned(sum + at) + a).store_aligned(sum + at);
                    break;
                case Stage::fourth: {
                    const V a1 = V::load_aligned(first + at);
                    const V middle = V::load_aligned(sum + at);
                    const V dx = xsimd::fma(V(e.h), v, V(e.h2_6) * (a1 + middle));
                    const V dv = V(e.h_6) * ((a1 + a) + (middle + middle));
                    Real* const c = e.compensated ? compensation + at : nullptr;
                    add_increment(state + at, c, dx);
                    add_increment(state + 3 * plane + at, c ? c + 3 * plane : nullptr, dv);
                    break;
                }
            }
        }
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
        edge_update<V>(e, row, source.here);
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
                const V zero(Real(0));
                store3(e.received_2 + at, plane,
                       Vector3<V>{zero, zero, zero} - row.force(row.position(above_2.here, at), row.velocity(above_2.here, at),
                                                                above_2.below_2, at, k, to_below_2));
            }
        }
    }
    edge_row<Arch, Real, index, false, true, true>(e, above);
}

}  // namespace
}  // namespace clothsim
