#include "reference/reference.hpp"

#include "collision/response.hpp"

namespace clothsim::reference {

std::vector<Spring> springs(const Cloth& cloth) {
    std::vector<Spring> result;
    for (const Neighbour& n : neighbours) {
        if (!cloth.present[n.family]) continue;
        if (n.row < 0 || (n.row == 0 && n.column < 0)) continue;  // each spring once
        for (int r = 0; r < cloth.rows; ++r)
            for (int c = 0; c < cloth.columns; ++c) {
                const int row = r + n.row, column = c + n.column;
                if (row >= cloth.rows || column < 0 || column >= cloth.columns) continue;
                result.push_back({r * cloth.columns + c, row * cloth.columns + column, cloth.rest_length(n),
                                  cloth.stiffness[n.family], cloth.spring_damping[n.family]});
            }
    }
    return result;
}

Points accelerations(const Plan& plan, const std::vector<Spring>& springs, const Points& x, const Points& v) {
    const Cloth& cloth = plan.cloth;
    Points force = -cloth.point_damping * v;
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
        else a.row(i) = force.row(i) / cloth.mass[i] + plan.gravity.transpose();
    }
    return a;
}

namespace {

void collide(const Plan& plan, Points& x, Points& v, double t) {
    for (const Sphere& sphere : plan.spheres) {
        const Contact contact(sphere, t);
        for (int i = 0; i < plan.cloth.points(); ++i) {
            const PointState point{x.row(i), v.row(i)};
            if (plan.cloth.pinned[i] || !touches(contact, point.position)) continue;
            const PointState after = respond(contact, point);
            x.row(i) = after.position;
            v.row(i) = after.velocity;
        }
    }
}

void hold_pinned(const Cloth& cloth, Points& v) {
    for (int i = 0; i < cloth.points(); ++i)
        if (cloth.pinned[i]) v.row(i).setZero();
}

}  // namespace

void step(const Plan& plan, Points& x, Points& v, double dt, std::int64_t steps, double t) {
    const std::vector<Spring> list = springs(plan.cloth);
    hold_pinned(plan.cloth, v);
    for (std::int64_t n = 0; n < steps; ++n) {
        const Points v1 = v, a1 = accelerations(plan, list, x, v1);
        const Points v2 = v + dt / 2 * a1, a2 = accelerations(plan, list, x + dt / 2 * v1, v2);
        const Points v3 = v + dt / 2 * a2, a3 = accelerations(plan, list, x + dt / 2 * v2, v3);
        const Points v4 = v + dt * a3, a4 = accelerations(plan, list, x + dt * v3, v4);
        x += dt / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
        v += dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
        collide(plan, x, v, t + double(n + 1) * dt);
    }
}

void step_as_printed(const Plan& plan, Points& x, Points& v, double dt, std::int64_t steps, double t) {
    const std::vector<Spring> list = springs(plan.cloth);
    hold_pinned(plan.cloth, v);
    for (std::int64_t n = 0; n < steps; ++n) {
        // "a" of eq 2-5 already carries the time step; eq 3-6 multiply by it once more.
        const Points v1 = dt * v, a1 = dt * accelerations(plan, list, x, v);
        const Points w2 = v + dt / 2 * a1, v2 = dt * w2, a2 = dt * accelerations(plan, list, x + dt / 2 * v1, w2);
        const Points w3 = v + dt / 2 * a2, v3 = dt * w3, a3 = dt * accelerations(plan, list, x + dt / 2 * v2, w3);
        const Points w4 = v + dt * a3, v4 = dt * w4, a4 = dt * accelerations(plan, list, x + dt * v3, w4);
        x += dt / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
        v += dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
        collide(plan, x, v, t + double(n + 1) * dt);
    }
}

}  // namespace clothsim::reference
