// Four doubles at a time, as vectors of the compiler's own: for every instruction set that g++ and clang
// know.
#pragma once

#if defined(__AVX2__)
#include <immintrin.h>
#endif
#include <cstring>

#include "kernels/this_instruction_set.hpp"

#pragma GCC diagnostic ignored "-Wpsabi"  // no function here is called: all are inline

namespace clothsim {
namespace {  // of the file that includes it: compiled for an instruction set

using Four [[gnu::vector_size(32)]] = double;
using FourSingles [[gnu::vector_size(16)]] = float;

template <class V, class T>
CLOTHSIM_INLINE V loaded(const T* p, std::size_t bytes = sizeof(V)) {
    V a{};
    std::memcpy(&a, p, bytes);
    return a;
}
// g++ converts two at a time, which costs a step of `cs.step` in single up to a tenth on AVX2.
#if defined(__AVX2__)
CLOTHSIM_INLINE Four four(FourSingles a) { return _mm256_cvtps_pd(a); }
CLOTHSIM_INLINE FourSingles rounded(Four a) { return _mm256_cvtpd_ps(a); }
#else
CLOTHSIM_INLINE Four four(FourSingles a) { return __builtin_convertvector(a, Four); }
CLOTHSIM_INLINE FourSingles rounded(Four a) { return __builtin_convertvector(a, FourSingles); }
#endif
CLOTHSIM_INLINE Four four(const double* p) { return loaded<Four>(p); }
CLOTHSIM_INLINE Four four(const float* p) { return four(loaded<FourSingles>(p)); }
CLOTHSIM_INLINE Four four_of(double a) { return Four{a, a, a, a}; }
CLOTHSIM_INLINE Four two(const double* p) { return loaded<Four>(p, 16); }
CLOTHSIM_INLINE void put(double* p, Four a) { std::memcpy(p, &a, sizeof a); }
CLOTHSIM_INLINE void put(float* p, FourSingles a) { std::memcpy(p, &a, sizeof a); }
CLOTHSIM_INLINE void put(float* p, Four a) { put(p, rounded(a)); }
CLOTHSIM_INLINE void put_two(double* p, Four a) { std::memcpy(p, &a, 16); }
// Of zeros, and what is no number.
template <class V>
CLOTHSIM_INLINE bool all_zero(V a) {
    return (a[0] + a[1]) + (a[2] + a[3]) == 0;
}
CLOTHSIM_INLINE void transpose(Four (&r)[4]) {
    const Four a = __builtin_shufflevector(r[0], r[1], 0, 4, 2, 6);
    const Four b = __builtin_shufflevector(r[0], r[1], 1, 5, 3, 7);
    const Four c = __builtin_shufflevector(r[2], r[3], 0, 4, 2, 6);
    const Four d = __builtin_shufflevector(r[2], r[3], 1, 5, 3, 7);
    r[0] = __builtin_shufflevector(a, c, 0, 1, 4, 5);
    r[1] = __builtin_shufflevector(b, d, 0, 1, 4, 5);
    r[2] = __builtin_shufflevector(a, c, 2, 3, 6, 7);
    r[3] = __builtin_shufflevector(b, d, 2, 3, 6, 7);
}

}  // namespace
}  // namespace clothsim
