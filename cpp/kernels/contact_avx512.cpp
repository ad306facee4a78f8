#include "kernels/contact_impl.hpp"
#include "kernels/contact_kernels.hpp"

namespace clothsim {
namespace {
using Arch = xsimd::avx512bw;
}  // namespace

extern const ContactKernels contact_avx512;
const ContactKernels contact_avx512{
    "avx512", &contact_rows<Arch, float, Arithmetic::fused>, &contact_rows<Arch, float, Arithmetic::strict>,
    &contact_rows<Arch, double, Arithmetic::fused>, &contact_rows<Arch, double, Arithmetic::strict>};

}  // namespace clothsim
