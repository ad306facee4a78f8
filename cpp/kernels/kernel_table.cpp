// CMake compiles this file for each instruction set: its table, with the kernels that serve every
// cloth.
#include "kernels/kernel_table.hpp"

#include "kernels/edge/edge_forces.hpp"
#include "kernels/edge/edge_general.hpp"
#include "kernels/gather/gather_impl.hpp"
#include "kernels/row_impl.hpp"
#include "lanes/lanes.hpp"

namespace clothsim {
namespace {

template <class Arch, class Real>
Real reciprocal_at_rest(Real along_columns, Real along_rows) {
    using V = Lanes<Real, Arch>;
    const V x(along_columns);
    const V z(along_rows);
    const V squared = xsimd::fma(z, z, xsimd::fma(x, x, V(smallest_squared_length<Real>)));
    return scaled_reciprocal_root(squared).get(0);
}

template <class Real>
constexpr std::array<const EdgeRowsKernel<Real>*, edge_part_count> edge_parts() {
#if defined(CLOTHSIM_EDGE_IN_VERSIONS)
    return []<int... part>(std::integer_sequence<int, part...>) {
        return std::array<const EdgeRowsKernel<Real>*, edge_part_count>{
            &EdgePartOf<this_instruction_set, Real, part>::rows...};
    }(std::make_integer_sequence<int, edge_part_count>{});
#else
    return {};
#endif
}

template <class Real>
constexpr RealKernels<Real> real_kernels() {
    return {rows_kernels<ThisArch, Real>(),    &gather_tile<ThisArch, Real>,
            &edge_rows_of_any<ThisArch, Real>, &edge_halo_of_any<ThisArch, Real>,
            &edge_finish<ThisArch, Real>,      &edge_forces<ThisArch, Real>,
            &edge_near<ThisArch, Real>,        edge_parts<Real>(),
            root_scale<Real, ThisArch>(),      &reciprocal_at_rest<ThisArch, Real>,
            int(Lanes<Real, ThisArch>::size)};
}

}  // namespace

template <>
constinit const KernelTable KernelTableOf<this_instruction_set>::table{
    this_instruction_set, CLOTHSIM_ISA, CLOTHSIM_ISA_FLAGS, real_kernels<float>(),
    real_kernels<double>()};

}  // namespace clothsim
