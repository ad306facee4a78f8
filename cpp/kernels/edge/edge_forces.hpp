// The edge kernel: forces on the mass points of a row beside those of its springs.
//
// They are added to the forces on the pending row, whose stage is finished later: masses, pins and
// every stage follow by themselves.
#pragma once

#include "forces/penalty_lanes.hpp"
#include "kernels/edge/edge_stage.hpp"

namespace clothsim {
namespace {

// Adds weight a[l] to sum[l], in double.
template <class V>
CLOTHSIM_INLINE void add_sum_of_lanes(double* sum, double weight, V a) {
    const auto add = [weight](double* to, auto lanes) __attribute__((always_inline)) {
        using Doubles = decltype(lanes);
        xsimd::fma(Doubles(weight), lanes, Doubles::load_aligned(to)).store_aligned(to);
    };
    if constexpr (sizeof(typename V::value_type) == 8) {
        add(sum, a);
    } else {
        const auto halves = xsimd::widen(a);
        add(sum, halves[0]);
        add(sum + halves[0].size, halves[1]);
    }
}

// Adds the impulse and the work of forces on points, and how deep they are, scaled, to a record.
template <class V, class Real>
CLOTHSIM_INLINE void add_to_record(double* record, int lanes, const PenaltyArguments<Real>& p,
                                   const Vector3<V>& force, V depth) {
    constexpr int W = int(V::size);
    double* const tail = record + ContactRecord::tail * lanes;
    tail[ContactRecord::touched] = 1;
    add_sum_of_lanes(record, p.weight, force.x);
    add_sum_of_lanes(record + lanes, p.weight, force.y);
    add_sum_of_lanes(record + 2 * lanes, p.weight, force.z);
    if (p.moves) {
        const Vector3<V> velocity{V(p.velocity[0]), V(p.velocity[1]), V(p.velocity[2])};
        add_sum_of_lanes(record + ContactRecord::work * lanes, p.weight,
                         dot<Arithmetic::fused>(force, velocity));
    }
    if (!p.between_steps) return;
    alignas(64) Real depths[W];
    (depth * V(1 / p.scale)).store_aligned(depths);
    double* const deepest = record + ContactRecord::depth * lanes;
    for (int l = 0; l < W; ++l) deepest[l] = std::max(deepest[l], double(depths[l]));
    if (tail[ContactRecord::met] != 0 && tail[ContactRecord::first] <= p.time) return;
    tail[ContactRecord::first] = p.time;
    tail[ContactRecord::met] = 1;
}

// How the edge kernel finds the depth of a point in the layer. `direct`: from the distance to the
// centre, which costs half as much and loses what the radius rounds by.
enum class DepthMethod { flat, direct, curved };

// The law of forces/penalty.hpp in fewer operations than forces/penalty_lanes.hpp has: constants
// are folded, and the depth is scaled so that its cube is the elastic part of the push.
// a + scale b
template <class V>
CLOTHSIM_INLINE Vector3<V> added(const Vector3<V>& a, V scale, const Vector3<V>& b) {
    return {xsimd::fma(scale, b.x, a.x), xsimd::fma(scale, b.y, a.y), xsimd::fma(scale, b.z, a.z)};
}

template <class V, class Real, DepthMethod method, bool plain>
__attribute__((noinline)) void penalty_on_row(const EdgeArguments<Real>& e, const Real* source,
                                              const Real* free, const PenaltyArguments<Real>& p,
                                              double* record) {
    constexpr int W = int(V::size);
    const std::ptrdiff_t stride = source_stride<V>(e.stage);
    const V zero(Real(0));
    const V one(Real(1));
    const Vector3<V> normal{V(p.normal[0]), V(p.normal[1]), V(p.normal[2])};
    const Vector3<V> place{V(p.place[0]), V(p.place[1]), V(p.place[2])};
    const V curvature(p.curvature);
    const V scale(p.scale);
    const V scaled_reach(p.scaled_reach);
    const V scaled_radius(p.scaled_radius);
    const V dissipation(p.dissipation);
    Vector3<V> all{zero, zero, zero};
    V deepest = zero;
    bool touched = false;
    const bool between_steps = p.between_steps;
    for (int k = 0; k < e.vectors; ++k, source += stride) {
        const Vector3<V> x = load3<V>(source, W);
        Vector3<V> across =
            normal;  // the normal times the distance from the centre over the radius
        V square = one;  // of that distance over the radius
        V root = one;  // 1 / the root of the square
        V depth;                     // times the scale
        if constexpr (method == DepthMethod::flat) {
            depth = xsimd::fnma(x.x, place.x, scaled_reach);
            depth = xsimd::fnma(x.y, place.y, depth);
            depth = xsimd::fnma(x.z, place.z, depth);
        } else if constexpr (method == DepthMethod::direct) {
            across = {xsimd::fma(curvature, x.x, place.x), xsimd::fma(curvature, x.y, place.y),
                      xsimd::fma(curvature, x.z, place.z)};
            square = xsimd::max(dot<Arithmetic::fused>(across, across),
                                V(smallest_squared_length<Real>));
            root = reciprocal_root<Arithmetic::fused>(square);
            depth = xsimd::fnma(square * root, scaled_radius, scaled_reach);
        } else {
            const Vector3<V> d = x - place;
            across = {xsimd::fma(curvature, d.x, normal.x), xsimd::fma(curvature, d.y, normal.y),
                      xsimd::fma(curvature, d.z, normal.z)};
            const V level = dot<Arithmetic::fused>(d, normal + across);
            square =
                xsimd::max(xsimd::fma(curvature, level, one), V(smallest_squared_length<Real>));
            root = reciprocal_root<Arithmetic::fused>(square);
            depth = (V(p.reach) - level * inverse(xsimd::fma(square, root, one))) * scale;
        }
        depth = xsimd::max(depth, zero);
        if (free) depth = xsimd::select(V::load_aligned(free + k * W) != zero, depth, zero);
        if (xsimd::none(depth > zero)) continue;
        if constexpr (method != DepthMethod::flat) {
            const auto centre = square <= V(smallest_squared_length<Real>);
            if (__builtin_expect(xsimd::any(centre), 0)) {  // where the normal is that of the place
                across = {xsimd::select(centre, normal.x, across.x),
                          xsimd::select(centre, normal.y, across.y),
                          xsimd::select(centre, normal.z, across.z)};
                square = xsimd::select(centre, one, square);
                root = xsimd::select(centre, one, root);
            }
        }
        Vector3<V> u = load3<V>(source + 3 * W, W);
        if constexpr (!plain)
            u = u - Vector3<V>{V(p.velocity[0]), V(p.velocity[1]), V(p.velocity[2])};
        const V closing = dot<Arithmetic::fused>(u, across);
        const V q = dissipation * closing;
        const V damped = q * reciprocal_root<Arithmetic::fused>(xsimd::fma(q, q, square));
        const V elastic = depth * depth * depth;
        const V push = xsimd::fnma(elastic, damped, elastic);
        const V along = method == DepthMethod::flat ? push : push * root;
        Real* const force = e.force + k * 3 * W;
        if (between_steps) deepest = xsimd::max(deepest, depth);
        touched = true;
        if constexpr (plain) {
            store3(force, W, added(load3<V>(force, W), along, across));
            if constexpr (method == DepthMethod::flat) all.x = all.x + along;
            else all = added(all, along, across);
        } else {
            const V part = method == DepthMethod::flat ? closing : closing * (root * root);
            const Vector3<V> slip{xsimd::fnma(part, across.x, u.x),
                                  xsimd::fnma(part, across.y, u.y),
                                  xsimd::fnma(part, across.z, u.z)};
            V squares = xsimd::fma(slip.x, slip.x, V(p.slip2));
            squares = xsimd::fma(slip.y, slip.y, squares);
            squares = xsimd::fma(slip.z, slip.z, squares);
            const V resisting = V(p.friction) * push * reciprocal_root<Arithmetic::fused>(squares);
            Vector3<V> f{along * across.x, along * across.y, along * across.z};
            f = {xsimd::fnma(resisting, slip.x, f.x), xsimd::fnma(resisting, slip.y, f.y),
                 xsimd::fnma(resisting, slip.z, f.z)};
            store3(force, W, load3<V>(force, W) + f);
            all = all + f;
        }
    }
    if (!touched) return;
    if constexpr (plain && method == DepthMethod::flat)
        all = {all.x * normal.x, all.x * normal.y, all.x * normal.z};
    add_to_record(record, e.contacts.lanes, p, all, deepest);
}

// Sets in `near` a bit for each obstacle that rows [begin, end) of a stage may touch, and returns
// whether there are any. Beyond 64 obstacles a bit stands for several.
template <class Arch, class Real>
bool edge_near(const EdgeArguments<Real>& e, int begin, int end) {
    using V = Lanes<Real, Arch>;
    const std::ptrdiff_t stride = source_stride<V>(e.stage);
    std::fill(e.contacts.near + begin, e.contacts.near + end, 0);
    bool any = false;
    for (int i = 0; i < e.contacts.count; ++i) {
        const PenaltyArguments<Real>& p = e.contacts.obstacles[i];
        const V side(p.side);
        const V bound(p.bound);
        for (int row = begin; row < end; ++row) {
            const EdgeRowPointers<Real>& r = e.rows[row];
            bool near = p.axis < 0;
            if (!near) {
                const Real* x =
                    (source_is_state(e.stage) ? r.state : r.work) + p.axis * int(V::size);
                V least = side * V::load_aligned(x);
                for (int k = 1; k < e.vectors; ++k) {
                    x += stride;
                    least = xsimd::min(least, side * V::load_aligned(x));
                }
                near = xsimd::any(least < bound);
            }
            e.contacts.near[row] |= std::uint64_t(near) << (i % 64);
            any |= near;
        }
    }
    return any;
}

template <class V, class Real, bool plain>
CLOTHSIM_INLINE auto kernel_of(const PenaltyArguments<Real>& p) {
    if (p.curvature == 0) return &penalty_on_row<V, Real, DepthMethod::flat, plain>;
    if (p.direct) return &penalty_on_row<V, Real, DepthMethod::direct, plain>;
    return &penalty_on_row<V, Real, DepthMethod::curved, plain>;
}

// Adds the forces of the obstacles on the row that is pending.
template <class Arch, class Real>
void edge_forces(const EdgeArguments<Real>& e) {
    using V = Lanes<Real, Arch>;
    const std::uint64_t near = e.contacts.near[e.pending];
    for (int i = 0; near && i < e.contacts.count; ++i) {
        if (!(near >> (i % 64) & 1)) continue;
        const PenaltyArguments<Real>& p = e.contacts.obstacles[i];
        const EdgeRowPointers<Real>& row = e.rows[e.pending];
        double* const record =
            e.contacts.sums + row.row * e.contacts.row + p.number * e.contacts.obstacle;
        const bool plain = !p.moves && p.friction == 0;
        const auto act = plain ? kernel_of<V, Real, true>(p) : kernel_of<V, Real, false>(p);
        act(e, e.pending_source, row.free, p, record);
    }
}

}  // namespace
}  // namespace clothsim
