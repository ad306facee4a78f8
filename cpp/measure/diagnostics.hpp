// Measures of a state: energies and penetration depth. Always in double, from plain arrays.
#pragma once

#include "forces/contacts.hpp"
#include "model/scene.hpp"

namespace clothsim {

struct Energy {
    double kinetic, elastic, gravity, force;  // J; force: the potential -F.x of forces on points
    double contact;  // J, of the layers of penalty obstacles
    double total() const { return kinetic + elastic + gravity + force + contact; }
};
// Returns the energy at the time t, where obstacles move.
Energy energy(const Scene& scene, const PointsView& x, const PointsView& v, double t);

// How fast the modes of the springs of a cloth can be at most: the stable time step is derived from
// it.
struct ModeBounds {
    double stiffness;  // 1/s^2, above every squared frequency
    double damping;    // 1/s, above every damping rate
};

ModeBounds mode_bounds(const Cloth& cloth);

// Returns the largest length over rest length - 1 of all springs; -infinity where there is no
// spring.
double largest_stretch(const Cloth& cloth, const PointsView& x);
// Deepest depth below the surface [m], never negative.
struct Penetration {
    double points, triangles;
};
Penetration penetration(int rows, int columns, const PointsView& x, const Sphere& sphere, double t);

// Returns the point of triangle (a, b, c) that is closest to p.
Vec3 closest_point_on_triangle(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c);

}  // namespace clothsim
