// The paper's two responses for the oracle: its formulae at the end of a step. It goes one point at a time,
// with nothing of the code that it judges.
#pragma once

#include <vector>

#include "model/scene.hpp"

namespace clothsim::reference {

struct State {
    Vec3 x, v;  // m, m/s
};

// Section 5 of Kim et al.: the response "reflect" or "ray" of a point that lies inside the sphere at time t;
// others stay.
State respond(const Sphere& sphere, double t, double dt, const State& point);

// The response "continuous" by another way than the code that it judges: laws of motion over a short substep.
// A mass point falls freely. At an impact, found by bisection in time, its normal speed turns round with the
// restitution, and Coulomb's friction acts. Forces that press it against a sphere are cancelled.
//
// Errors are of the first order in the substep h. Where a point presses with the acceleration a, its speed is
// wrong by at most a h. Each impact adds at most a h^2 to the error of its place.

// A sphere with the response "continuous", straight on its way within one substep.
struct MovingSphere {
    Vec3 start, velocity;  // of the centre; of a place on a plane
    double radius;  // of contact
    double restitution, friction, push_out_speed;
    bool flat;  // a plane
    Vec3 normal;  // of a plane

    MovingSphere(const Sphere& sphere, double t0, double t1);
    Vec3 at(double s) const { return start + s * velocity; }
    // Of a place p from the centre, or from the place on the plane.
    double height(const Vec3& p) const { return flat ? p.dot(normal) : p.norm() - radius; }
    Vec3 outward(const Vec3& p) const {
        return flat ? normal : p.norm() > 0 ? Vec3(p.normalized()) : Vec3(Vec3::UnitY());
    }
};

// `point`, a mass point's free state after a substep of length h from `before`, responds to the spheres.
// Returns whether one of them touched it.
bool respond(const std::vector<MovingSphere>& spheres, const State& before, State& point, double h);

}  // namespace clothsim::reference
