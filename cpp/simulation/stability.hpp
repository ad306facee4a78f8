// A time step that is guaranteed to be stable for a cloth, whatever its state.
#pragma once

#include "model/cloth.hpp"

namespace clothsim {

// Largest eigenvalue of the spring Laplacian per unit mass, from above: coefficient[f] N/m (stiffness) or
// N s/m (damping) give 1/s^2 or 1/s.
//
// On an infinite uniform grid a wave (a, b) radians per point meets, with x = cos a, y = cos b,
//   2 Ks (2 - x - y) + 4 Kh (1 - x y) + 4 Kb (2 - x^2 - y^2)
// whose maximum over the square bounds every finite cloth: leaving points out, or pinning them, leaves
// non-negative terms out of the quadratic form. 8 K structural, 12 K with shear, 16.33 K with bend.
double laplacian_bound(const Cloth& cloth, const std::array<double, family_count>& coefficient);

// dt below which classic RK4 does not amplify: min(2.6155 / sqrt(lambda), 2.785 / delta), with 2.828 when
// undamped; lambda and delta are the bounds for stiffness and damping. Infinite without forces.
double rk4_stable_dt(const Cloth& cloth);

}  // namespace clothsim
