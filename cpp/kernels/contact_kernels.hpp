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
    ContactKernel<float> single;
    ContactKernel<double> double_;
};

// The one of the instruction set `name`.
const ContactKernels& contact_kernels(std::string_view name);

template <class Real>
ContactKernel<Real> contact_kernel(std::string_view name) {
    if constexpr (sizeof(Real) == 4) return contact_kernels(name).single;
    else return contact_kernels(name).double_;
}

}  // namespace clothsim
