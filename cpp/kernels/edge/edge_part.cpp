// CMake compiles this file for instruction sets with CLOTHSIM_EDGE_IN_VERSIONS, for CLOTHSIM_REAL float and
// double, and for each CLOTHSIM_PART.
#include "kernels/edge/edge_impl.hpp"
#include "kernels/kernel_table.hpp"
#include "kernels/this_instruction_set.hpp"

namespace clothsim {
namespace {

template <class Real, bool shear>
constexpr EdgeKernels<Real> kernels_of_set() {
    constexpr EdgeSet set{shear, bool(CLOTHSIM_PART & 1), bool(CLOTHSIM_PART & 2)};
    return {&edge_rows<ThisArch, Real, set>, &edge_last_row<ThisArch, Real, set>,
            &edge_halo<ThisArch, Real, set>};
}

}  // namespace

template <>
constinit const EdgePart<CLOTHSIM_REAL>
    EdgePartOf<this_instruction_set, CLOTHSIM_REAL, CLOTHSIM_PART>::kernels{
        kernels_of_set<CLOTHSIM_REAL, false>(), kernels_of_set<CLOTHSIM_REAL, true>()};

}  // namespace clothsim
