#include "kernels/contact_impl.hpp"
#include "kernels/contact_kernels.hpp"

namespace clothsim {
namespace {
using Arch = xsimd::sse2;
}  // namespace

extern const ContactKernels contact_sse2;
const ContactKernels contact_sse2{"sse2", &contact_rows<Arch, float>, &contact_rows<Arch, double>};

}  // namespace clothsim
