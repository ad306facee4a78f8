// Continuous contact of one mass point in full: several spheres within a step, and bounces whose energy is
// balanced exactly. The pass over many points (kernels/contact/continuous.hpp) leaves it what it cannot do
// itself.
//
// `Points` gives access to the cloth by the index of a mass point:
//   before(i), now(i)       PointState at the start of the step, and after the free step
//   set(i, state)
//   mass(i), field_at(i)
//   spring_energy(i, x)     of all springs of point i if it were at x [J]
//   cell_surface_at(i, s)   distances of point i from a sphere of offset "cell"
//   give(i, s, change)      notes that sphere s has changed the velocity of point i
#pragma once

#include <algorithm>
#include <Eigen/Geometry>
#include <vector>

#include "contact/response.hpp"
#include "kernels/contact/continuous.hpp"

namespace clothsim {

// Distance of points outside the contact radius (the slop), in units of rounding x (|centre|_1 + radius).
// Rounding a place on the sphere moves it by at most half a unit, and the kernels resolve a quarter of the
// slop. With half of it they hardly could. With twice as much, points only lie farther out.
inline constexpr double slop_epsilons = 4;

// `band`: of the offset "cell".
inline SweptSphere swept(const Sphere& sphere, double t0, double t1, double dt, double rounding,
                         double band) {
    SweptSphere s{};
    const Vec3 start = sphere.center_at(t0), end = sphere.center_at(t1);
    for (int k = 0; k < 3; ++k) {
        s.start[k] = start[k];
        s.end[k] = end[k];
        s.velocity[k] = (end[k] - start[k]) / dt;
    }
    s.radius = sphere.contact_radius;
    s.slop = slop_epsilons * rounding * (end.lpNorm<1>() + s.radius);
    s.surface = s.radius + s.slop;
    s.cells = sphere.cells;
    s.band = band;
    s.reach = s.surface * (sphere.reach() / sphere.contact_radius);
    s.restitution = sphere.restitution;
    s.friction = sphere.friction;
    s.push = sphere.push_out_speed * dt;
    s.dt = dt;
    return s;
}

namespace exact {

// A bound: more contacts in a step happen only where spheres close on a point, which is then stopped. Half or
// twice changes no other point.
inline constexpr int most_contacts = 16;
// A bound: rounds over all spheres in which a point is taken out of them, before it counts as trapped. Half
// or twice changes nothing else.
inline constexpr int resolve_rounds = 100;

inline Vec3 vec(const double (&a)[3]) { return {a[0], a[1], a[2]}; }

template <class Points>
double potential(const Points& points, int i, const Vec3& x) {
    return points.spring_energy(i, x) - points.mass(i) * points.field_at(i).dot(x);
}

// The distances at which a point responds to a sphere.
template <class Points>
Surface<double> surface_at(const Points& points, int i, const SweptSphere& s) {
    return s.cells ? points.cell_surface_at(i, s) : surface_of<double>(s);
}

// The state after the contact `t` of a point whose free end is `end`.
//
// Energy of the normal motion. U is the potential at the free end, on the plane, or at the mirrored place.
// On arrival uc^2 = u^2 + 2 (U_end - U_plane) / m. At last u^2 = (e uc)^2 + 2 (U_plane - U_mirrored) / m.
// If the last square is negative, the point does not get so far and is left on the plane.
template <class Points>
PointState respond(const Points& points, int i, const SweptSphere& s, const Touch<double>& t,
                   const PointState& end) {
    const Vec3 velocity = vec(s.velocity), normal = vec(t.normal);
    double normal_speed = std::max(t.speed, t.bounce), height = 0;
    if (flies(s, t)) {
        const double mass = points.mass(i);
        const Vec3 plane = end.position + t.depth * normal;
        const double mirrored = s.restitution * t.depth;
        const double at_plane = potential(points, i, plane);
        const double arrival =
            std::max(t.speed * t.speed + 2 * (potential(points, i, end.position) - at_plane) / mass, 0.0);
        const double leaving2 = s.restitution * s.restitution * arrival;
        const double last2 =
            leaving2 + 2 * (at_plane - potential(points, i, plane + mirrored * normal)) / mass;
        height = last2 >= 0 ? mirrored : 0;
        normal_speed = std::sqrt(last2 >= 0 ? last2 : leaving2);
    }
    double p[3], v[3];
    for (int k = 0; k < 3; ++k) v[k] = end.velocity[k] - s.velocity[k];
    leave<double>(s, t, height, normal_speed, p, v);
    const Surface<double> surface = surface_at(points, i, s);
    lift<double>(p, surface.held, surface.top);
    return {vec(s.end) + vec(p), velocity + vec(v)};
}

// Nearest place outside two spheres that overlap, on the circle where their surfaces intersect.
inline Vec3 on_common_circle(const SweptSphere& a, double top_a, const SweptSphere& b, double top_b,
                             const Vec3& x) {
    const Vec3 between = vec(b.end) - vec(a.end);
    const double distance = between.norm();
    if (distance == 0) return x;
    const Vec3 axis = between / distance;
    const double along = (distance * distance + top_a * top_a - top_b * top_b) / (2 * distance);
    const double height2 = top_a * top_a - along * along;
    if (height2 <= 0) return x;
    Vec3 aside = x - vec(a.end);
    aside -= aside.dot(axis) * axis;
    if (aside.norm() <= 1e-12 * distance) aside = axis.unitOrthogonal();
    return vec(a.end) + along * axis + (std::sqrt(height2) + a.slop + b.slop) * aside.normalized();
}

// Takes a point out of every sphere at the end of the step. False: no way out is nearby, the point is trapped
// between spheres.
template <class Points>
bool resolve(Points& points, int i, const std::vector<SweptSphere>& spheres, const Vec3& start,
             PointState& end) {
    for (int round = 0; round < resolve_rounds; ++round) {
        const SweptSphere* last = nullptr;
        double last_top = 0;
        bool moved = false;
        for (const SweptSphere& s : spheres) {
            const Surface<double> surface = surface_at(points, i, s);
            Vec3 p = end.position - vec(s.end), v = end.velocity - vec(s.velocity);
            const double start_distance = (start - vec(s.start)).norm();
            const bool was_inside = start_distance < surface.innermost;
            const bool fewer = was_inside && start_distance + s.push < surface.top;
            if (p.norm() >= (fewer ? start_distance + s.push - s.slop / 2 : surface.lowest)) continue;
            if (round > 0 && last && !was_inside) {
                end.position = on_common_circle(*last, last_top, s, surface.top, end.position);
            } else {
                push_out<double>(s, surface.top, was_inside ? start_distance : surface.top, p.data(),
                                 v.data());
                const PointState out{vec(s.end) + p, vec(s.velocity) + v};
                points.give(i, s, out.velocity - end.velocity);
                end = out;
            }
            moved = true;
            last = &s;
            last_top = surface.top;
        }
        if (!moved) return true;
    }
    return false;
}

// Whole step of one point among all spheres, earliest contact first. False: trapped.
template <class Points>
bool resolve(Points& points, int i, const std::vector<SweptSphere>& spheres) {
    const PointState start = points.before(i);
    PointState end = points.now(i);
    const Vec3 gain = end.velocity - start.velocity;
    Vec3 x = start.position;
    double elapsed = 0;  // part of the step
    const SweptSphere* last = nullptr;  // away from a convex body there is no second contact with it
    bool done = false;
    for (int contact = 0; contact < most_contacts && !done; ++contact) {
        const SweptSphere* first = nullptr;
        Touch<double> soonest{};
        for (const SweptSphere& s : spheres) {
            if (&s == last) continue;  // rounding would find a point that slides on it again and again
            const Vec3 center = vec(s.start) + elapsed * (vec(s.end) - vec(s.start));
            const Vec3 p0 = x - center, q = (end.position - vec(s.end)) - p0,
                       v = end.velocity - vec(s.velocity);
            const Touch<double> t =
                touch<double>(s, surface_at(points, i, s), p0.data(), q.data(), v.data(), gain.data());
            if (!t.hit || (first && t.time >= soonest.time)) continue;
            first = &s;
            soonest = t;
        }
        done = !first;
        if (!first) break;
        const PointState next = respond(points, i, *first, soonest, end);
        points.give(i, *first, next.velocity - end.velocity);
        end = next;
        elapsed += soonest.time * (1 - elapsed);
        x = vec(first->start) + elapsed * (vec(first->end) - vec(first->start)) + vec(soonest.place);
        last = first;
    }
    if (!done) end.position = x;
    const bool out = resolve(points, i, spheres, start.position, end);
    points.set(i, end);
    return out;
}

}  // namespace exact
}  // namespace clothsim
