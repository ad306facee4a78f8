// The gather kernel: one lane is one thread of the compute shader, one thread one mass point.
//
// A lane looks at its neighbours in the order of `neighbours` (model/cloth.hpp), sums the spring forces
// on its own point and finishes its own point's Runge-Kutta stage. Nothing is written for anybody else, so
// any number of threads gives the same bits.
//
//   force on i from the spring to j, d = x_j - x_i, w = v_j - v_i, l = |d|, L its rest length:
//   f = (K (l - L) / l + c (w.d) / l^2) d          (Kim et al., eq 1 with p_i - p_j; damping along d)
//
// and in the fused class ((c (w.d) / l - K L) / l + K) d, which is the same with fewer operations.
//
// Rows are padded: where a row has no neighbour the coefficients are 0 and the padding holds a far, finite
// point, so that no lane branches. A whole row that lacks its upper or lower neighbour skips it.
#pragma once

#include "kernels/kernel_table.hpp"
#include "kernels/vector3.hpp"

namespace clothsim {
namespace {

constexpr bool wants(Features features, Family family) {
    return family == structural ? features.structural : family == shear ? features.shear : features.bend;
}

template <Arithmetic A, class V>
CLOTHSIM_INLINE V dot(const Vector3<V>& a, const Vector3<V>& b) {
    return multiply_add<A>(a.z, b.z, multiply_add<A>(a.y, b.y, a.x * b.x));
}

template <Arithmetic A, bool damped, class V, class Real>
CLOTHSIM_INLINE void add_spring(Vector3<V>& force, const Vector3<V>& x, const Vector3<V>& v, const Real* other,
                                std::ptrdiff_t plane, const SpringCoefficients<Real>& spring,
                                std::ptrdiff_t column) {
    const Vector3<V> xj = load3<V>(other, plane);
    const Vector3<V> d = xj - x;
    const V stiffness = V::load_unaligned(spring.stiffness + column);
    const V rest = V::load_unaligned(spring.rest + column);
    V damping_force;  // c (w.d)
    if constexpr (damped) {
        const Vector3<V> w = load3<V>(other + 3 * plane, plane) - v;
        damping_force = V::load_unaligned(spring.damping + column) * dot<A>(w, d);
    }
    V scale;
    if constexpr (A == Arithmetic::strict) {
        // Coincident points: a spring without direction gives no force instead of a NaN.
        const V l = xsimd::sqrt(xsimd::max(dot<A>(d, d), V(smallest_squared_length<Real>)));
        const V r = V(Real(1)) / l;
        scale = stiffness * (l - rest);
        if constexpr (damped) scale = damping_force * r + scale;
        scale = scale * r;
    } else {
        V l2 = xsimd::fma(d.x, d.x, V(smallest_squared_length<Real>));
        l2 = xsimd::fma(d.z, d.z, xsimd::fma(d.y, d.y, l2));
        const V r = scaled_reciprocal_root(l2);
        const V pull = damped ? xsimd::fms(damping_force, r, rest) : -rest;
        scale = exact_at_rest<Real> ? pull * r + stiffness : xsimd::fma(pull, r, stiffness);
    }
    force.x = multiply_add<A>(scale, d.x, force.x);
    force.y = multiply_add<A>(scale, d.y, force.y);
    force.z = multiply_add<A>(scale, d.z, force.z);
}

template <Arithmetic A, int index, class V, class Real>
CLOTHSIM_INLINE void add_springs(Vector3<V>& force, const Vector3<V>& x, const Vector3<V>& v, const Real* point,
                                 const GatherArguments<Real>& g, int row, int column) {
    constexpr Features features = Features::from_index(index);
#pragma GCC unroll 12
    for (int n = 0; n < neighbour_count; ++n) {
        const Neighbour neighbour = neighbours[n];
        if (!wants(features, neighbour.family)) continue;
        if (row + neighbour.row < 0 || row + neighbour.row >= g.rows) continue;
        add_spring<A, features.spring_damping>(force, x, v, point + neighbour.row * g.stride + neighbour.column,
                                               g.plane, g.spring[n], column);
    }
}

template <Arithmetic A, class V, class Real>
CLOTHSIM_INLINE void finish_component(const GatherArguments<Real>& g, std::ptrdiff_t at, V v_here, V a) {
    Real* const x = g.state + at;
    Real* const v = x + 3 * g.plane;
    Real* const a1 = g.first_acceleration + at;
    Real* const sum = g.acceleration_sum + at;
    const auto advance = [&](V step) {
        multiply_add<A>(step, v_here, V::load_unaligned(x)).store_unaligned(g.target + at);
        multiply_add<A>(step, a, V::load_unaligned(v)).store_unaligned(g.target + at + 3 * g.plane);
    };
    switch (g.stage) {
        case Stage::evaluate:
            a.store_unaligned(a1);
            break;
        case Stage::first:
            advance(V(g.half_h));
            a.store_unaligned(a1);
            break;
        case Stage::second:
            advance(V(g.half_h));
            a.store_unaligned(sum);
            break;
        case Stage::third:
            advance(V(g.h));
            (V::load_unaligned(sum) + a).store_unaligned(sum);
            break;
        case Stage::fourth: {
            const V first = V::load_unaligned(a1);
            const V middle = V::load_unaligned(sum);
            const V dx = multiply_add<A>(V(g.h), V::load_unaligned(v), V(g.h2_6) * (first + middle));
            const V dv = V(g.h_6) * ((first + a) + (middle + middle));
            constexpr bool compensated = sizeof(Real) == 4;
            add_increment<compensated>(x, g.compensation + at, dx);
            add_increment<compensated>(v, g.compensation + at + 3 * g.plane, dv);
            break;
        }
    }
}

// Ask for what the next row of a cloth from memory takes: more streams than the processor follows by itself.
template <class Real>
CLOTHSIM_INLINE void fetch_next_row(const GatherArguments<Real>& g, std::ptrdiff_t at) {
    const auto fetch = [&](const Real* p, int planes, int rows = 1) __attribute__((always_inline)) {
        for (int k = 0; k < planes; ++k) __builtin_prefetch(p + at + k * g.plane + rows * g.stride, 0, 2);
    };
    const bool first = g.stage == Stage::first || g.stage == Stage::evaluate, last = g.stage == Stage::fourth;
    fetch(g.source, 6, 3);
    if (first || last) fetch(g.first_acceleration, 3);
    if (!first) fetch(g.state, 6);
    if (!first) fetch(g.acceleration_sum, 3);
    if (!last && g.stage != Stage::evaluate) fetch(g.target, 6);
    if (last && g.compensation) fetch(g.compensation, 6);
}

// `special`: something that most rows do without, mass or damping per point, pinned points or padding.
template <class V, class Real, Arithmetic A, int index, bool special>
CLOTHSIM_INLINE void gather_row(const GatherArguments<Real>& g, int row, int begin, int end) {
    const V zero(Real(0));
    for (int column = begin; column < end; column += int(V::size)) {
        const std::ptrdiff_t at = row * g.stride + column;
        const Real* const point = g.source + at;
        if (g.from_memory) fetch_next_row(g, at);
        const Vector3<V> x = load3<V>(point, g.plane);
        const Vector3<V> v = load3<V>(point + 3 * g.plane, g.plane);
        Vector3<V> a{zero, zero, zero};
        add_springs<A, index>(a, x, v, point, g, row, column);
        if constexpr (special) {
            if (g.point_damping != 0) {
                const V c(g.point_damping);
                a = {a.x - c * v.x, a.y - c * v.y, a.z - c * v.z};
            }
            if (g.inverse_mass) {
                const V w = V::load_unaligned(g.inverse_mass + at);
                a = {a.x * w, a.y * w, a.z * w};
            }
        }
        a = {a.x + V(g.gravity[0]), a.y + V(g.gravity[1]), a.z + V(g.gravity[2])};
        if constexpr (special) {
            const auto moves = V::load_unaligned(g.free + at) != zero;
            a = {xsimd::select(moves, a.x, zero), xsimd::select(moves, a.y, zero), xsimd::select(moves, a.z, zero)};
        }
        finish_component<A>(g, at, v.x, a.x);
        finish_component<A>(g, at + g.plane, v.y, a.y);
        finish_component<A>(g, at + 2 * g.plane, v.z, a.z);
    }
}

template <class Arch, class Real, Arithmetic A, int index>
void gather_tile(const GatherArguments<Real>& g, const Tile& tile) {
    using V = Lanes<Real, Arch>;
    for (int row = tile.row_begin; row < tile.row_end; ++row) {
        if (g.row_has_fixed[row] || g.inverse_mass || g.point_damping != 0)
            gather_row<V, Real, A, index, true>(g, row, tile.column_begin, tile.column_end);
        else
            gather_row<V, Real, A, index, false>(g, row, tile.column_begin, tile.column_end);
    }
}

// Section 5.1 of Kim et al. a vector at a time; the rare point inside is answered in double by the caller.
template <class Arch, class Real>
void sphere_tile(const SphereTest<Real>& test, const Tile& tile, HitCallback hit, void* context) {
    using V = Lanes<Real, Arch>;
    for (int row = tile.row_begin; row < tile.row_end; ++row) {
        for (int column = tile.column_begin; column < tile.column_end; column += int(V::size)) {
            const Vector3<V> x = load3<V>(test.position + row * test.stride + column, test.plane);
            const Vector3<V> m{x.x - V(test.center[0]), x.y - V(test.center[1]), x.z - V(test.center[2])};
            const auto inside = dot<Arithmetic::strict>(m, m) < V(test.radius_squared);
            if (__builtin_expect(xsimd::none(inside), 1)) continue;
            for (std::uint64_t mask = inside.mask(); mask != 0; mask &= mask - 1)
                hit(context, row, column + __builtin_ctzll(mask));
        }
    }
}

}  // namespace
}  // namespace clothsim
