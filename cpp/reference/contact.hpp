// Contact of mass points with spheres for the oracle: the formulae as the paper and docs/contact-law.md print
// them. It goes one point at a time, with nothing of the code that it judges.
#pragma once

#include <functional>
#include <vector>

#include "model/scene.hpp"

namespace clothsim::reference {

struct State {
    Vec3 x, v;  // m, m/s
};

// Section 5 of Kim et al.: the response "reflect" or "ray" of a point that lies inside the sphere at time t;
// others stay.
State respond(const Sphere& sphere, double t, const State& point);

// The response "continuous". A sphere on its straight way within a step.
struct Sweep {
    Vec3 start, end, velocity;  // of the centre
    double radius, surface;  // m; points are put on to the surface, some rounding errors further out
    double restitution, friction, push, dt;

    Sweep(const Sphere& sphere, double t0, double t1, double dt);
    double slop() const { return surface - radius; }
    // Whether a point at p, from the centre, was in the sphere by more than rounding.
    bool inside(const Vec3& p) const { return p.norm() < surface - 2 * slop(); }
};

// A mass point over one step; `potential(x)` of its springs and weight, were it at x [J].
struct FreeStep {
    State before, after;
    double mass;
    std::function<double(const Vec3&)> potential;
};

// Whether the point meets the one sphere and bounces off so fast that it is still in the air a step later.
bool bounces_off(const FreeStep& step, const Sweep& sphere);
// Its state after all contacts of the step.
State respond(const FreeStep& step, const std::vector<Sweep>& spheres);

}  // namespace clothsim::reference
