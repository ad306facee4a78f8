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

// scale / sqrt(a). The scale, a power of two, is what a Newton step y (3 - a y^2) = 2/sqrt(a) leaves over;
// it is folded into coefficients instead of being divided out.
template <class Real, class Arch>
constexpr Real root_scale() {
#if defined(__AVX512F__)
    return sizeof(Real) == 4 ? Real(2) : Real(16);
#else
    return Real(1);
#endif
}

template <class V>
CLOTHSIM_INLINE V scaled_reciprocal_root(V a) {
    using Real = typename V::value_type;
#if defined(__AVX512F__)
    // An estimate to 2^-14: one step gives 2^-27, two 2^-54.
    if constexpr (sizeof(Real) == 4) {
        const V y(_mm512_rsqrt14_ps(a));
        return y * xsimd::fnma(a * y, y, V(Real(3)));
    } else {
        const V y0(_mm512_rsqrt14_pd(a));
        const V y = y0 * xsimd::fnma(a * y0, y0, V(Real(3)));
        return y * xsimd::fnma(a * y, y, V(Real(12)));
    }
#else
    if constexpr (sizeof(Real) == 4) {
        // An estimate to 1.5 * 2^-12: the third-order step that leaves less than rounding does.
#if defined(__AVX__)
        const V y(_mm256_rsqrt_ps(a));
#else
        const V y(_mm_rsqrt_ps(a));
#endif
        const V e = xsimd::fnma(a * y, y, V(Real(1)));
        return xsimd::fma(y * e, xsimd::fma(e, V(Real(0.375)), V(Real(0.5))), y);
    }
    return V(Real(1)) / xsimd::sqrt(a);
#endif
}

// Lane l takes lane l - 1, lane 0 takes 0.
template <class V>
CLOTHSIM_INLINE V next_lane(V a) {
    constexpr bool single = sizeof(typename V::value_type) == 4;
#if defined(__AVX512F__)
    if constexpr (single)
        return V(_mm512_castsi512_ps(_mm512_alignr_epi32(_mm512_castps_si512(a), _mm512_setzero_si512(), 15)));
    else
        return V(_mm512_castsi512_pd(_mm512_alignr_epi64(_mm512_castpd_si512(a), _mm512_setzero_si512(), 7)));
#elif defined(__AVX2__)
    if constexpr (single)
        return V(_mm256_blend_ps(_mm256_permutevar8x32_ps(a, _mm256_setr_epi32(7, 0, 1, 2, 3, 4, 5, 6)),
                                 _mm256_setzero_ps(), 1));
    else
        return V(_mm256_blend_pd(_mm256_permute4x64_pd(a, 0x93), _mm256_setzero_pd(), 1));
#else
    if constexpr (single) return V(_mm_castsi128_ps(_mm_slli_si128(_mm_castps_si128(a), 4)));
    else return V(_mm_castsi128_pd(_mm_slli_si128(_mm_castpd_si128(a), 8)));
#endif
}

}  // namespace
}  // namespace clothsim
