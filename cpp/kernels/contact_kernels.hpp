// The kernels of continuous contact, one instruction set each; in files of their own, which compile in seconds.
#pragma once

#include <string_view>

#include "kernels/contact_arguments.hpp"

namespace clothsim {

// Continuous contact of the rows [begin, end).
template <class Real>
using ContactKernel = void (*)(const ContactArguments<Real>&, int begin, int end);

struct ContactKernels {
    std::string_view name;  // of the instruction set, as in KernelTable
    ContactKernel<float> single, strict_single;
    ContactKernel<double> double_, strict_double;
};

// The one of the instruction set `name`.
const ContactKernels& contact_kernels(std::string_view name);

template <class Real>
ContactKernel<Real> contact_kernel(std::string_view name, bool strict) {
    const ContactKernels& kernels = contact_kernels(name);
    if constexpr (sizeof(Real) == 4) return strict ? kernels.strict_single : kernels.single;
    else return strict ? kernels.strict_double : kernels.double_;
}

}  // namespace clothsim
