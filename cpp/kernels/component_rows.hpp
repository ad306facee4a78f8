// One component of the mass points of some rows, as it lies in an engine's memory.
#pragma once

#include <cstddef>

namespace clothsim {

template <class Real>
struct ComponentRows {
    const Real* first;
    std::ptrdiff_t row, vector;  // elements from one to the next
    int rows, vectors;
};

template <class Real>
struct Extent {
    Real low, high;
};

// Whether all are on one side of a value, or at it; not if one is no number.
template <class Real>
using BeyondKernel = bool (*)(const ComponentRows<Real>&, bool above, Real value);
// The smallest and the largest; what is no number does not count.
template <class Real>
using ExtentKernel = Extent<Real> (*)(const ComponentRows<Real>&);

}  // namespace clothsim
