#include "reference/reference.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "memory/poll.hpp"
#include "reference/contact.hpp"
#include "reference/forces.hpp"
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

struct State {
    Vec3 x, v;  // m, m/s
};

Vec3 direction(const Vec3& p) {
    const double length = p.norm();
    return length > 0 ? Vec3(p / length) : Vec3(Vec3::UnitY());
}

// |v|, also where v.v would overflow or vanish.
double speed_of(const Vec3& v) { return std::hypot(v[0], v[1], v[2]); }

// What turns round the velocity along n, relative to a surface of velocity `moved`, with the
// restitution; and Coulomb's friction. Nothing where the point moves away, unless `always`.
void bounce(Vec3& v, const Vec3& moved, const Vec3& n, double restitution, double friction,
            bool always = false) {
    const Vec3 relative = v - moved;
    const double speed = relative.dot(n);
    if (speed >= 0 && !always) return;
    const Vec3 tangential = relative - speed * n;
    const double impulse = -(1 + restitution) * speed, slip = tangential.norm();
    v += impulse * n;
    if (slip > 0) v -= std::min(1.0, friction * std::abs(impulse) / slip) * tangential;
}

// Section 5 of Kim et al.: the response "reflect" or "ray" of a point that lies inside the sphere
// at time t; others stay.
State respond(const Sphere& sphere, double t, double dt, const State& point) {
    const Vec3 center = sphere.center_at(t), m = point.x - center;
    const double radius = sphere.contact_radius();
    const bool flat = sphere.flat();  // m from a place on the plane, the normal the same everywhere
    if (flat ? m.dot(sphere.normal) >= 0 : m.squaredNorm() >= radius * radius) return point;
    const Vec3 moved = sphere.as_printed ? Vec3(Vec3::Zero()) : sphere.velocity_at(t),
               relative = point.v - moved;
    State after = point;
    Vec3 n = flat ? sphere.normal : direction(m);
    double since = 0;  // the surface was passed [s]
    if (sphere.response == Response::ray) {
        // Eq 8-12: back along the velocity, x - s v/|v|, to where |x - center| is the radius.
        const double speed = speed_of(relative);
        const Vec3 back = speed > 0 ? Vec3(-relative / speed) : n;
        const double b = (flat ? n : m).dot(back);
        if (b < 0 && speed > 0 && !sphere.as_printed) return point;  // leaves by itself
        double s = 0;
        if (flat) {
            s = b > 0 ? -m.dot(n) / b : 0;
            after.x += b > 0 ? Vec3(s * back) : Vec3(-m.dot(n) * n);
        } else {
            s = -b + std::sqrt(b * b - (m.squaredNorm() - radius * radius));
            n = direction(m + s * back);
            after.x = center + radius * n;
        }
        if (speed > 0) since = std::min(s / speed, dt);
    }
    // Eq 7 with restitution, and friction.
    bounce(after.v, moved, n, sphere.restitution, sphere.friction, sphere.as_printed);
    // A point that does not bounce for good travels the rest of the step.
    if (!sphere.as_printed && (sphere.restitution < 1 || sphere.friction > 0))
        after.x += since * (after.v - moved);
    return after;
}

// The response "continuous" by another way than the code that it judges: laws of motion over a
// short substep. A mass point falls freely. At an impact, found by bisection in time, its normal
// speed turns round with the restitution, and Coulomb's friction acts. Forces that press it against
// a sphere are cancelled.
//
// Errors are of the first order in the substep h. Where a point presses with the acceleration a,
// its speed is wrong by at most a h. Each impact adds at most a h^2 to the error of its place.
//
// A sphere with that response, straight on its way within one substep.
struct MovingSphere {
    Vec3 start, velocity;  // of the centre; of a place on a plane
    double radius;  // of contact
    double restitution, friction, push_out_speed;
    bool flat;  // a plane
    Vec3 normal;  // of a plane

    MovingSphere(const Sphere& sphere, double t0, double t1)
        : start(sphere.center_at(t0)),
          velocity((sphere.center_at(t1) - start) / (t1 - t0)),
          radius(sphere.contact_radius()),
          restitution(sphere.restitution),
          friction(sphere.friction),
          push_out_speed(sphere.push_out_speed),
          flat(sphere.flat()),
          normal(sphere.normal) {}
    Vec3 at(double s) const { return start + s * velocity; }
    // Of a place p from the centre, or from the place on the plane.
    double height(const Vec3& p) const { return flat ? p.dot(normal) : p.norm() - radius; }
    Vec3 outward(const Vec3& p) const { return flat ? normal : direction(p); }
};

