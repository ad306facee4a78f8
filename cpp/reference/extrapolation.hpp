// A second opinion on a solution: another method, another arithmetic, another evaluation of the forces.
//
// Gragg's modified midpoint rule with 2, 4, ..., 2k substeps, extrapolated to substep 0 by Aitken and
// Neville. (Gragg-Bulirsch-Stoer; Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section
// II.9.) The order is 2k for k columns. The step follows the difference of the last two columns. Everything
// is computed in sums of two doubles, 106 bits, from the reference's own list of springs. So an error in the
// kernels or in the model's list, and rounding in double, both show as a difference.
#pragma once

#include <functional>
#include <vector>

#include "model/scene.hpp"

namespace clothsim::reference {

struct ExtrapolationSettings {
    int columns;
    double tolerance;  // error of a step, of x and of H v, in extents of the cloth
    int threads;  // columns at the same time; the bits do not depend on it
};

struct Extrapolation {
    bool interrupted = false;
    double time = 0;  // s, how far it came: less than asked where the step became too small
};

// From the state at time 0 to `times` (increasing, > 0), without the spheres. x and v hold 3 numbers a point.
// The states at `times` are appended to them, rounded to double. A time at which the velocity of a pin jumps
// has to be among `times`. `interrupted` is asked before each step.
Extrapolation extrapolate(const Scene& scene, const std::vector<double>& times,
                          const ExtrapolationSettings& settings, std::vector<double>& x,
                          std::vector<double>& v, const std::function<bool()>& interrupted);

}  // namespace clothsim::reference
