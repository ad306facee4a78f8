// State of either precision read and written as vectors of doubles: what continuous contact decides, it
// decides in double. Per-instruction-set files only.
#pragma once

#include <cstddef>

#include "kernels/lanes.hpp"

namespace clothsim {
namespace {

// Vectors of doubles out of and into memory of Real.
template <class Arch, class Real>
struct Wide {
    using D = xsimd::batch<double, Arch>;
    static constexpr int N = int(D::size);
    typedef double Doubles __attribute__((vector_size(8 * N)));
    typedef Real Reals __attribute__((vector_size(sizeof(Real) * N)));

    static CLOTHSIM_INLINE Reals load(const Real* p) {
        Reals a;
        __builtin_memcpy(&a, p, sizeof a);
        return a;
    }
    static CLOTHSIM_INLINE void store(Real* p, const Reals& a) { __builtin_memcpy(p, &a, sizeof a); }
    static CLOTHSIM_INLINE Doubles widen(const Reals& a) { return __builtin_convertvector(a, Doubles); }
    static CLOTHSIM_INLINE Reals narrow(const Doubles& a) { return __builtin_convertvector(a, Reals); }
    // Copied, not cast: the register of an emulated vector is an array.
    static CLOTHSIM_INLINE D batch(const Doubles& a) {
        D b;
        __builtin_memcpy(&b.data, &a, sizeof a);
        return b;
    }
    static CLOTHSIM_INLINE Doubles doubles(const D& a) {
        Doubles b;
        __builtin_memcpy(&b, &a.data, sizeof b);
        return b;
    }

    static CLOTHSIM_INLINE D read(const Real* p, std::ptrdiff_t compensation) {
        if constexpr (sizeof(Real) == 4) return batch(widen(load(p)) + widen(load(p + compensation)));
        else return batch(load(p));
    }
    // Only where `chosen` is not 0.
    static CLOTHSIM_INLINE void write(Real* p, const D& value, const D& chosen) {
        store(p, narrow(doubles(chosen)) != 0 ? narrow(doubles(value)) : load(p));
    }
    static CLOTHSIM_INLINE void write(Real* p, std::ptrdiff_t compensation, const D& value, const D& chosen) {
        const Doubles wide = doubles(value);
        const Reals rounded = narrow(wide);
        const auto here = narrow(doubles(chosen)) != 0;
        store(p, here ? rounded : load(p));
        if constexpr (sizeof(Real) == 4)
            store(p + compensation, here ? narrow(wide - widen(rounded)) : load(p + compensation));
    }
};

}  // namespace
}  // namespace clothsim
