#include "kernels/kernels_impl.hpp"

namespace clothsim {
namespace {
using Arch = xsimd::fma3<xsimd::avx2>;

bool supported() {
    __builtin_cpu_init();
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
}

constexpr RealKernels<float> single = real_kernels<Arch, float>();
}  // namespace

extern const RealKernels<double> kernels_avx2_double;
extern const KernelTable kernels_avx2;
const KernelTable kernels_avx2{"avx2", CLOTHSIM_ISA_FLAGS, &supported, single, kernels_avx2_double};

}  // namespace clothsim
