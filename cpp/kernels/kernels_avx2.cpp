#include "kernels/kernels_impl.hpp"

namespace clothsim {
namespace {
using Arch = xsimd::fma3<xsimd::avx2>;

bool supported() {
    __builtin_cpu_init();
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
}
}  // namespace

extern const KernelTable kernels_avx2;
const KernelTable kernels_avx2{"avx2", CLOTHSIM_ISA_FLAGS, &supported, real_kernels<Arch, float>(),
                               real_kernels<Arch, double>()};

}  // namespace clothsim
