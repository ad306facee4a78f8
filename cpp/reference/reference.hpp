// The oracle: scalar, spring by spring, written to be read beside the paper. Not optimised.
#pragma once

#include "simulation/diagnostics.hpp"
#include "simulation/plan.hpp"

namespace clothsim::reference {

struct Spring {
    int i, j;
    double rest_length, stiffness, damping;
};

std::vector<Spring> springs(const Cloth& cloth);

// Accelerations of all mass points; 0 for pinned ones.
Points accelerations(const Plan& plan, const std::vector<Spring>& springs, const Points& x, const Points& v);

// Classic RK4 steps followed by the collision pass, the first of them from time t. x and v are advanced.
void step(const Plan& plan, Points& x, Points& v, double dt, std::int64_t steps, double t);

// Kim et al., eq 2-6 as printed: the time step multiplies the slopes and the sum. Kept to show that it is
// not consistent.
void step_as_printed(const Plan& plan, Points& x, Points& v, double dt, std::int64_t steps, double t);

}  // namespace clothsim::reference
