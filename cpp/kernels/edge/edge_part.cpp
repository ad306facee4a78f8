// CMake compiles this file for instruction sets with CLOTHSIM_EDGE_IN_VERSIONS, for CLOTHSIM_REAL float and
// double, and for each CLOTHSIM_PART.
#include "kernels/edge/edge_impl.hpp"
#include "kernels/kernel_table.hpp"
#include "kernels/this_instruction_set.hpp"

namespace clothsim {
namespace {

constexpr EdgeSet set_of_part{bool(CLOTHSIM_PART & 1), bool(CLOTHSIM_PART & 2)};

}  // namespace

template <>
constinit const EdgeKernels<CLOTHSIM_REAL>
    EdgePartOf<this_instruction_set, CLOTHSIM_REAL, CLOTHSIM_PART>::kernels{
        &edge_rows<ThisArch, CLOTHSIM_REAL, set_of_part>,
        &edge_last_row<ThisArch, CLOTHSIM_REAL, set_of_part>,
        &edge_halo<ThisArch, CLOTHSIM_REAL, set_of_part>};

}  // namespace clothsim
