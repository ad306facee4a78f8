// CMake compiles this file for instruction sets with CLOTHSIM_EDGE_IN_VERSIONS, for CLOTHSIM_REAL
// float and double, and for each CLOTHSIM_PART.
#include "kernels/edge/edge_row.hpp"
#include "kernels/kernel_table.hpp"
#include "lanes/lanes.hpp"

namespace clothsim {

template <>
constinit const EdgeRowsKernel<CLOTHSIM_REAL> EdgePartOf<this_instruction_set, CLOTHSIM_REAL,
                                                         CLOTHSIM_PART>::rows =
    &edge_rows<ThisArch, CLOTHSIM_REAL, EdgeSet{bool(CLOTHSIM_PART & 1), bool(CLOTHSIM_PART & 2)}>;

}  // namespace clothsim
