#include "kernels/kernels_impl.hpp"

namespace clothsim {

extern const RealKernels<double> kernels_avx2_double;
constinit const RealKernels<double> kernels_avx2_double = real_kernels<xsimd::fma3<xsimd::avx2>, double>();

}  // namespace clothsim
