// Error control of one cloth: the engine's part, and the step size controller.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "forces/contacts.hpp"

namespace clothsim {

// A step is accepted where sqrt(mean over points of (|error of x| / x)^2 + (|error of v| / v)^2) <=
// 1.
struct Tolerance {
    double x = 0;  // m
    double v = 0;  // m/s
};

class AdaptiveEngine {
public:
    virtual ~AdaptiveEngine() = default;

    virtual int order() const = 0;
    // Try a step from time t. Return its error in units of the tolerance, which is not finite where
    // the result is not. The state stays.
    virtual double try_step(double t, double h, const Tolerance& tolerance, int threads) = 0;
    // Take the step that was tried, which ends at the time `t`.
    virtual void accept_step(double t) = 0;
    // Return the longest step from the state at time t, at most h, which has no kink of a motion
    // within. No point moves further than its distance from the spheres, or, in a step of at most
    // `near`, than a part of their contact radius. `after_trial`: the velocities at the end of the
    // step that was tried count too; a trial above `near` asks for no shorter one.
    virtual double contact_step(double t, double h, double near, bool after_trial) = 0;
    // Return the deepest free points in the layers of penalty obstacles at the end, time t, of the
    // step that was tried.
    virtual std::vector<Depth> trial_depths(double t) const = 0;
    // Write the state at time t within the last accepted step, before responses at its end. It
    // comes from the method's interpolant or, without an interpolant, from a step of the method
    // from the same start.
    virtual void dense(double t, double* x, double* v, int threads) = 0;
};

// Part of a sphere's contact radius that a point moves at most, relative to the sphere, in a step
// near it. A chord of that length misses what grazes the sphere by less than fraction^2 / 8 of the
// radius.
inline constexpr double contact_fraction = 0.1;

// Proportional-integral control of the step (Gustafsson, ACM TOMS 17 (1991) 533; Hairer, Wanner:
// Solving Ordinary Differential Equations II, IV.2). It converges where stability limits the step,
// instead of bouncing off the limit.
class StepController {
public:
    double h = 0;  // the next step to try [s]
    double previous_error = 1e-4;  // of the last accepted step
    bool rejected = false;         // whether the last step that was tried was

    // Return whether a step with this error is accepted, and set h.
    bool judge(double trial, double error, int order) {
        constexpr double safety = 0.9;  // of a step; not tuned: customary
        constexpr double integral_part = 0.4;  // of 1 / order, taken from the proportional one
        constexpr double least_factor = 0.2;
        constexpr double most_factor = 5;
        const bool was_rejected = std::exchange(rejected, !(error <= 1));
        if (rejected) {
            const double factor = std::isfinite(error) ? safety * std::pow(error, -1.0 / order) : 0;
            h = trial * std::max(least_factor, factor);
            return false;
        }
        const double e = std::max(error, 1e-10);
        const double beta = integral_part / order;
        const double alpha = 1.0 / order - 0.75 * beta;
        const double factor = safety * std::pow(e, -alpha) * std::pow(previous_error, beta);
        h = trial * std::clamp(factor, least_factor, was_rejected ? 1.0 : most_factor);
        previous_error = std::max(e, 1e-4);
        return true;
    }
};

}  // namespace clothsim
