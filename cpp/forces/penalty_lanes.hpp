// The law of forces/penalty.hpp for a vector of mass points, with exact roots and nothing fused.
// Per-instruction-set files only.
#pragma once

#include "forces/penalty_arguments.hpp"
#include "lanes/vector3.hpp"

namespace clothsim {
namespace {

// The constants of an obstacle in lanes.
template <class V>
struct PenaltyLanes {
    Vector3<V> place, normal, velocity;
    V curvature, reach, push, dissipation, friction, slip2;

    template <class Real>
    CLOTHSIM_INLINE explicit PenaltyLanes(const PenaltyArguments<Real>& p)
        : place{V(p.place[0]), V(p.place[1]), V(p.place[2])},
          normal{V(p.normal[0]), V(p.normal[1]), V(p.normal[2])},
          velocity{V(p.velocity[0]), V(p.velocity[1]), V(p.velocity[2])},
          curvature(p.curvature),
          reach(p.reach),
          push(p.push),
          dissipation(p.dissipation),
          friction(p.friction),
          slip2(p.slip2) {}
};

// Returns 1 / sqrt(a), exact or by the processor's estimate.
template <Arithmetic arithmetic, class V>
CLOTHSIM_INLINE V reciprocal_root(V a) {
    using Real = typename V::value_type;
    if constexpr (arithmetic == Arithmetic::strict) return V(Real(1)) / xsimd::sqrt(a);
    else return scaled_reciprocal_root(a) * V(1 / root_scale<Real, typename V::arch_type>());
}

// Where a point is relative to the surface.
template <class V>
struct PenaltyPlace {
    Vector3<V> across;  // the normal times `root`
    V square, root;     // 1 + kappa f and its root: the distance from the centre over the radius
    V reciprocal;       // of the root
    V depth;            // in the layer
};

template <bool flat, class V>
CLOTHSIM_INLINE PenaltyPlace<V> penalty_place(const Vector3<V>& x, const PenaltyLanes<V>& p) {
    using Real = typename V::value_type;
    const V one(Real(1));
    const Vector3<V> e = x - p.place;
    if constexpr (flat) return {p.normal, one, one, one, p.reach - dot(e, p.normal)};
    PenaltyPlace<V> at;
    at.across = {p.curvature * e.x + p.normal.x, p.curvature * e.y + p.normal.y,
                 p.curvature * e.z + p.normal.z};
    const V level = dot(e, p.normal + at.across);
    at.square = xsimd::max(p.curvature * level + one, V(smallest_squared_length<Real>));
    at.root = xsimd::sqrt(at.square);
    at.reciprocal = one / at.root;
    at.depth = p.reach - level / (one + at.root);
    return at;
}

// Returns the force on points of this depth, which is not below 0.
template <bool flat, bool rough, class V>
CLOTHSIM_INLINE Vector3<V> penalty_force(const PenaltyPlace<V>& at, V depth, const Vector3<V>& v,
                                         const PenaltyLanes<V>& p) {
    using Real = typename V::value_type;
    constexpr Arithmetic strict = Arithmetic::strict;
    Vector3<V> across = at.across;
    V square = at.square;
    V reciprocal = at.reciprocal;
    if constexpr (!flat) {  // in the centre the normal is that of the surface point
        const auto centre = square <= V(smallest_squared_length<Real>);
        const V one(Real(1));
        across = {xsimd::select(centre, p.normal.x, across.x),
                  xsimd::select(centre, p.normal.y, across.y),
                  xsimd::select(centre, p.normal.z, across.z)};
        square = xsimd::select(centre, one, square);
        reciprocal = xsimd::select(centre, one, reciprocal);
    }
    const Vector3<V> u = v - p.velocity;
    const V closing = dot(u, across);  // times the root
    const V q = p.dissipation * closing;
    const V damped = q * reciprocal_root<strict>(q * q + square);
    const V elastic = p.push * (depth * depth) * depth;
    const V push = elastic - elastic * damped;
    const V along = flat ? push : push * reciprocal;
    if constexpr (!rough) return {along * across.x, along * across.y, along * across.z};
    const V part = flat ? closing : closing * (reciprocal * reciprocal);
    const Vector3<V> slip{u.x - part * across.x, u.y - part * across.y, u.z - part * across.z};
    const V resisting = p.friction * push * reciprocal_root<strict>(p.slip2 + dot(slip, slip));
    return {along * across.x - resisting * slip.x, along * across.y - resisting * slip.y,
            along * across.z - resisting * slip.z};
}

}  // namespace
}  // namespace clothsim
