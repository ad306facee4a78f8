// How fast the modes of a cloth can be at most: what a guaranteed time step is derived from.
#pragma once

#include <array>

#include "model/cloth.hpp"

namespace clothsim {

// Largest eigenvalue of the spring Laplacian per unit mass, from above: coefficient[f] N/m (stiffness) or
// N s/m (damping) give 1/s^2 or 1/s. It is the smaller of two bounds. Pinned points only count as ends of
// springs.
//
// On an infinite uniform grid a wave of (a, b) radians per point has, with x = cos a, y = cos b,
//   2 Ks (2 - x - y) + 4 Kh (1 - x y) + 4 Kb (2 - x^2 - y^2)
// Its maximum over the square, over the lightest mass, bounds every finite cloth. Leaving points out, or
// pinning them, leaves non-negative terms out of the quadratic form. The bound is 8 K structural, 12 K with
// shear, 16.33 K with bend.
//
// Where masses differ, or the cloth is narrow, the bound by single springs may be sharper:
//   k |y_i - y_j|^2 <= k (1/m_i + 1/m_j) (m_i |y_i|^2 + m_j |y_j|^2)
// (Cauchy-Schwarz), so no eigenvalue is above the largest sum of k (1/m_i + 1/m_j) over the springs of a
// point.
double laplacian_bound(const Cloth& cloth, const std::array<double, family_count>& coefficient);

struct ModeBounds {
    double stiffness;  // 1/s^2, above every squared frequency
    double damping;    // 1/s, above every damping rate
};

ModeBounds mode_bounds(const Cloth& cloth);

}  // namespace clothsim
