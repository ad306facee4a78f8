// The integrators as data. Explicit Runge-Kutta methods act on (x, v); because the slope of x is v, their
// stages need no slopes of x of their own (Nystroem form): with the accelerations a_l at the stages before,
//
//   x_i = x + c_i h v + h^2 sum_l (A A)_il a_l        v_i = v + h sum_l A_il a_l
//
// and likewise for the result, with b in place of row i. It is the same method, damped or not.
#pragma once

#include <string_view>
#include <vector>

namespace clothsim {

enum class Scheme {
    rk4,
    splitting,
    verlet,
    explicit_rk,
    implicit_midpoint,
};

// Factors of the accelerations: in x times h^2, in v times h; `drift` times h is that of v in x.
struct Weights {
    double drift = 0;
    std::vector<double> x, v;
};

// An explicit method in Nystroem form. The acceleration at the result counts as one further stage.
struct ExplicitMethod {
    int stages = 0;
    std::vector<Weights> stage;  // [i] of stage i; [0] is empty: the state itself
    Weights result;

    // Adaptive methods. Error estimates: one, or two combined as in dop853.f.
    int order = 0;
    std::vector<Weights> errors;
    bool error_needs_end = false;  // the acceleration at the result

    // The interpolant, if the method has one: the factors at a part of the step.
    Weights dense(double part) const;

    std::vector<std::vector<double>> a;        // tableau; row `stages` is that of the result
    std::vector<std::vector<double>> dense_factors;  // [stage][power - 1] of the part of the step
};

// A step as drifts and kicks in turn, a drift first and last; in parts of the step.
struct Splitting {
    std::vector<double> drifts, kicks;
};

struct Method {
    std::string_view name;
    Scheme scheme;
    const ExplicitMethod* explicit_method = nullptr;
    const ExplicitMethod* damped = nullptr;  // verlet: what runs where there is damping
    const Splitting* splitting = nullptr;
};

// Throws std::invalid_argument for a name that is none.
const Method& method_of(std::string_view name);

}  // namespace clothsim