// Part of the radius, or length over a plane [m]. A point inside by less lies on the surface:
// rounding is 1e-7 of it.
constexpr double touching = 1e-9;
double slack(const MovingSphere& sphere) {
    return sphere.flat ? touching : touching * sphere.radius;
}

struct Path {
    Vec3 x, v, a;
    Vec3 at(double s) const { return x + s * v + s * s / 2 * a; }
    Vec3 velocity(double s) const { return v + s * a; }
};

// The first time in [low, high] at which `holds`, which does so from then on; `high` if it never
// does.
template <class Predicate>
double bisect(double low, double high, const Predicate& holds) {
    for (int halving = 0; halving < 100; ++halving) {
        const double middle = low + (high - low) / 2;
        if (middle <= low || middle >= high) break;
        (holds(middle) ? high : low) = middle;
    }
    return high;
}

// The time after `elapsed` at which the path next touches the sphere, within `left`.
std::optional<double> impact(const Path& path, const MovingSphere& sphere, double elapsed,
                             double left) {
    const auto from_center = [&](double s) -> Vec3 { return path.at(s) - sphere.at(elapsed + s); };
    const auto inside = [&](double s) { return sphere.height(from_center(s)) < 0; };
    const auto approaches = [&](double s) {
        return sphere.outward(from_center(s)).dot(path.velocity(s) - sphere.velocity) < 0;
    };
    if (sphere.height(from_center(0)) < -slack(sphere)) return {};
    if (approaches(0)) {
        const double nearest = bisect(0, left, [&](double s) { return !approaches(s); });
        if (!inside(nearest)) return {};
        return inside(0) ? 0 : bisect(0, nearest, inside);
    }
    const double farthest = bisect(0, left, approaches);
    if (!approaches(left) || !inside(left)) return {};
    return bisect(farthest, left, inside);
}

// At the end of the substep outside every sphere; out of one in which it began, no faster than it
// may be pushed.
bool leave(const std::vector<MovingSphere>& spheres, const State& before, State& point, double h) {
    constexpr int most_rounds = 1000;
    bool touched = false, moved = true;
    for (int round = 0; moved && round < most_rounds; ++round) {
        moved = false;
        for (const MovingSphere& sphere : spheres) {
            const double began = sphere.height(before.x - sphere.start);
            const bool began_inside = began < -slack(sphere);
            const double least =
                began_inside ? std::min(0.0, began + h * sphere.push_out_speed) : 0;
            const Vec3 p = point.x - sphere.at(h), n = sphere.outward(p);
            const double height = sphere.height(p),
                         rounding = sphere.flat ? 1e-15 : 1e-15 * sphere.radius;
            if (height >= least - rounding) continue;
            bounce(point.v, sphere.velocity, n, 0, began_inside ? 0 : sphere.friction);
            point.x = sphere.flat ? Vec3(point.x + (least - height) * n)
                                  : Vec3(sphere.at(h) + (sphere.radius + least) * n);
            touched = moved = true;
        }
    }
    return touched;
}

// `point`, a mass point's free state after a substep of length h from `before`, responds to the
// spheres. Returns whether one of them touched it.
bool respond(const std::vector<MovingSphere>& spheres, const State& before, State& point,
             double h) {
    constexpr int most_impacts = 100;
    Path path{before.x, before.v, (point.v - before.v) / h};
    double elapsed = 0;
    bool touched = false;
    for (int count = 0; count < most_impacts; ++count) {
        const MovingSphere* first = nullptr;
        double time = h - elapsed;
        for (const MovingSphere& sphere : spheres) {
            const auto found = impact(path, sphere, elapsed, h - elapsed);
            if (!found || (first && *found >= time)) continue;
            first = &sphere;
            time = *found;
        }
        if (!first) break;
        touched = true;
        path = {path.at(time), path.velocity(time), path.a};
        elapsed += time;
        const double left = h - elapsed;
        const Vec3 n = first->outward(path.x - first->at(elapsed));
        if (left * path.a.dot(n) <= 2 * (path.v - first->velocity).dot(n)) {
            // So slow that an elastic bounce ends within the substep: the point stays, and what
            // presses it is a force of contact.
            path = {path.x, path.velocity(left), Vec3::Zero()};
            bounce(path.v, first->velocity, n, 0, first->friction);
        } else {
            bounce(path.v, first->velocity, n, first->restitution, first->friction);
        }
    }
    if (touched) point = {path.at(h - elapsed), path.velocity(h - elapsed)};
    return leave(spheres, before, point, h) || touched;
}

