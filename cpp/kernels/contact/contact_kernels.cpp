// CMake compiles this file for each instruction set.
#include "kernels/contact/contact_kernels.hpp"

#include "kernels/contact/cell_impl.hpp"
#include "kernels/lanes.hpp"

namespace clothsim {
namespace {

template <class Real, Arithmetic arithmetic>
constexpr typename CellKernels<Real>::Passes cell_passes{
    &cell_rows<ThisArch, Real, arithmetic>, &cell_radii<ThisArch, Real, arithmetic>,
    &raise_rows<ThisArch, Real, arithmetic>, &stream_cells<ThisArch, Real, arithmetic>};
template <class Real>
constexpr CellKernels<Real> cell_kernels{cell_passes<Real, Arithmetic::fused>,
                                         cell_passes<Real, Arithmetic::strict>};

}  // namespace

template <>
constinit const ContactKernels ContactKernelsOf<this_instruction_set>::kernels{
    &contact_rows<ThisArch, float, Arithmetic::fused>,
    &contact_rows<ThisArch, float, Arithmetic::strict>,
    &contact_rows<ThisArch, double, Arithmetic::fused>,
    &contact_rows<ThisArch, double, Arithmetic::strict>,
    &inside_rows<ThisArch, float>,
    &inside_rows<ThisArch, double>,
    cell_kernels<float>,
    cell_kernels<double>};

}  // namespace clothsim
