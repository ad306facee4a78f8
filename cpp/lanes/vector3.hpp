// Three components in lanes, and what both kernels do with them. Only per-instruction-set files
// include this.
#pragma once

#include <cstddef>

#include "lanes/lanes.hpp"

namespace clothsim {
namespace {

template <class V>
struct Vector3 {
    V x, y, z;
    friend CLOTHSIM_INLINE Vector3 operator+(const Vector3& a, const Vector3& b) {
        return {a.x + b.x, a.y + b.y, a.z + b.z};
    }
    friend CLOTHSIM_INLINE Vector3 operator-(const Vector3& a, const Vector3& b) {
        return {a.x - b.x, a.y - b.y, a.z - b.z};
    }
};

template <Arithmetic arithmetic = Arithmetic::strict, class V>
CLOTHSIM_INLINE V dot(const Vector3<V>& a, const Vector3<V>& b) {
    return multiply_add<arithmetic>(a.z, b.z, multiply_add<arithmetic>(a.y, b.y, a.x * b.x));
}

template <class V, class Real>
CLOTHSIM_INLINE Vector3<V> load3(const Real* p, std::ptrdiff_t plane) {
    return {V::load_unaligned(p), V::load_unaligned(p + plane), V::load_unaligned(p + 2 * plane)};
}

template <class V, class Real>
CLOTHSIM_INLINE void store3(Real* p, std::ptrdiff_t plane, const Vector3<V>& a) {
    a.x.store_unaligned(p);
    a.y.store_unaligned(p + plane);
    a.z.store_unaligned(p + 2 * plane);
}

// Adds an increment to a state. Where there is compensation, the rounding is kept for the next step
// (Kahan 1965; Higham, Accuracy and Stability of Numerical Algorithms, section 4.3).
template <bool compensated, class V, class Real>
CLOTHSIM_INLINE void add_increment(Real* state, Real* compensation, V increment) {
    const V old = V::load_unaligned(state);
    if constexpr (compensated) {
        increment = increment + V::load_unaligned(compensation);
        const V next = old + increment;
        (increment - (next - old)).store_unaligned(compensation);
        next.store_unaligned(state);
    } else {
        (old + increment).store_unaligned(state);
    }
}

}  // namespace
}  // namespace clothsim
