// The oracle: scalar, spring by spring, written to be read beside the paper. Not optimised, and with springs
// and contact of its own: of the core it knows the scene alone. Spheres keep mass points out here, not faces.
#pragma once

#include <cstdint>
#include <vector>

#include "model/scene.hpp"

namespace clothsim::reference {

struct Spring {
    int i, j;
    double rest_length, stiffness, damping;
};

// The reference's own list, which the model's (model/stencil.hpp) is checked against.
std::vector<Spring> springs(const Cloth& cloth);

// Accelerations of all mass points; 0 for pinned ones.
Points accelerations(const Scene& scene, const std::vector<Spring>& springs, const Points& x,
                     const Points& v);

// Classic RK4 steps, the first of them from time t. x and v are advanced. The paper's responses act at the
// end of a step. A step in which a sphere with the response "continuous" touches a point is taken in short
// substeps; the paper's responses follow it. `as_printed`: Kim et al., eq 2-6 word for word,
// where the time step multiplies the slopes and the sum; kept to show that it is not consistent.
void step(const Scene& scene, Points& x, Points& v, double dt, std::int64_t steps, double t, bool as_printed);

}  // namespace clothsim::reference
