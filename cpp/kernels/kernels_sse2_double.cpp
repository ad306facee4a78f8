#include "kernels/kernels_impl.hpp"

namespace clothsim {

extern const RealKernels<double> kernels_sse2_double;
constinit const RealKernels<double> kernels_sse2_double = real_kernels<xsimd::sse2, double>();

}  // namespace clothsim
