#include "kernels/contact_impl.hpp"
#include "kernels/contact_kernels.hpp"

namespace clothsim {
namespace {
using Arch = xsimd::sse2;
}  // namespace

extern const ContactKernels contact_sse2;
const ContactKernels contact_sse2{
    "sse2", &contact_rows<Arch, float, Arithmetic::fused>, &contact_rows<Arch, float, Arithmetic::strict>,
    &contact_rows<Arch, double, Arithmetic::fused>, &contact_rows<Arch, double, Arithmetic::strict>};

}  // namespace clothsim
