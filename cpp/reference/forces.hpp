// The forces of cpp/forces for the oracles, in any arithmetic and by a code of their own, one for
// each name of the table.
#pragma once

#include <array>
#include <cmath>
#include <stdexcept>
#include <vector>

#include "reference/pins.hpp"

namespace clothsim::reference {

template <class Real>
using Vector = std::array<Real, 3>;

template <class Real>
Real dot(const Vector<Real>& a, const Vector<Real>& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Returns the force of moving air on a triangle with corners of these places and velocities.
template <class Real>
Vector<Real> wind_on(const std::array<Vector<Real>, 3>& x, const std::array<Vector<Real>, 3>& v,
                     const Vector<Real>& air, const std::vector<double>& values) {
    using std::sqrt;
    Vector<Real> p, q, u;
    for (int k = 0; k < 3; ++k) {
        p[k] = x[1][k] - x[0][k];
        q[k] = x[2][k] - x[0][k];
        u[k] = air[k] - (v[0][k] + v[1][k] + v[2][k]) / Real(3);
    }
    Vector<Real> n{p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]};
    const Real length = sqrt(dot(n, n));
    if (double(length) > 0)
        for (Real& component : n) component = component / length;
    const Real un = dot(u, n);
    const Real slow2 = Real(0.01) * Real(0.01);
    Vector<Real> ut;
    for (int k = 0; k < 3; ++k) ut[k] = u[k] - un * n[k];
    const Real half = Real(values[3]) / Real(2) * (length / Real(2));
    const Real pressure = half * Real(values[4]) * sqrt(un * un + slow2) * un;
    const Real shear = half * Real(values[5]) * sqrt(dot(ut, ut) + slow2);
    Vector<Real> force;
    for (int k = 0; k < 3; ++k) force[k] = pressure * n[k] + shear * ut[k];
    return force;
}

// Add the forces of a scene at a state to f [N]; three numbers a point in each.
template <class Real>
void add_forces(const Scene& scene, const Real* x, const Real* v, Real t, double inside, Real* f) {
    const Cloth& cloth = scene.cloth;
    const int size = 3 * cloth.points();
    for (const auto& force : scene.forces) {
        if (force->name == "drag") {
            for (int k = 0; k < size; ++k) f[k] -= Real(force->values[0]) * v[k];
        } else if (force->name == "wind") {
            const PinState<Real> moved = motion_state(force->motion, Vec3(Vec3::Zero()), t, inside);
            Vector<Real> air;
            for (int k = 0; k < 3; ++k) air[k] = Real(force->values[std::size_t(k)]) + moved.v[k];
            const auto blow = [&](const std::array<int, 3>& corners) {
                std::array<Vector<Real>, 3> at, velocity;
                for (int c = 0; c < 3; ++c)
                    for (int k = 0; k < 3; ++k) {
                        at[c][k] = x[3 * corners[c] + k];
                        velocity[c][k] = v[3 * corners[c] + k];
                    }
                const Vector<Real> on_triangle = wind_on(at, velocity, air, force->values);
                for (const int corner : corners)
                    for (int k = 0; k < 3; ++k) f[3 * corner + k] += on_triangle[k] / Real(3);
            };
            for (int row = 0; row + 1 < cloth.rows; ++row)
                for (int column = 0; column + 1 < cloth.columns; ++column) {
                    const int i = row * cloth.columns + column;
                    const int below = i + cloth.columns;
                    blow({i, i + 1, below});
                    blow({i + 1, below + 1, below});
                }
        } else if (force->name == "function") {
            std::vector<double> places(size);
            std::vector<double> speeds(size);
            std::vector<double> on_points(size, 0.0);
            for (int k = 0; k < size; ++k) {
                places[k] = double(x[k]);
                speeds[k] = double(v[k]);
            }
            force->act(cloth, {{double(t), inside}, places.data(), speeds.data()}, 0, cloth.rows,
                       on_points.data());
            for (int k = 0; k < size; ++k) f[k] += Real(on_points[k]);
        } else {
            throw std::logic_error("the oracle has no force " + force->name);
        }
    }
}

}  // namespace clothsim::reference
