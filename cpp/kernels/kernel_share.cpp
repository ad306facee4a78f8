// CMake compiles this file for each instruction set, for CLOTHSIM_REAL float and double, and for each CLOTHSIM_SHARE.
#include <utility>

#include "kernels/edge_impl.hpp"
#include "kernels/gather_impl.hpp"
#include "kernels/this_instruction_set.hpp"

namespace clothsim {
namespace {

template <class Real, int first, int... i>
constexpr KernelShare<Real> share_from(std::integer_sequence<int, i...>) {
    return {FeatureKernels<Real>{&gather_tile<ThisArch, Real, Arithmetic::fused, first + i>,
                                 &gather_tile<ThisArch, Real, Arithmetic::strict, first + i>,
                                 &edge_last_row<ThisArch, Real, first + i>, &edge_rows<ThisArch, Real, first + i>,
                                 &edge_halo<ThisArch, Real, first + i>}...};
}

}  // namespace

template <>
constinit const KernelShare<CLOTHSIM_REAL> KernelShareOf<this_instruction_set, CLOTHSIM_REAL, CLOTHSIM_SHARE>::kernels =
    share_from<CLOTHSIM_REAL, CLOTHSIM_SHARE * features_in_share>(std::make_integer_sequence<int, features_in_share>{});

}  // namespace clothsim
