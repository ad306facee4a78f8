#include "reference/reference.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "memory/poll.hpp"
#include "reference/contact.hpp"
#include "reference/forces.hpp"
#include "reference/pins.hpp"

namespace clothsim::reference {

std::vector<Spring> springs(const Cloth& cloth) {
    static_assert(family_count == 3, "the reference has a list of springs of its own");
    std::vector<Spring> result;
    const auto join = [&](Family family, int row, int column, int rows, int columns) {
        const int other_row = row + rows;
        const int other_column = column + columns;
        if (!cloth.present[family] || other_row >= cloth.rows || other_column < 0 ||
            other_column >= cloth.columns)
            return;
        result.push_back({row * cloth.columns + column, other_row * cloth.columns + other_column,
                          std::hypot(rows * cloth.row_spacing, columns * cloth.column_spacing),
                          cloth.stiffness[family], cloth.spring_damping[family]});
    };
    for (int row = 0; row < cloth.rows; ++row)
        for (int column = 0; column < cloth.columns; ++column) {
            join(structural, row, column, 0, 1);
            join(structural, row, column, 1, 0);
            join(shear, row, column, 1, 1);
            join(shear, row, column, 1, -1);
            join(bend, row, column, 0, 2);
            join(bend, row, column, 2, 0);
        }
    return result;
}

Points accelerations(const Scene& scene, const std::vector<Spring>& springs, const Points& x,
                     const Points& v, double t, double inside) {
    const Cloth& cloth = scene.cloth;
    Points force = Points::Zero(x.rows(), 3);
    add_forces(scene, x.data(), v.data(), t, inside, force.data());
    for (const Sphere& sphere : scene.spheres) {
        if (sphere.response != Response::penalty) continue;
        const auto obstacle = motion_state(sphere.motion, sphere.center, t, inside);
        for (int i = 0; i < cloth.points(); ++i)
            add_contact(sphere, obstacle, x.row(i).data(), v.row(i).data(), force.row(i).data());
    }
    if (scene.has_force()) force += scene.force;
    for (const Spring& s : springs) {
        const Vec3 d = x.row(s.j) - x.row(s.i);
        const double l = d.norm();
        if (l == 0) continue;
        const Vec3 direction = d / l;
        const Vec3 w = v.row(s.j) - v.row(s.i);
        const Vec3 f =
            (s.stiffness * (l - s.rest_length) + s.damping * w.dot(direction)) * direction;
        force.row(s.i) += f;
        force.row(s.j) -= f;
    }
    Points a(x.rows(), 3);
    for (int i = 0; i < cloth.points(); ++i) {
        if (cloth.pinned[i]) a.row(i).setZero();
        else a.row(i) = force.row(i) / cloth.mass[i] + scene.gravity.transpose();
    }
    return a;
}

namespace {

struct PointState {
    Vec3 x, v;  // m, m/s
};

Vec3 direction(const Vec3& p) {
    const double length = p.norm();
    return length > 0 ? Vec3(p / length) : Vec3(Vec3::UnitY());
}

// Returns |v|, also where v.v would overflow or vanish.
double speed_of(const Vec3& v) { return std::hypot(v[0], v[1], v[2]); }

// Turns round the velocity along n, relative to a surface of velocity `surface_velocity`, with the
// restitution, and adds Coulomb's friction. Nothing changes where the point moves away, unless
// `always`.
void bounce(Vec3& v, const Vec3& surface_velocity, const Vec3& n, double restitution,
            double friction, bool always = false) {
    const Vec3 relative = v - surface_velocity;
    const double speed = relative.dot(n);
    if (speed >= 0 && !always) return;
    const Vec3 tangential = relative - speed * n;
    const double impulse = -(1 + restitution) * speed;
    const double slip = tangential.norm();
    v += impulse * n;
    if (slip > 0) v -= std::min(1.0, friction * std::abs(impulse) / slip) * tangential;
}

// Returns the response "reflect" or "ray" (section 5 of Kim et al.) of a point that lies inside the
// sphere at time t; others stay.
PointState respond(const Sphere& sphere, double t, double dt, const PointState& point) {
    const Vec3 center = sphere.center_at(t);
    const Vec3 m = point.x - center;
    const double radius = sphere.contact_radius();
    const bool flat = sphere.flat();  // m from a place on the plane, the normal the same everywhere
    if (flat ? m.dot(sphere.normal) >= 0 : m.squaredNorm() >= radius * radius) return point;
    const Vec3 surface_velocity = sphere.as_printed ? Vec3(Vec3::Zero()) : sphere.velocity_at(t);
    const Vec3 relative = point.v - surface_velocity;
    PointState result = point;
    Vec3 n = flat ? sphere.normal : direction(m);
    double elapsed = 0;  // the surface was passed [s]
    if (sphere.response == Response::ray) {
        // Eq 8-12: back along the velocity, x - s v/|v|, to where |x - center| is the radius.
        const double speed = speed_of(relative);
        const Vec3 back = speed > 0 ? Vec3(-relative / speed) : n;
        const double b = (flat ? n : m).dot(back);
        if (b < 0 && speed > 0 && !sphere.as_printed) return point;  // leaves by itself
        // The ray ends where the point was before the step.
        const double longest =
            sphere.as_printed || speed == 0 ? std::numeric_limits<double>::infinity() : speed * dt;
        double s = 0;
        if (flat) {
            s = std::min(b > 0 ? -m.dot(n) / b : 0, longest);
            result.x += b > 0 ? Vec3(s * back) : Vec3(-m.dot(n) * n);
        } else {
            const double way = -b + std::sqrt(b * b - (m.squaredNorm() - radius * radius));
            s = std::min(way, longest);
            n = direction(m + s * back);
            result.x = s < way ? Vec3(point.x + s * back) : Vec3(center + radius * n);
        }
        if (speed > 0) elapsed = std::min(s / speed, dt);
    }
    // Eq 7 with restitution, and friction.
    bounce(result.v, surface_velocity, n, sphere.restitution, sphere.friction, sphere.as_printed);
    // A point that does not bounce for good travels the rest of the step.
    if (!sphere.as_printed && (sphere.restitution < 1 || sphere.friction > 0))
        result.x += elapsed * (result.v - surface_velocity);
    return result;
}

void collide(const Scene& scene, Points& x, Points& v, double t, double dt) {
    for (const Sphere& sphere : scene.spheres) {
        if (sphere.penalty()) continue;
        for (int i = 0; i < scene.cloth.points(); ++i) {
            if (scene.cloth.pinned[i]) continue;
            const PointState result = respond(sphere, t, dt, {x.row(i), v.row(i)});
            x.row(i) = result.x;
            v.row(i) = result.v;
        }
    }
}

// Returns a time in the piece that counts: where a velocity jumps at an end of the step, the one
// within the step.
double time_inside_step(double t0, double dt, double part) {
    return t0 + std::clamp(part, 1e-6, 1 - 1e-6) * dt;
}

// Driven pins are where their motion has them at the time of every stage: t0 + part of the step.
void place_pins_of_stage(const Scene& scene, Points& x, Points& v, double t0, double dt,
                         double part) {
    place_pins(scene.driven_pins, scene.pin_motions, t0 + part * dt, time_inside_step(t0, dt, part),
               x.data(), v.data());
}

// Takes a step of RK4.
void advance(const Scene& scene, const std::vector<Spring>& list, Points& x, Points& v, double t0,
             double dt) {
    const auto slope = [&](const Points& at, const Points& velocity, double part) {
        return accelerations(scene, list, at, velocity, t0 + part * dt,
                             time_inside_step(t0, dt, part));
    };
    place_pins_of_stage(scene, x, v, t0, dt, 0);
    const Points v1 = v;
    const Points a1 = slope(x, v1, 0);
    Points x2 = x + dt / 2 * v1;
    Points v2 = v + dt / 2 * a1;
    place_pins_of_stage(scene, x2, v2, t0, dt, 0.5);
    const Points a2 = slope(x2, v2, 0.5);
    Points x3 = x + dt / 2 * v2;
    Points v3 = v + dt / 2 * a2;
    place_pins_of_stage(scene, x3, v3, t0, dt, 0.5);
    const Points a3 = slope(x3, v3, 0.5);
    Points x4 = x + dt * v3;
    Points v4 = v + dt * a3;
    place_pins_of_stage(scene, x4, v4, t0, dt, 1);
    const Points a4 = slope(x4, v4, 1);
    x += dt / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
    v += dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
}

// Takes a step of eq 2-6 as printed: "a" of eq 2-5 already carries the time step; eq 3-6 multiply
// by it once more.
void advance_as_printed(const Scene& scene, const std::vector<Spring>& list, Points& x, Points& v,
                        double t, double dt) {
    const auto slope = [&](const Points& at, const Points& velocity) {
        return accelerations(scene, list, at, velocity, t, t);
    };
    const Points v1 = dt * v;
    const Points a1 = dt * slope(x, v);
    const Points w2 = v + dt / 2 * a1;
    const Points v2 = dt * w2;
    const Points a2 = dt * slope(x + dt / 2 * v1, w2);
    const Points w3 = v + dt / 2 * a2;
    const Points v3 = dt * w3;
    const Points a3 = dt * slope(x + dt / 2 * v2, w3);
    const Points w4 = v + dt * a3;
    const Points v4 = dt * w4;
    const Points a4 = dt * slope(x + dt * v3, w4);
    x += dt / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
    v += dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
}

}  // namespace

bool step(const Scene& scene, Points& x, Points& v, double dt, std::int64_t steps, double t,
          bool as_printed, const std::function<bool()>& interrupted) {
    Poll poll(interrupted);
    const std::vector<Spring> list = springs(scene.cloth);
    for (int i = 0; i < scene.cloth.points(); ++i)
        if (scene.cloth.pinned[i]) v.row(i).setZero();
    for (std::int64_t n = 0; n < steps; ++n) {
        if (poll.stopped()) return false;
        const double t0 = t + double(n) * dt;
        const double t1 = t + double(n + 1) * dt;
        if (as_printed) advance_as_printed(scene, list, x, v, t0, dt);
        else advance(scene, list, x, v, t0, dt);
        place_pins_of_stage(scene, x, v, t1, dt, 0);
        collide(scene, x, v, t1, dt);
    }
    return true;
}

}  // namespace clothsim::reference
