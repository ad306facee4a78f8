#include "reference/reference.hpp"

#include <cmath>

#include "reference/contact.hpp"
#include "reference/pins.hpp"

namespace clothsim::reference {

std::vector<Spring> springs(const Cloth& cloth) {
    static_assert(family_count == 3, "the reference has a list of springs of its own");
    std::vector<Spring> result;
    const auto join = [&](Family family, int row, int column, int rows, int columns) {
        const int other_row = row + rows, other_column = column + columns;
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
                     const Points& v) {
    const Cloth& cloth = scene.cloth;
    Points force = -cloth.drag * v;
    if (scene.has_force()) force += scene.force;
    for (const Spring& s : springs) {
        const Vec3 d = x.row(s.j) - x.row(s.i);
        const double l = d.norm();
        if (l == 0) continue;
        const Vec3 direction = d / l;
        const Vec3 w = v.row(s.j) - v.row(s.i);
        const Vec3 f = (s.stiffness * (l - s.rest_length) + s.damping * w.dot(direction)) * direction;
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

void collide(const Scene& scene, Points& x, Points& v, double t, double dt) {
    for (const Sphere& sphere : scene.spheres) {
        if (sphere.response == Response::continuous) continue;
        for (int i = 0; i < scene.cloth.points(); ++i) {
            if (scene.cloth.pinned[i]) continue;
            const State after = respond(sphere, t, dt, {x.row(i), v.row(i)});
            x.row(i) = after.x;
            v.row(i) = after.v;
        }
    }
}

void hold_pinned(const Cloth& cloth, Points& v) {
    for (int i = 0; i < cloth.points(); ++i)
        if (cloth.pinned[i]) v.row(i).setZero();
}

// Driven pins are where their motion has them at the time of every stage: t0 + part of the step.
void drive(const Scene& scene, Points& x, Points& v, double t0, double dt, double part) {
    // Where a velocity jumps at an end of the step, the piece within the step counts.
    const double inside = t0 + std::clamp(part, 1e-6, 1 - 1e-6) * dt;
    place_pins(scene.driven_pins, scene.pin_motions, t0 + part * dt, inside, x.data(), v.data());
}

// One step of RK4.
void advance(const Scene& scene, const std::vector<Spring>& list, Points& x, Points& v, double t0,
             double dt) {
    drive(scene, x, v, t0, dt, 0);
    const Points v1 = v, a1 = accelerations(scene, list, x, v1);
    Points x2 = x + dt / 2 * v1, v2 = v + dt / 2 * a1;
    drive(scene, x2, v2, t0, dt, 0.5);
    const Points a2 = accelerations(scene, list, x2, v2);
    Points x3 = x + dt / 2 * v2, v3 = v + dt / 2 * a2;
    drive(scene, x3, v3, t0, dt, 0.5);
    const Points a3 = accelerations(scene, list, x3, v3);
    Points x4 = x + dt * v3, v4 = v + dt * a3;
    drive(scene, x4, v4, t0, dt, 1);
    const Points a4 = accelerations(scene, list, x4, v4);
    x += dt / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
    v += dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
}

// One step in short substeps with every contact of the spheres "continuous". Returns whether there was one.
bool advance_in_contact(const Scene& scene, const std::vector<Spring>& list, Points& x, Points& v, double t0,
                        double t1) {
    // Errors of contact are as 1 / substeps of the step's: at 64 below 2 % of a bound that the step explains.
    // 32 doubles them, 128 doubles the time.
    constexpr int substeps = 64;
    bool touched = false;
    for (int k = 0; k < substeps; ++k) {
        const double begin = t0 + k * (t1 - t0) / substeps, end = t0 + (k + 1) * (t1 - t0) / substeps;
        std::vector<MovingSphere> spheres;
        for (const Sphere& sphere : scene.spheres)
            if (sphere.response == Response::continuous) spheres.emplace_back(sphere, begin, end);
        if (spheres.empty()) return false;
        const Points x0 = x, v0 = v;
        advance(scene, list, x, v, begin, end - begin);
        for (int i = 0; i < scene.cloth.points(); ++i) {
            if (scene.cloth.pinned[i]) continue;
            State point{x.row(i), v.row(i)};
            if (!respond(spheres, {x0.row(i), v0.row(i)}, point, end - begin)) continue;
            x.row(i) = point.x;
            v.row(i) = point.v;
            touched = true;
        }
    }
    return touched;
}

}  // namespace

void step(const Scene& scene, Points& x, Points& v, double dt, std::int64_t steps, double t) {
    const std::vector<Spring> list = springs(scene.cloth);
    hold_pinned(scene.cloth, v);
    for (std::int64_t n = 0; n < steps; ++n) {
        const double t0 = t + double(n) * dt, t1 = t + double(n + 1) * dt;
        Points touching_x = x, touching_v = v;
        if (advance_in_contact(scene, list, touching_x, touching_v, t0, t1)) {
            x = touching_x;
            v = touching_v;
        } else {
            advance(scene, list, x, v, t0, dt);
        }
        drive(scene, x, v, t1, dt, 0);
        collide(scene, x, v, t1, dt);
    }
}

void step_as_printed(const Scene& scene, Points& x, Points& v, double dt, std::int64_t steps, double t) {
    const std::vector<Spring> list = springs(scene.cloth);
    hold_pinned(scene.cloth, v);
    for (std::int64_t n = 0; n < steps; ++n) {
        // "a" of eq 2-5 already carries the time step; eq 3-6 multiply by it once more.
        const Points v1 = dt * v, a1 = dt * accelerations(scene, list, x, v);
        const Points w2 = v + dt / 2 * a1, v2 = dt * w2,
                     a2 = dt * accelerations(scene, list, x + dt / 2 * v1, w2);
        const Points w3 = v + dt / 2 * a2, v3 = dt * w3,
                     a3 = dt * accelerations(scene, list, x + dt / 2 * v2, w3);
        const Points w4 = v + dt * a3, v4 = dt * w4, a4 = dt * accelerations(scene, list, x + dt * v3, w4);
        x += dt / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
        v += dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
        collide(scene, x, v, t + double(n + 1) * dt, dt);
    }
}

}  // namespace clothsim::reference
