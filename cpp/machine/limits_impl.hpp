// The limit loops for the instruction set of the including file.
#pragma once

#include "kernels/lanes.hpp"
#include "machine/limit_kernels.hpp"

namespace clothsim {
namespace {

// Two pipes with a latency of up to five cycles are full with ten chains; half would leave them idle.
// Twelve chains and their two factors fit the sixteen registers of AVX2; twice would not.
inline constexpr int multiply_add_chains = 12;
inline constexpr int multiply_add_unroll = 4;

template <class Arch, class Real>
Real limit_multiply_add(std::int64_t rounds) {
    using V = Lanes<Real, Arch>;
    const V factor(Real(0.5)), term(Real(0.25));
    V c0(Real(0)), c1(Real(1)), c2(Real(2)), c3(Real(3)), c4(Real(4)), c5(Real(5)), c6(Real(6)), c7(Real(7)),
        c8(Real(8)), c9(Real(9)), c10(Real(10)), c11(Real(11));
    const auto all = [&] {
        c0 = xsimd::fma(c0, factor, term), c1 = xsimd::fma(c1, factor, term),
        c2 = xsimd::fma(c2, factor, term);
        c3 = xsimd::fma(c3, factor, term), c4 = xsimd::fma(c4, factor, term),
        c5 = xsimd::fma(c5, factor, term);
        c6 = xsimd::fma(c6, factor, term), c7 = xsimd::fma(c7, factor, term),
        c8 = xsimd::fma(c8, factor, term);
        c9 = xsimd::fma(c9, factor, term), c10 = xsimd::fma(c10, factor, term),
        c11 = xsimd::fma(c11, factor, term);
    };
    for (std::int64_t round = 0; round < rounds; ++round) {
        all(), all(), all(), all();
    }
    return (c0 + c1 + c2 + c3 + c4 + c5 + (c6 + c7 + c8 + c9 + c10 + c11)).get(0);
}

template <class Arch, class Real>
void limit_update(Real* a, std::ptrdiff_t n) {
    using V = Lanes<Real, Arch>;
    const V s(Real(1.0000001));
    for (std::ptrdiff_t i = 0; i < n; i += V::size) (V::load_aligned(a + i) * s).store_aligned(a + i);
}

template <class Arch, class Real>
void limit_triad(Real* a, const Real* b, const Real* c, std::ptrdiff_t n) {
    using V = Lanes<Real, Arch>;
    const V s(Real(1.5));
    for (std::ptrdiff_t i = 0; i < n; i += V::size)
        (V::load_aligned(b + i) + V::load_aligned(c + i) * s).store_aligned(a + i);
}

template <class Arch, class Real>
constexpr LimitKernels<Real> limit_kernels() {
    return {&limit_multiply_add<Arch, Real>,
            2 * multiply_add_chains * multiply_add_unroll * int(Lanes<Real, Arch>::size),
            &limit_update<Arch, Real>, &limit_triad<Arch, Real>};
}

}  // namespace
}  // namespace clothsim
