// The integrators as data. Explicit Runge-Kutta methods act on (x, v). The slope of x is v, so
// their stages need no slopes of x of their own (Nystroem form). With the accelerations a_l at the
// stages before,
//
//   x_i = x + c_i h v + h^2 sum_l (A A)_il a_l        v_i = v + h sum_l A_il a_l
//
// and likewise for the result, with b in place of row i. It is the same method, damped or not.
#pragma once

#include <span>
#include <string_view>
#include <vector>

namespace clothsim {

// Factors of the accelerations: in x they are times h^2, in v times h; `drift` times h is that of v
// in x.
struct Weights {
    double drift = 0;
    std::vector<double> x, v;
};

// An explicit method in Nystroem form. The acceleration at the result counts as one further stage.
struct ExplicitMethod {
    int stages = 0;
    std::vector<Weights> stage;  // [i] of stage i; [0] is empty: the state itself
    Weights result;

    // Adaptive methods have one error estimate, or two that are combined as in dop853.f.
    int order = 0;
    std::vector<Weights> errors;
    bool error_needs_end = false;  // the acceleration at the result

    // Returns the interpolant's factors at a part of the step, if the method has one.
    Weights dense(double part) const;

    std::vector<std::vector<double>> a;  // tableau; row `stages` is that of the result
    std::vector<std::vector<double>> dense_factors;  // [stage][power - 1] of the part of the step
};

// A step is drifts and kicks in turn, a drift first and last, in parts of the step.
struct Splitting {
    std::vector<double> drifts, kicks;

    // The last acceleration of a step is the first of the next.
    bool first_same_as_last() const { return drifts.front() == 0 && drifts.back() == 0; }
};

// Returns the part of its largest energy by which an undamped oscillator's energy swings under the
// method, at omega dt. A step maps (omega x, v) by a matrix M of determinant 1, which keeps -M10
// X^2 + (M00 - M11) X V + M01 V^2. The swing is 1 minus the ratio of this form's eigenvalues, and 1
// where it is not definite: above the method's stable limit.
double energy_swing(const Splitting& splitting, double omega_dt);

struct Method {
    std::string_view name;
    const ExplicitMethod* runge_kutta = nullptr;
    const Splitting* splitting = nullptr;
    // The method that runs in place of a splitting where there is damping, if any.
    const ExplicitMethod* damped = nullptr;
    // RKC2, whose stages depend on the state: integrators/rkc2.hpp. It has error control alone.
    bool stabilised = false;
    bool in_kernels = false;  // the kernels take whole steps

    // The implicit midpoint rule, whose stage is found by Newton's method.
    bool implicit() const { return !runge_kutta && !splitting && !stabilised; }
};

// Returns all methods in the order of the documentation.
std::span<const Method> all_methods();

// Returns a method, or throws std::invalid_argument for a name that is none.
const Method& method_of(std::string_view name);

}  // namespace clothsim
