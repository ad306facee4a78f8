#include "kernels/kernels_impl.hpp"

namespace clothsim {
namespace {
using Arch = xsimd::sse2;

bool supported() {
    __builtin_cpu_init();
    return __builtin_cpu_supports("sse2") != 0;
}

constexpr RealKernels<float> single = real_kernels<Arch, float>();
}  // namespace

extern const RealKernels<double> kernels_sse2_double;
extern const KernelTable kernels_sse2;
const KernelTable kernels_sse2{"sse2", CLOTHSIM_ISA_FLAGS, &supported, single, kernels_sse2_double};

}  // namespace clothsim
