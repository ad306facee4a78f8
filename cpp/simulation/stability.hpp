// How fast the modes of a cloth can be at most: what a guaranteed time step is derived from. And the energy of a run.
#pragma once

#include <utility>

#include "simulation/diagnostics.hpp"
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

// Until a sphere responds, nothing adds to the total energy of a cloth, but an unstable step does: above the stability
// limit, and below the guaranteed one at states that the guarantee leaves out. The cloth need not fly apart: waves may
// grow until it has folded itself into a shape in which they no longer do.
class EnergyWatch {
public:
    explicit EnergyWatch(const Plan& plan);

    // Forget the state where the run began.
    void restart() { started_ = grown_ = false; }
    // The run begins at the present state, unless it has begun. Nothing is watched before.
    void begin(const Engine& engine);
    bool begun() const { return started_; }

    // Of the kinetic and elastic energy at a state, the part that a run has made of nothing: more than half of it is
    // worth a warning, more than nine tenths an error. An integrator may keep an energy of its own instead of the true
    // one, from which the true one differs by a factor (1 - (omega dt / 2)^2 for Verlet's); nine tenths leave room for it.
    static constexpr double grown_part = 0.5, runaway_part = 0.9;

    // The fastest mass point if the energy has run away, else -1. `record`: what was gained goes into engine.watched.
    std::int64_t runaway_point(Engine& engine, bool record);
    // Whether the energy has grown at a recorded look; true once.
    bool take_growth() { return std::exchange(news_, false); }

private:
    Energy energy_of(const Engine& engine);

    const Plan& plan_;
    double negligible_;  // J, what stretching every spring by a thousandth takes
    double start_ = 0;   // J
    bool started_ = false, grown_ = false, news_ = false;
    Points x_, v_;
};

}  // namespace clothsim
