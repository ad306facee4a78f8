// Numbers of the kernels that follow from a plan alone, whatever the layout.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "kernels/kernel_table.hpp"
#include "memory/plan.hpp"

namespace clothsim {

// Returns 1 / mass where it is uniform and so folded into the coefficients.
inline double coefficient_scale(const Plan& plan) {
    return plan.cloth.uniform_mass ? 1 / plan.cloth.mass[0] : 1;
}

// Returns the stiffness rounded so that a spring at rest gives no force in the edge kernel (see
// exact_at_rest). It stays unrounded where the two differ by more than rounding, as with a rest
// length of 0.
template <class Real>
Real stiffness_at_rest(const Plan& plan, const Neighbour& neighbour, Real stiffness, Real tension) {
    if (!exact_at_rest<Real>) return stiffness;
    const Cloth& cloth = plan.cloth;
    const Real at_rest = tension *
        kernels_of<Real>(*plan.kernels)
            .reciprocal_at_rest(Real(neighbour.column * cloth.column_spacing),
                                Real(neighbour.row * cloth.row_spacing));
    return std::abs(at_rest - stiffness) <= 16 * std::numeric_limits<Real>::epsilon() * stiffness
        ? at_rest
        : stiffness;
}

// Returns the damping constant that all families share as the edge kernel sees it. There is none if
// it is so small or large that single might not hold what is divided by it.
template <class Real>
std::optional<double> shared_damping(const Plan& plan) {
    const Cloth& cloth = plan.cloth;
    const double root_scale = double(kernels_of<Real>(*plan.kernels).root_scale);
    double damping = 0;
    double stiffness = 0;
    for (int f = 0; f < family_count; ++f)
        if (cloth.present[f]) {
            damping = std::max(damping, cloth.spring_damping[f]);
            stiffness = std::max(stiffness, cloth.stiffness[f]);
        }
    for (int f = 0; f < family_count; ++f)
        if (cloth.present[f] && cloth.spring_damping[f] != damping) return {};
    const double shared = damping * coefficient_scale(plan) / (root_scale * root_scale);
    const bool fits =
        stiffness * coefficient_scale(plan) <= 1e15 * shared && shared > 1e-15 && shared < 1e15;
    return fits ? std::optional(shared) : std::nullopt;
}

// `unit` is that of the accelerations that the kernel sums.
template <class Real>
StepConstants<Real> step_constants(const Plan& plan, double dt, double unit) {
    const auto g = [&](int k) { return Real(plan.gravity[k] / unit); };
    return {Real(unit),
            {g(0), g(1), g(2)},
            Real(plan.cloth.drag * coefficient_scale(plan) / unit),
            Real(dt / 2),
            Real(dt),
            Real(unit * dt / 2),
            Real(unit * dt),
            Real(unit * dt * dt / 6),
            Real(unit * dt / 6)};
}

}  // namespace clothsim
