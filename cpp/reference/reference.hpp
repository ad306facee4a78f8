// The oracle: scalar, spring by spring, written to be read beside the paper. Not optimised, and
// with springs and contact of its own: of the core it knows the scene alone. Spheres keep mass
// points out here, not faces.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "model/scene.hpp"

namespace clothsim::reference {

struct Spring {
    int i, j;
    double rest_length, stiffness, damping;
};

// The reference's own list, which the model's (model/stencil.hpp) is checked against.
std::vector<Spring> springs(const Cloth& cloth);

// Returns the accelerations of all mass points; 0 for pinned ones. `inside`: where velocities of
// obstacles jump at the time t, a time in the piece that counts.
Points accelerations(const Scene& scene, const std::vector<Spring>& springs, const Points& x,
                     const Points& v, double t, double inside);

// Takes classic RK4 steps, the first of them from time t. x and v are advanced. The paper's
// responses act at the end of a step. `as_printed` takes Kim et al., eq 2-6 word for word, where
// the time step multiplies the slopes and the sum; it is kept to show that it is not consistent.
// Returns false where `interrupted`, asked now and then between two steps, is true.
bool step(const Scene& scene, Points& x, Points& v, double dt, std::int64_t steps, double t,
          bool as_printed, const std::function<bool()>& interrupted);

struct ExtrapolationSettings {
    int columns;
    double tolerance;  // error of a step, of x and of H v, in extents of the cloth
    int threads;  // columns at the same time; the bits do not depend on it
};

struct Extrapolation {
    bool interrupted = false;
    double time = 0;  // s, how far it came: less than asked where the step became too small
};

// Extrapolates from the state at time 0 to `times` (increasing, > 0), without the spheres. x and v
// hold 3 numbers a point. The states at `times` are appended to them, rounded to double. A time at
// which the velocity of a pin jumps has to be among `times`. `interrupted` is asked before each
// step.
Extrapolation extrapolate(const Scene& scene, const std::vector<double>& times,
                          const ExtrapolationSettings& settings, std::vector<double>& x,
                          std::vector<double>& v, const std::function<bool()>& interrupted);

}  // namespace clothsim::reference
