// The table of one instruction set.
#pragma once

#include "benchmark/limits_impl.hpp"
#include "kernels/edge_impl.hpp"
#include "kernels/gather_impl.hpp"

namespace clothsim {
namespace {

template <class Arch, class Real>
RestLength<Real> fused_rest_length(Real along_columns, Real along_rows) {
    using V = Lanes<Real, Arch>;
    const V x(along_columns), z(along_rows);
    const V l2 = xsimd::fma(z, z, xsimd::fma(x, x, V(smallest_squared_length<Real>)));
    return {l2.get(0), scaled_reciprocal_root(l2).get(0)};
}

template <class Arch, class Real, int... index>
constexpr RealKernels<Real> real_kernels(std::integer_sequence<int, index...>) {
    return {{&gather_tile<Arch, Real, Arithmetic::fused, index>...},
            {&gather_tile<Arch, Real, Arithmetic::strict, index>...},
            &sphere_tile<Arch, Real>,
            {&edge_last_row<Arch, Real, index>...},
            {&edge_rows<Arch, Real, index>...},
            {&edge_halo<Arch, Real, index>...},
            &edge_finish<Arch, Real>,
            root_scale<Real, Arch>(),
            &fused_rest_length<Arch, Real>,
            int(Lanes<Real, Arch>::size),
            limit_kernels<Arch, Real>()};
}

template <class Arch, class Real>
constexpr RealKernels<Real> real_kernels() {
    return real_kernels<Arch, Real>(std::make_integer_sequence<int, Features::count>{});
}

}  // namespace
}  // namespace clothsim
