// The radius offset of Kim et al., eq 13: O = sqrt((D/2)^2 + R^2) - R. Both ends of a spring of length D lie
// at distance R + O from the centre. Then the spring's midpoint just touches the sphere of radius R. Written
// without the cancellation of the printed form.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "kernels/contact/continuous.hpp"

namespace clothsim {

inline double edge_offset(double radius, double rest_length) {
    const double half = rest_length / 2;
    return half * (half / (std::hypot(half, radius) + radius));
}

// Of a sphere with the offset "cell": the band over its points' distances, as a part of them (CellBand).
inline double band_of_cells(double radius, double diagonal, bool single) {
    if (single) return CellBand::part_in_single;
    constexpr double least = 64 * std::numeric_limits<double>::epsilon();
    const double of_cell = CellBand::part_of_cell * edge_offset(radius, diagonal) / radius;
    return std::clamp(of_cell, least, CellBand::part);
}

}  // namespace clothsim
