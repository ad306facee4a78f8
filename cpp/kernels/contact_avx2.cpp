#include "kernels/contact_impl.hpp"
#include "kernels/contact_kernels.hpp"

namespace clothsim {
namespace {
using Arch = xsimd::fma3<xsimd::avx2>;
}  // namespace

extern const ContactKernels contact_avx2;
const ContactKernels contact_avx2{
    "avx2", &contact_rows<Arch, float, Arithmetic::fused>, &contact_rows<Arch, float, Arithmetic::strict>,
    &contact_rows<Arch, double, Arithmetic::fused>, &contact_rows<Arch, double, Arithmetic::strict>};

}  // namespace clothsim
