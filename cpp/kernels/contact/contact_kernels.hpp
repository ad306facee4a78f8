// The kernels of the contact pass, of one instruction set.
#pragma once

#include "kernels/contact/contact_arguments.hpp"
#include "kernels/kernel_table.hpp"

namespace clothsim {

// Each works on the rows [begin, end), in the order in which a step takes them.
template <class Real>
struct RowsOfContact {
    using Rows = void (*)(const ContactArguments<Real>&, int begin, int end);
    Rows find;  // marks points that may touch a sphere
    Rows respond;  // of marked rows
    // rho^2 of cells.
    void (*radii)(const ContactArguments<Real>&, const Real* state, int begin, int end);
    Rows lift;  // moves points outwards where rho has grown
};

struct ContactKernels {
    RowsOfContact<float> single, strict_single;
    RowsOfContact<double> double_, strict_double;

    template <class Real>
    const RowsOfContact<Real>& of(bool strict) const {
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
