// Loops that do nothing but what the machine is asked for, of one instruction set.
#pragma once

#include <cstddef>
#include <cstdint>

namespace clothsim {

template <class Real>
struct LimitKernels {
    // `rounds` of independent multiply-adds, `flops_per_round` floating-point operations each.
    Real (*multiply_add)(std::int64_t rounds);
    int flops_per_round;
    // a[i] *= s, the access pattern of a step that updates its state in place.
    void (*update)(Real* a, std::ptrdiff_t n);
    // a[i] = b[i] + s c[i], the triad of STREAM (McCalpin 1995).
    void (*triad)(Real* a, const Real* b, const Real* c, std::ptrdiff_t n);
};

}  // namespace clothsim
