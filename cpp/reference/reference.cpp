#include "reference/reference.hpp"

#include <algorithm>
#include <limits>

#include "collision/exact.hpp"
#include "collision/response.hpp"
#include "simulation/face_pass.hpp"

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
        if (sphere.response == Response::continuous) continue;
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

// The cloth at the two ends of a step, as collision/exact.hpp asks for it.
struct BothEnds {
    const Plan& plan;
    const Points &x0, &v0;
    Points &x, &v;

    PointState before(int i) const { return {x0.row(i), v0.row(i)}; }
    PointState now(int i) const { return {x.row(i), v.row(i)}; }
    Vec3 position(int i) const { return x.row(i); }
    void set(int i, const PointState& state) {
        x.row(i) = state.position;
        v.row(i) = state.velocity;
    }
    bool pinned(int i) const { return plan.cloth.pinned[std::size_t(i)]; }
    double mass(int i) const { return plan.cloth.mass[std::size_t(i)]; }
    const Vec3& gravity() const { return plan.gravity; }
    double spring_energy(int i, const Vec3& at) const {
        return clothsim::spring_energy(plan.cloth, i, at, [this](int j) { return position(j); });
    }
};

// Continuous contact from (x0, v0) at t0 to the free end (x, v) at t1.
void meet_spheres(const Plan& plan, const Points& x0, const Points& v0, Points& x, Points& v, double t0, double t1,
                  double dt) {
    std::vector<SweptSphere> all;
    std::vector<bool> faces;
    for (const Sphere& sphere : plan.spheres) {
        if (sphere.response != Response::continuous) continue;
        all.push_back(swept(sphere, t0, t1, dt, std::numeric_limits<double>::epsilon()));
        faces.push_back(sphere.faces);
    }
    if (all.empty()) return;
    if (std::find(faces.begin(), faces.end(), true) != faces.end()) {
        const auto whole = make_face_pass(plan.cloth, plan.gravity, faces);
        FacePass& pass = *whole;
        for (int i = 0; i < plan.cloth.points(); ++i) {
            const std::size_t k = std::size_t(i);
            pass.x0[k] = x0.row(i), pass.v0[k] = v0.row(i), pass.x[k] = x.row(i), pass.v[k] = v.row(i);
        }
        pass.run(all);
        for (int i = 0; i < plan.cloth.points(); ++i) {
            x.row(i) = pass.x[std::size_t(i)];
            v.row(i) = pass.v[std::size_t(i)];
        }
        return;
    }
    BothEnds points{plan, x0, v0, x, v};
    // With one sphere what does not fly is answered first: a bounce looks at its neighbours.
    std::vector<int> left_over;
    for (int i = 0; i < plan.cloth.points(); ++i) {
        if (points.pinned(i)) continue;
        PointState end = points.now(i);
        const PointState start = points.before(i);
        if (all.size() > 1 || meet<double>(all[0], start.position.data(), start.velocity.data(), end.position.data(),
                                           end.velocity.data()).in_the_air)
            left_over.push_back(i);
        else
            points.set(i, end);
    }
    for (const int i : left_over) exact::resolve(points, i, all);
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
        const Points x0 = x, v1 = v, a1 = accelerations(plan, list, x, v1);
        const Points v2 = v + dt / 2 * a1, a2 = accelerations(plan, list, x + dt / 2 * v1, v2);
        const Points v3 = v + dt / 2 * a2, a3 = accelerations(plan, list, x + dt / 2 * v2, v3);
        const Points v4 = v + dt * a3, a4 = accelerations(plan, list, x + dt * v3, v4);
        x += dt / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
        v += dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
        collide(plan, x, v, t + double(n + 1) * dt);
        meet_spheres(plan, x0, v1, x, v, t + double(n) * dt, t + double(n + 1) * dt, dt);
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
