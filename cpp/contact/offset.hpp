// The radius offset of Kim et al., eq 13: O = sqrt((D/2)^2 + R^2) - R. Both ends of a spring of length D lie
// at distance R + O from the centre. Then the spring's midpoint just touches the sphere of radius R. Written
// without the cancellation of the printed form.
#pragma once

#include <cmath>

namespace clothsim {

inline double edge_offset(double radius, double rest_length) {
    const double half = rest_length / 2;
    return half * (half / (std::hypot(half, radius) + radius));
}

}  // namespace clothsim