void collide(const Scene& scene, Points& x, Points& v, double t, double dt) {
    for (const Sphere& sphere : scene.spheres) {
        if (sphere.response == Response::continuous || sphere.penalty()) continue;
        for (int i = 0; i < scene.cloth.points(); ++i) {
            if (scene.cloth.pinned[i]) continue;
            const State after = respond(sphere, t, dt, {x.row(i), v.row(i)});
            x.row(i) = after.x;
            v.row(i) = after.v;
        }
    }
}

// Where a velocity jumps at an end of the step, the piece within the step counts.
double inside(double t0, double dt, double part) {
    return t0 + std::clamp(part, 1e-6, 1 - 1e-6) * dt;
}

// Driven pins are where their motion has them at the time of every stage: t0 + part of the step.
void drive(const Scene& scene, Points& x, Points& v, double t0, double dt, double part) {
    place_pins(scene.driven_pins, scene.pin_motions, t0 + part * dt, inside(t0, dt, part), x.data(),
               v.data());
}

// One step of RK4.
void advance(const Scene& scene, const std::vector<Spring>& list, Points& x, Points& v, double t0,
             double dt) {
    const auto slope = [&](const Points& at, const Points& velocity, double part) {
        return accelerations(scene, list, at, velocity, t0 + part * dt, inside(t0, dt, part));
    };
    drive(scene, x, v, t0, dt, 0);
    const Points v1 = v, a1 = slope(x, v1, 0);
    Points x2 = x + dt / 2 * v1, v2 = v + dt / 2 * a1;
    drive(scene, x2, v2, t0, dt, 0.5);
    const Points a2 = slope(x2, v2, 0.5);
    Points x3 = x + dt / 2 * v2, v3 = v + dt / 2 * a2;
    drive(scene, x3, v3, t0, dt, 0.5);
    const Points a3 = slope(x3, v3, 0.5);
    Points x4 = x + dt * v3, v4 = v + dt * a3;
    drive(scene, x4, v4, t0, dt, 1);
    const Points a4 = slope(x4, v4, 1);
    x += dt / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
    v += dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
}

// One step in short substeps with every contact of the spheres "continuous". Returns whether there
// was one.
bool advance_in_contact(const Scene& scene, const std::vector<Spring>& list, Points& x, Points& v,
                        double t0, double t1) {
    // Errors of contact are as 1 / substeps of the step's: at 64 below 2 % of a bound that the step
    // explains. 32 doubles them, 128 doubles the time.
    constexpr int substeps = 64;
    bool touched = false;
    for (int k = 0; k < substeps; ++k) {
        const double begin = t0 + k * (t1 - t0) / substeps,
                     end = t0 + (k + 1) * (t1 - t0) / substeps;
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

// One step of eq 2-6 as printed: "a" of eq 2-5 already carries the time step; eq 3-6 multiply by it
// once more.
void advance_as_printed(const Scene& scene, const std::vector<Spring>& list, Points& x, Points& v,
                        double t, double dt) {
    const auto slope = [&](const Points& at, const Points& velocity) {
        return accelerations(scene, list, at, velocity, t, t);
    };
    const Points v1 = dt * v, a1 = dt * slope(x, v);
    const Points w2 = v + dt / 2 * a1, v2 = dt * w2, a2 = dt * slope(x + dt / 2 * v1, w2);
    const Points w3 = v + dt / 2 * a2, v3 = dt * w3, a3 = dt * slope(x + dt / 2 * v2, w3);
    const Points w4 = v + dt * a3, v4 = dt * w4, a4 = dt * slope(x + dt * v3, w4);
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
        const double t0 = t + double(n) * dt, t1 = t + double(n + 1) * dt;
        Points touching_x = x, touching_v = v;
        if (as_printed) {
            advance_as_printed(scene, list, x, v, t0, dt);
        } else if (advance_in_contact(scene, list, touching_x, touching_v, t0, t1)) {
            x = touching_x;
            v = touching_v;
        } else {
            advance(scene, list, x, v, t0, dt);
        }
        drive(scene, x, v, t1, dt, 0);
        collide(scene, x, v, t1, dt);
    }
    return true;
}

}  // namespace clothsim::reference
