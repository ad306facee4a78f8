// SIMD lanes: thin names over xsimd, and the two ways to 1/l.
// Included by the per-instruction-set files only; everything sits in an anonymous namespace, so that no
// function compiled for one instruction set can be picked by the linker for another.
#pragma once

#include <xsimd/xsimd.hpp>

namespace clothsim {
namespace {

template <class Real, class Arch>
using Lanes = xsimd::batch<Real, Arch>;

#define CLOTHSIM_INLINE inline __attribute__((always_inline))

// Arithmetic class. strict: exact root and division, nothing fused, the same bits on every instruction
// set. fused: fused multiply-adds and 1/sqrt from the processor's estimate refined by Newton steps.
enum class Arithmetic { strict, fused };

template <Arithmetic arithmetic, class V>
CLOTHSIM_INLINE V multiply_add(V a, V b, V c) {
    if constexpr (arithmetic == Arithmetic::fused) return xsimd::fma(a, b, c);
    else return a * b + c;
}

// One Newton step y (3 - a y^2) / 2 for y ~ 1/sqrt(a), with the residual in one rounding.
template <class V>
CLOTHSIM_INLINE V refine_reciprocal_root(V a, V y) {
    const V half(typename V::value_type(0.5));
    const V residual = xsimd::fnma(a * y, y, V(typename V::value_type(1)));
    return xsimd::fma(y * half, residual, y);
}

template <class V>
CLOTHSIM_INLINE V reciprocal_root(V a) {
#if defined(__AVX512F__)
    if constexpr (sizeof(typename V::value_type) == 4)
        return refine_reciprocal_root(a, V(_mm512_rsqrt14_ps(a)));
    else
        return refine_reciprocal_root(a, refine_reciprocal_root(a, V(_mm512_rsqrt14_pd(a))));
#elif defined(__FMA__)
    if constexpr (sizeof(typename V::value_type) == 4)
        return refine_reciprocal_root(a, V(_mm256_rsqrt_ps(a)));
#endif
    return V(typename V::value_type(1)) / xsimd::sqrt(a);
}

}  // namespace
}  // namespace clothsim
