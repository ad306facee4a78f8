// SIMD lanes: thin names over xsimd, and the two ways to 1/l. Only the per-instruction-set files
// include this. Everything sits in an anonymous namespace, so that the linker cannot pick a
// function of another instruction set.
#pragma once

#include <cstdint>
#include <utility>
#if defined(CLOTHSIM_PORTABLE) && defined(__AVX__)
#error "the portable kernels are compiled without AVX: take -march=native out of CXXFLAGS"
#endif
#if defined(CLOTHSIM_PORTABLE) && !defined(__aarch64__)
#define XSIMD_WITH_EMULATED 1
#endif
#include <xsimd/xsimd.hpp>

#include "lanes/instruction_set.hpp"

namespace clothsim {
namespace {

template <class Real, class Arch>
using Lanes = xsimd::batch<Real, Arch>;

#define CLOTHSIM_INLINE inline __attribute__((always_inline))

// Strict arithmetic has exact roots and divisions and fuses nothing: the bits are the same on every
// instruction set. Fused arithmetic has fused multiply-adds, and 1/sqrt from the processor's
// estimate with Newton steps after it.
enum class Arithmetic { strict, fused };

template <Arithmetic arithmetic, class V>
CLOTHSIM_INLINE V multiply_add(V a, V b, V c) {
    if constexpr (arithmetic == Arithmetic::fused) return xsimd::fma(a, b, c);
    else return a * b + c;
}

// This is added to every squared length: it keeps coincident points finite and changes no length
// that means anything. It is large enough for the estimate of 1/sqrt in single.
template <class Real>
constexpr Real smallest_squared_length = Real(1e-36);

// Returns scale / sqrt(a). The scale is what a step like y (3 - a y^2) = 2/sqrt(a) leaves over; it
// is folded into coefficients instead of being divided out.
template <class Real, class Arch>
constexpr Real root_scale() {
    [[maybe_unused]] constexpr bool single = sizeof(Real) == 4;
#if defined(__AVX512F__)
    return single ? Real(2) : Real(16);
#elif defined(__AVX2__)
    return single ? Real(2.75) : Real(1);
#else
    return Real(1);
#endif
}

// Returns a value that the compiler takes for unknown, so that it stays in a register where there
// are enough of them.
template <class V>
CLOTHSIM_INLINE V in_register(V a) {
#if defined(__AVX512F__)
    asm("" : "+v"(a.data));
#endif
    return a;
}

#if !defined(CLOTHSIM_PORTABLE)
template <class V>
CLOTHSIM_INLINE V reciprocal_root_estimate(V a) {
    constexpr bool single = sizeof(typename V::value_type) == 4;
#if defined(__AVX512F__)  // to 2^-14
    if constexpr (single) return V(_mm512_rsqrt14_ps(a));
    else return V(_mm512_rsqrt14_pd(a));
#elif defined(__AVX__)  // to 1.5 * 2^-12, single only
    if constexpr (single) return V(_mm256_rsqrt_ps(a));
    else return a;
#else
    if constexpr (single) return V(_mm_rsqrt_ps(a));
    else return a;
#endif
}
#endif

// Calls f(0), f(1), ... f(count - 1) with the index known to the compiler.
template <int count, class F>
CLOTHSIM_INLINE void each(F f) {
    [&]<int... i>(std::integer_sequence<int, i...>) __attribute__((always_inline)) {
        (f(std::integral_constant<int, i>{}), ...);
    }(std::make_integer_sequence<int, count>{});
}

// This is the 3 of the first Newton step. A step ends below the root by up to 1.5 e^2 of it. Half
// of that is added where the constant can hold it, so that the next step begins with half the
// error.
template <class Real>
constexpr Real newton_constant = sizeof(Real) == 8 ? Real(3 + 0x1.8p-28) : Real(3);

template <class V>
CLOTHSIM_INLINE V scaled_reciprocal_root(
    V a, [[maybe_unused]] V newton = V(newton_constant<typename V::value_type>)) {
    using Real = typename V::value_type;
#if defined(CLOTHSIM_PORTABLE)
    return V(Real(1)) / xsimd::sqrt(a);
#elif defined(__AVX512F__)
    // One step gives 2^-27, two 2^-54.
    V y = reciprocal_root_estimate(a);
    y = y * xsimd::fnma(a * y, y, newton);
    if constexpr (sizeof(Real) == 8) y = y * xsimd::fnma(a * y, y, V(Real(12)));
    return y;
#else
    // There is no estimate in double here, and from one in single the way is longer than the exact
    // one.
    if constexpr (sizeof(Real) == 8) return V(Real(1)) / xsimd::sqrt(a);
    // This step of third order omits less than 2^-27, less than rounding. Few bits of y are set, so
    // its square is all but exact; the product a y is not.
    const V y = reciprocal_root_estimate(a);
    const V square = y * y;
#if defined(__AVX2__)
    // The square of the series 1 + e/2 + 3/8 e^2, e = 1 - a y^2, is completed, which saves an
    // operation and a constant. The last coefficient lacks 1/33, so that the others are exact.
    const V h = xsimd::fnma(a, square, V(Real(27. / 16)));
    return y * xsimd::fma(h, h, V(Real(583. / 256)));
#else
    const V e = xsimd::fnma(a, square, V(Real(1)));
    return xsimd::fma(y * e, xsimd::fma(e, V(Real(0.375)), V(Real(0.5))), y);
#endif
#endif
}

// Returns 1/a, by the processor's estimate where that way is shorter. (xsimd::reciprocal is the
// estimate alone.)
template <class V>
CLOTHSIM_INLINE V inverse(V a) {
    using Real = typename V::value_type;
#if defined(__AVX512F__) && !defined(CLOTHSIM_PORTABLE)
    // The estimate is good to 2^-14, each Newton step doubles the bits.
    const V two(Real(2));
    if constexpr (sizeof(Real) == 4) {
        const V y(_mm512_rcp14_ps(a));
        return y * xsimd::fnma(a, y, two);
    } else {
        V y(_mm512_rcp14_pd(a));
        y = y * xsimd::fnma(a, y, two);
        return y * xsimd::fnma(a, y, two);
    }
#else
    return V(Real(1)) / a;
#endif
}

// Selects the lanes whose bit is set. (Without mask registers xsimd takes them from a table: a
// symbol that the files of all instruction sets would have in common.)
template <class V>
CLOTHSIM_INLINE typename V::batch_bool_type lanes_of(std::uint64_t bits) {
#if defined(__AVX512F__)
    return V::batch_bool_type::from_mask(bits);
#else
    using Integers =
        xsimd::batch<xsimd::as_unsigned_integer_t<typename V::value_type>, typename V::arch_type>;
    using Integer = typename Integers::value_type;
    const Integers own = [&]<int... lane>(std::integer_sequence<int, lane...>) {
        return Integers(Integer(1) << lane...);
    }(std::make_integer_sequence<int, int(V::size)>{});
    return xsimd::batch_bool_cast<typename V::value_type>((Integers(Integer(bits)) & own) == own);
#endif
}

// A choice of lanes: in memory it is a vector that has all bits in them and none in the others.
#if defined(__AVX512F__)
template <class V>
struct SomeLanes {
    typename V::batch_bool_type::register_type bits{};
};
template <class V>
CLOTHSIM_INLINE SomeLanes<V> some_lanes(const typename V::value_type* bits) {
    if constexpr (sizeof(*bits) == 4) return {_mm512_movepi32_mask(_mm512_load_si512(bits))};
    else return {_mm512_movepi64_mask(_mm512_load_si512(bits))};
}
template <class V>
CLOTHSIM_INLINE V zero_elsewhere(SomeLanes<V> lanes, V a) {
    if constexpr (sizeof(typename V::value_type) == 4) return V(_mm512_maskz_mov_ps(lanes.bits, a));
    else return V(_mm512_maskz_mov_pd(lanes.bits, a));
}
#else
template <class V>
struct SomeLanes {
    const typename V::value_type* bits = nullptr;
};
template <class V>
CLOTHSIM_INLINE SomeLanes<V> some_lanes(const typename V::value_type* bits) {
    return {bits};
}
template <class V>
CLOTHSIM_INLINE V zero_elsewhere(SomeLanes<V> lanes, V a) {
    return a & V::load_aligned(lanes.bits);
}
#endif

// Lane l takes lane l - 1, lane 0 takes 0.
template <class V>
CLOTHSIM_INLINE V next_lane(V a) {
    [[maybe_unused]] constexpr bool single = sizeof(typename V::value_type) == 4;
#if defined(CLOTHSIM_PORTABLE)
    using Bits = xsimd::as_unsigned_integer_t<typename V::value_type>;
    return xsimd::bitwise_cast<typename V::value_type>(
        xsimd::slide_left<sizeof(Bits)>(xsimd::bitwise_cast<Bits>(a)));
#elif defined(__AVX512F__)
    if constexpr (single)
        return V(_mm512_castsi512_ps(
            _mm512_alignr_epi32(_mm512_castps_si512(a), _mm512_setzero_si512(), 15)));
    else
        return V(_mm512_castsi512_pd(
            _mm512_alignr_epi64(_mm512_castpd_si512(a), _mm512_setzero_si512(), 7)));
#elif defined(__AVX2__)
    if constexpr (single)
        return V(
            _mm256_blend_ps(_mm256_permutevar8x32_ps(a, _mm256_setr_epi32(7, 0, 1, 2, 3, 4, 5, 6)),
                            _mm256_setzero_ps(), 1));
    else return V(_mm256_blend_pd(_mm256_permute4x64_pd(a, 0x93), _mm256_setzero_pd(), 1));
#else
    if constexpr (single) return V(_mm_castsi128_ps(_mm_slli_si128(_mm_castps_si128(a), 4)));
    else return V(_mm_castsi128_pd(_mm_slli_si128(_mm_castpd_si128(a), 8)));
#endif
}

// The instruction set for which a file is compiled.
#if defined(CLOTHSIM_PORTABLE)
#if XSIMD_WITH_NEON64
using ThisArch = xsimd::neon64;
#else
using ThisArch = xsimd::emulated<128>;
#endif
inline constexpr InstructionSet this_instruction_set = InstructionSet::portable;
#elif defined(__AVX512F__)
using ThisArch = xsimd::avx512bw;
inline constexpr InstructionSet this_instruction_set = InstructionSet::avx512;
#elif defined(__AVX2__)
using ThisArch = xsimd::fma3<xsimd::avx2>;
inline constexpr InstructionSet this_instruction_set = InstructionSet::avx2;
#else
using ThisArch = xsimd::sse2;
inline constexpr InstructionSet this_instruction_set = InstructionSet::sse2;
#endif

}  // namespace
}  // namespace clothsim
