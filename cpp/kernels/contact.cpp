#include "kernels/contact_kernels.hpp"

namespace clothsim {

extern const ContactKernels contact_avx512, contact_avx2, contact_sse2;

const ContactKernels& contact_kernels(std::string_view name) {
    for (const ContactKernels* kernels : {&contact_avx512, &contact_avx2})
        if (kernels->name == name) return *kernels;
    return contact_sse2;
}

}  // namespace clothsim
