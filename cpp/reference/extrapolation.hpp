// A second opinion on a solution: another method, another arithmetic, another evaluation of the forces.
//
// Gragg's modified midpoint rule with 2, 4, ..., 2k substeps, extrapolated to substep 0 by Aitken and
// Neville. (Gragg-Bulirsch-Stoer; Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section
// II.9.) The order is 2k for k columns. The step follows the difference of the last two columns. Everything
// is computed in sums of two doubles, 106 bits, from a list of springs that the caller gives. Nothing here
// comes from the kernels or from the model's table of neighbours. So an error there, and rounding in double,
// both show as a difference.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "reference/reference.hpp"

namespace clothsim::reference {

struct System {
    std::vector<Spring> springs;
    std::vector<double> mass;  // kg
    std::vector<std::uint8_t> pinned;
    std::array<double, 3> gravity{};  // m/s^2
    double drag = 0;  // N s/m
    std::vector<double> force;  // N, 3 a point
    // A time at which the velocity of a pin jumps has to be among the times asked for.
    std::vector<DrivenPin> driven_pins;
    std::vector<Motion> pin_motions;
};

struct ExtrapolationSettings {
    int columns = 8;
    double tolerance = 1e-17;  // error of a step, of x and of H v, in extents of the cloth
    int threads = 1;  // columns at the same time; the bits do not depend on it
};

enum class ExtrapolationEnd { reached, step_too_small, interrupted };

struct Extrapolation {
    ExtrapolationEnd end = ExtrapolationEnd::reached;
    double time = 0;  // s, how far it came
    std::int64_t steps = 0, rejected = 0, force_evaluations = 0;
};

// From the state at time 0 to `times` (increasing, > 0). x and v hold 3 numbers a point. The states at
// `times` are appended to them, rounded to double. `interrupted` is asked before each step.
Extrapolation extrapolate(const System& system, const std::vector<double>& times,
                          const ExtrapolationSettings& settings, std::vector<double>& x,
                          std::vector<double>& v, const std::function<bool()>& interrupted);

}  // namespace clothsim::reference
