// How fast the modes of a cloth can be at most: what a guaranteed time step is derived from. And the energy of
// a run above it.
#pragma once

#include "simulation/engine.hpp"

namespace clothsim {

// Largest eigenvalue of the spring Laplacian per unit mass, from above: coefficient[f] N/m (stiffness) or
// N s/m (damping) give 1/s^2 or 1/s. It is the smaller of two bounds. Pinned points only count as ends of springs.
//
// On an infinite uniform grid a wave (a, b) radians per point meets, with x = cos a, y = cos b,
//   2 Ks (2 - x - y) + 4 Kh (1 - x y) + 4 Kb (2 - x^2 - y^2)
// whose maximum over the square, over the lightest mass, bounds every finite cloth: leaving points out, or
// pinning them, leaves non-negative terms out of the quadratic form. 8 K structural, 12 K with shear,
// 16.33 K with bend.
//
// Where masses differ, or the cloth is narrow, each spring alone may tell more:
//   k |y_i - y_j|^2 <= k (1/m_i + 1/m_j) (m_i |y_i|^2 + m_j |y_j|^2)
// (Cauchy-Schwarz), so no eigenvalue is above the largest sum of k (1/m_i + 1/m_j) over the springs of a point.
double laplacian_bound(const Cloth& cloth, const std::array<double, family_count>& coefficient);

struct ModeBounds {
    double stiffness;  // 1/s^2, above every squared frequency
    double damping;    // 1/s, above every damping rate
};

ModeBounds mode_bounds(const Cloth& cloth);

// Above the stability limit a cloth need not fly apart: waves may grow until it has folded itself into a shape
// in which they no longer do. Energy tells: without spheres nothing adds to the total, but an unstable step does.
class EnergyWatch {
public:
    explicit EnergyWatch(const Plan& plan);

    // Forget the state where the run began; the next look is at a new beginning.
    void restart() { started_ = false; }

    // The fastest mass point if nearly all kinetic and elastic energy is more than the run began with, else -1.
    // An integrator may keep an energy of its own instead of the true one, from which the true one differs by a
    // factor (1 - (omega dt / 2)^2 for Verlet's); what it swings by is not mistaken for growth.
    std::int64_t runaway_point(const Engine& engine);

private:
    const Plan& plan_;
    double negligible_;  // J, what stretching every spring by a thousandth takes
    double start_ = 0;   // J
    bool started_ = false;
};

}  // namespace clothsim
