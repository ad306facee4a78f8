// The radius offset of Kim et al., eq 13: O = sqrt((D/2)^2 + R^2) - R.
// A sphere of radius R + O just touches a spring of length D whose two ends lie on it at distance R
// from the centre at the spring's midpoint. Written without the cancellation of the printed form.
#pragma once

#include <cmath>

namespace clothsim {

inline double edge_offset(double radius, double rest_length) {
    const double half = rest_length / 2;
    return half * (half / (std::hypot(half, radius) + radius));
}

}  // namespace clothsim
