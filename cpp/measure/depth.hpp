// Distance of mass points from a place, as fast as they can be read.
#pragma once

#include "kernels/contact/contact_arguments.hpp"
#include "model/sphere.hpp"

namespace clothsim {

// The least squared distance [m^2] of a row's points from `center`, in double. `row`: the row's first value
// in the layout that `geometry` describes; `lanes`: values of a vector. Padding is far away.
template <class Real>
double least_square(const Real* row, const VectorGeometry& geometry, int lanes, const Vec3& center);

}  // namespace clothsim
