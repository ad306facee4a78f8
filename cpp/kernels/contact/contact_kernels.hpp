// The kernels of continuous contact, of one instruction set.
#pragma once

#include "kernels/contact/contact_arguments.hpp"
#include "kernels/instruction_set.hpp"

namespace clothsim {

// Continuous contact of the rows [begin, end).
template <class Real>
using ContactKernel = void (*)(const ContactArguments<Real>&, int begin, int end);

struct ContactKernels {
    ContactKernel<float> single, strict_single;
    ContactKernel<double> double_, strict_double;

    template <class Real>
    ContactKernel<Real> of(bool strict) const {
        if constexpr (sizeof(Real) == 4) return strict ? strict_single : single;
        else return strict ? strict_double : double_;
    }
};

// In an object file of its own.
template <InstructionSet set>
struct ContactKernelsOf {
    static const ContactKernels kernels;
};

}  // namespace clothsim
