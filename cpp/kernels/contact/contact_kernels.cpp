// CMake compiles this file for each instruction set.
#include "kernels/contact/contact_kernels.hpp"

#include "kernels/contact/contact_impl.hpp"
#include "lanes/lanes.hpp"

namespace clothsim {
namespace {

template <class Real, Arithmetic arithmetic>
constexpr RowsOfContact<Real> rows_of_contact{
    &find_rows<ThisArch, Real>, &respond_rows<ThisArch, Real, arithmetic>,
    &cell_radii<ThisArch, Real, arithmetic>, &lift_rows<ThisArch, Real, arithmetic>};

}  // namespace

template <>
constinit const ContactKernels ContactKernelsOf<this_instruction_set>::kernels{
    rows_of_contact<float, Arithmetic::fused>, rows_of_contact<float, Arithmetic::strict>,
    rows_of_contact<double, Arithmetic::fused>, rows_of_contact<double, Arithmetic::strict>};

}  // namespace clothsim
