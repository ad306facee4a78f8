#include "reference/contact.hpp"

#include <algorithm>
#include <optional>

namespace clothsim::reference {
namespace {

// Part of the radius, or length over a plane [m]. A point inside by less lies on the surface: rounding is
// 1e-7 of it.
constexpr double touching = 1e-9;
double slack(const MovingSphere& sphere) { return sphere.flat ? touching : touching * sphere.radius; }

struct Path {
    Vec3 x, v, a;
    Vec3 at(double s) const { return x + s * v + s * s / 2 * a; }
    Vec3 velocity(double s) const { return v + s * a; }
};

// The first time in [low, high] at which `holds`, which does so from then on; `high` if it never does.
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
std::optional<double> impact(const Path& path, const MovingSphere& sphere, double elapsed, double left) {
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

// The impulse on a velocity that points into the sphere at the normal n.
void bounce(Vec3& v, const MovingSphere& sphere, const Vec3& n, double restitution, double friction) {
    const Vec3 relative = v - sphere.velocity;
    const double speed = relative.dot(n);
    if (speed >= 0) return;
    const Vec3 tangential = relative - speed * n;
    const double impulse = -(1 + restitution) * speed, slip = tangential.norm();
    v += impulse * n;
    if (slip > 0) v -= std::min(1.0, friction * impulse / slip) * tangential;
}

// At the end of the substep outside every sphere; out of one in which it began, no faster than it may be
// pushed.
bool leave(const std::vector<MovingSphere>& spheres, const State& before, State& point, double h) {
    constexpr int most_rounds = 1000;
    bool touched = false, moved = true;
    for (int round = 0; moved && round < most_rounds; ++round) {
        moved = false;
        for (const MovingSphere& sphere : spheres) {
            const double began = sphere.height(before.x - sphere.start);
            const bool began_inside = began < -slack(sphere);
            const double least = began_inside ? std::min(0.0, began + h * sphere.push_out_speed) : 0;
            const Vec3 p = point.x - sphere.at(h), n = sphere.outward(p);
            const double height = sphere.height(p), rounding = sphere.flat ? 1e-15 : 1e-15 * sphere.radius;
            if (height >= least - rounding) continue;
            bounce(point.v, sphere, n, 0, began_inside ? 0 : sphere.friction);
            point.x = sphere.flat ? Vec3(point.x + (least - height) * n)
                                  : Vec3(sphere.at(h) + (sphere.radius + least) * n);
            touched = moved = true;
        }
    }
    return touched;
}

}  // namespace

MovingSphere::MovingSphere(const Sphere& sphere, double t0, double t1)
    : start(sphere.center_at(t0)),
      velocity((sphere.center_at(t1) - start) / (t1 - t0)),
      radius(sphere.contact_radius()),
      restitution(sphere.restitution),
      friction(sphere.friction),
      push_out_speed(sphere.push_out_speed),
      flat(sphere.flat()),
      normal(sphere.normal) {}

bool respond(const std::vector<MovingSphere>& spheres, const State& before, State& point, double h) {
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
            // So slow that an elastic bounce ends within the substep: the point stays, and what presses it
            // is a force of contact.
            path = {path.x, path.velocity(left), Vec3::Zero()};
            bounce(path.v, *first, n, 0, first->friction);
        } else {
            bounce(path.v, *first, n, first->restitution, first->friction);
        }
    }
    if (touched) point = {path.at(h - elapsed), path.velocity(h - elapsed)};
    return leave(spheres, before, point, h) || touched;
}

}  // namespace clothsim::reference
