// The kernels of continuous contact, of one instruction set.
#pragma once

#include "kernels/contact/cell_arguments.hpp"
#include "kernels/instruction_set.hpp"

namespace clothsim {

// Continuous contact of the rows [begin, end).
template <class Real>
using ContactKernel = void (*)(const ContactArguments<Real>&, int begin, int end);

// "reflect" and "ray": calls a.unresolved for the points inside at the end of a step.
template <class Real>
using InsideKernel = void (*)(const ContactArguments<Real>& a, const Real* center, Real radius2, int begin,
                              int end);

// The passes of offset "cell", in the order in which a step takes them; each of the rows [begin, end).
template <class Real>
struct CellKernels {
    using Rows = void (*)(const CellArguments<Real>&, int begin, int end);
    struct Passes {
        Rows respond;
        void (*radii)(const CellArguments<Real>&, const Real* state, int begin, int end);  // rho^2 of cells
        Rows raise;  // moves points outwards where rho has grown
        int (*stream)(const CellArguments<Real>&);  // all three, row after row
    };
    Passes fused, strict;
};

struct ContactKernels {
    ContactKernel<float> single, strict_single;
    ContactKernel<double> double_, strict_double;
    InsideKernel<float> inside_single;
    InsideKernel<double> inside_double;
    CellKernels<float> cells_single;
    CellKernels<double> cells_double;

    template <class Real>
    const typename CellKernels<Real>::Passes& cells(bool strict) const {
        if constexpr (sizeof(Real) == 4) return strict ? cells_single.strict : cells_single.fused;
        else return strict ? cells_double.strict : cells_double.fused;
    }

    template <class Real>
    InsideKernel<Real> inside() const {
        if constexpr (sizeof(Real) == 4) return inside_single;
        else return inside_double;
    }
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
