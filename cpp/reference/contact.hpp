// Response "penalty" for the oracles: the force of an obstacle on a mass point, from the distance
// to its surface, in any arithmetic. cpp/forces has the law and its source.
#pragma once

#include <cmath>

#include "reference/pins.hpp"

namespace clothsim::reference {

// Add the force on a point at x with the velocity v to f [N].
template <class Real>
void add_contact(const Sphere& s, const PinState<Real>& obstacle, const Real* x, const Real* v,
                 Real* f) {
    using std::sqrt;
    const auto dot = [](const Real* a, const Real* b) {
        return Real(a[0] * b[0] + a[1] * b[1] + a[2] * b[2]);
    };
    Real away[3], n[3], u[3];
    for (int k = 0; k < 3; ++k) {
        away[k] = x[k] - obstacle.x[k];
        u[k] = v[k] - obstacle.v[k];
        n[k] = s.normal[k];  // of a plane, and in the centre of a sphere
    }
    Real gap = dot(away, n);
    if (!s.flat()) {
        const Real distance = sqrt(dot(away, away));
        if (double(distance) > 0)
            for (int k = 0; k < 3; ++k) n[k] = away[k] / distance;
        gap = distance - Real(s.radius) - Real(s.offset);
    }
    const Real d = Real(s.thickness) - gap;
    if (double(d) <= 0) return;
    const Real closing = dot(u, n);
    const Real w = Real(s.dissipation) * closing;
    const Real elastic = Real(s.stiffness) * d * d * d / (Real(s.thickness) * Real(s.thickness));
    const Real push = elastic * (Real(1) - w / sqrt(Real(1) + w * w));
    Real slip[3];
    for (int k = 0; k < 3; ++k) slip[k] = u[k] - closing * n[k];
    const Real speed = sqrt(dot(slip, slip) + Real(s.slip_speed) * Real(s.slip_speed));
    for (int k = 0; k < 3; ++k) f[k] += push * n[k] - Real(s.friction) * push / speed * slip[k];
}

}  // namespace clothsim::reference
