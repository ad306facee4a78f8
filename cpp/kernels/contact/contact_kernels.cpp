// CMake compiles this file for each instruction set.
#include "kernels/contact/contact_kernels.hpp"

#include "kernels/contact/contact_impl.hpp"
#include "kernels/this_instruction_set.hpp"

namespace clothsim {

template <>
constinit const ContactKernels ContactKernelsOf<this_instruction_set>::kernels{
    &contact_rows<ThisArch, float, Arithmetic::fused>, &contact_rows<ThisArch, float, Arithmetic::strict>,
    &contact_rows<ThisArch, double, Arithmetic::fused>, &contact_rows<ThisArch, double, Arithmetic::strict>};

}  // namespace clothsim
