#include "kernels/kernels_impl.hpp"

namespace clothsim {

extern const RealKernels<double> kernels_avx512_double;
constinit const RealKernels<double> kernels_avx512_double = real_kernels<xsimd::avx512bw, double>();

}  // namespace clothsim
