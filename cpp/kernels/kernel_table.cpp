// CMake compiles this file for each instruction set: its table, with the kernels that no feature of a scene changes.
#include "kernels/kernel_table.hpp"

#include "benchmark/limits_impl.hpp"
#include "kernels/component_impl.hpp"
#include "kernels/edge_update.hpp"
#include "kernels/gather_impl.hpp"
#include "kernels/this_instruction_set.hpp"

namespace clothsim {
namespace {

template <class Arch, class Real>
RestLength<Real> fused_rest_length(Real along_columns, Real along_rows) {
    using V = Lanes<Real, Arch>;
    const V x(along_columns), z(along_rows);
    const V l2 = xsimd::fma(z, z, xsimd::fma(x, x, V(smallest_squared_length<Real>)));
    return {l2.get(0), scaled_reciprocal_root(l2).get(0)};
}

template <class Real, int... share>
constexpr RealKernels<Real> real_kernels(std::integer_sequence<int, share...>) {
    return {{&KernelShareOf<this_instruction_set, Real, share>::kernels...},
            &sphere_tile<ThisArch, Real>,
            &edge_finish<ThisArch, Real>,
            &component_is_beyond<ThisArch, Real>,
            &component_extent<ThisArch, Real>,
            root_scale<Real, ThisArch>(),
            &fused_rest_length<ThisArch, Real>,
            int(Lanes<Real, ThisArch>::size),
            limit_kernels<ThisArch, Real>()};
}

template <class Real>
constexpr RealKernels<Real> real_kernels() {
    return real_kernels<Real>(std::make_integer_sequence<int, share_count>{});
}

}  // namespace

template <>
constinit const KernelTable KernelTableOf<this_instruction_set>::table{
    this_instruction_set, CLOTHSIM_ISA, CLOTHSIM_ISA_FLAGS, real_kernels<float>(), real_kernels<double>(),
    ContactKernelsOf<this_instruction_set>::kernels};

}  // namespace clothsim
