// Where the mass points of some rows are, along one axis.
#pragma once

#include <limits>

#include "kernels/component_rows.hpp"
#include "kernels/lanes.hpp"

namespace clothsim {
namespace {

template <class V, class Real, class Visit>
CLOTHSIM_INLINE void each_vector(const ComponentRows<Real>& points, const Visit& visit) {
    for (int r = 0; r < points.rows; ++r)
        for (int k = 0; k < points.vectors; ++k)
            visit(V::load_unaligned(points.first + r * points.row + k * points.vector));
}

template <class Arch, class Real>
bool component_is_beyond(const ComponentRows<Real>& points, bool above, Real value) {
    using V = Lanes<Real, Arch>;
    auto good = V(value) == V(value);
    if (above)
        each_vector<V>(points,
                       [&](const V& x) __attribute__((always_inline)) { good = good & (x >= V(value)); });
    else
        each_vector<V>(points,
                       [&](const V& x) __attribute__((always_inline)) { good = good & (x <= V(value)); });
    return xsimd::all(good);
}

template <class Arch, class Real>
Extent<Real> component_extent(const ComponentRows<Real>& points) {
    using V = Lanes<Real, Arch>;
    V low(std::numeric_limits<Real>::max()), high(std::numeric_limits<Real>::lowest());
    each_vector<V>(points, [&](const V& x) __attribute__((always_inline)) {
        low = xsimd::select(x < low, x, low);
        high = xsimd::select(x > high, x, high);
    });
    return {xsimd::reduce_min(low), xsimd::reduce_max(high)};
}

}  // namespace
}  // namespace clothsim
