#include "kernels/kernels_impl.hpp"

namespace clothsim {
namespace {
using Arch = xsimd::avx512bw;

bool supported() {
    __builtin_cpu_init();
    return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512cd") &&
           __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw");
}

constexpr RealKernels<float> single = real_kernels<Arch, float>();
}  // namespace

extern const RealKernels<double> kernels_avx512_double;
extern const KernelTable kernels_avx512;
const KernelTable kernels_avx512{"avx512", CLOTHSIM_ISA_FLAGS, &supported, single, kernels_avx512_double};

}  // namespace clothsim
