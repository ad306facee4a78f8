// The paper's two responses for the oracle: its formulae at the end of a step. It goes one point at a time,
// with nothing of the code that it judges.
#pragma once

#include "model/scene.hpp"

namespace clothsim::reference {

struct State {
    Vec3 x, v;  // m, m/s
};

// Section 5 of Kim et al.: the response "reflect" or "ray" of a point that lies inside the sphere at time t;
// others stay.
State respond(const Sphere& sphere, double t, double dt, const State& point);

}  // namespace clothsim::reference
