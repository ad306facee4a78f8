// Continuous contact of one mass point in full: several spheres within a step, and bounces whose energy is
// balanced exactly. The pass over many points (kernels/contact/continuous.hpp) leaves it what it cannot do
// itself.
//
// `Points` gives access to the cloth by the index of a mass point:
//   before(i), now(i)       PointState at the start of the step, and after the free step
//   set(i, state)
//   mass(i), field_at(i)
//   spring_energy(i, x)     of all springs of point i if it were at x [J]
//   surface_at(i, s)        levels at which point i responds to a sphere
//   give(i, s, change)      notes that sphere s has changed the velocity of point i
//   press(i, speed)         notes what a contact from the start of the step on has taken
//   note_inside(i, s, depth)  notes that a point began inside
#pragma once

#include <algorithm>
#include <cmath>
#include <Eigen/Geometry>
#include <vector>

#include "contact/response.hpp"
#include "kernels/contact/continuous.hpp"
#include "model/cloth.hpp"

namespace clothsim {

// Heights of points over the offset (the slop), in units of rounding x (|p0|_1 + size). Rounding a place on
// the sphere moves it by at most half a unit. With half of it nothing would be left for levels. With twice as
// much, points only lie farther out.
inline constexpr double slop_epsilons = 2;
// Of Kim et al., eq 13: O = sqrt((D/2)^2 + R^2) - R. Both ends of a spring of length D lie at distance R + O
// from the centre. Then the spring's midpoint just touches the sphere of radius R. Written without the
// cancellation of the printed form.
inline double edge_offset(double radius, double rest_length) {
    const double half = rest_length / 2;
    return half * (half / (std::hypot(half, radius) + radius));
}

// `rounding`: relative, of the state.
inline SweptSphere swept(const Sphere& sphere, const Cloth& cloth, double t0, double t1, double dt,
                         double rounding, bool single) {
    SweptSphere s{};
    const Vec3 start = sphere.place_at(t0), end = sphere.place_at(t1);
    for (int k = 0; k < 3; ++k) {
        s.start[k] = start[k];
        s.end[k] = end[k];
        s.velocity[k] = (end[k] - start[k]) / dt;
        s.normal[k] = sphere.normal[k];
    }
    s.curvature = sphere.curvature();
    // In double there is room for cloths that slide far.
    s.size = std::min(sphere.radius, (single ? 1 : 1000) * sphere.spread);
    const double slop = slop_epsilons * rounding * (end.lpNorm<1>() + s.size);
    s.least = sphere.level(sphere.offset + slop);
    s.innermost = sphere.level(sphere.offset - slop);
    const double epsilon = single ? 0x1p-23 : 0x1p-52;
    s.band = ContactBand::least * epsilon * s.size;
    if (sphere.cells) {
        const double of_cell = ContactBand::part_of_cell *
            edge_offset(sphere.radius, std::hypot(cloth.row_spacing, cloth.column_spacing)) / s.size;
        s.band = 2 * s.size *
            (single ? ContactBand::of_cells_in_single
                    : std::clamp(of_cell, ContactBand::least_of_cells, ContactBand::of_cells));
    }
    s.tolerance = ContactBand::tolerance * epsilon * s.size;
    s.near_level = s.least + s.band + s.tolerance +
        32 * epsilon * (s.size + end.lpNorm<1>() + (end - start).lpNorm<1>());
    s.near_curvature = s.curvature - 64 * epsilon / s.size;
    s.cells = sphere.cells;
    s.most_of_cells = sphere.cells ? sphere.radius : 0;
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

inline double level(const SweptSphere& s, const Vec3& d) {
    double m[3];
    return clothsim::level<double>(s, d.data(), m);
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
    const Surface<double> surface = points.surface_at(i, s);
    lift<double>(s, p, surface.lowest, surface.top);
    return {vec(s.end) + vec(p), velocity + vec(v)};
}

// Where the levels of two spheres intersect: Newton's method along both normals.
inline Vec3 on_both(const SweptSphere& a, double top_a, const SweptSphere& b, double top_b, Vec3 x) {
    constexpr int most_rounds = 30;  // each doubles the digits
    for (int round = 0; round < most_rounds; ++round) {
        const Vec3 from_a = x - vec(a.end), from_b = x - vec(b.end);
        const Vec3 m = vec(a.normal) + a.curvature * from_a, n = vec(b.normal) + b.curvature * from_b;
        const double mm = m.dot(m), mn = m.dot(n), nn = n.dot(n), determinant = mm * nn - mn * mn;
        if (determinant <= 1e-24 * mm * nn) {  // in a line with both centres
            x += 1e-3 * std::min(a.size, b.size) * m.unitOrthogonal();
            continue;
        }
        const double lacks_a = (top_a - level(a, from_a)) / 2, lacks_b = (top_b - level(b, from_b)) / 2;
        x +=
            (lacks_a * nn - lacks_b * mn) / determinant * m + (lacks_b * mm - lacks_a * mn) / determinant * n;
        if (std::max(std::abs(lacks_a), std::abs(lacks_b)) < (a.band + b.band) / 8) break;
    }
    return x;
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
            const Surface<double> surface = points.surface_at(i, s);
            Vec3 d = end.position - vec(s.end), v = end.velocity - vec(s.velocity);
            const double begun = level(s, start - vec(s.start)), height = height_of(s, begun);
            const bool was_inside = begun < surface.innermost;
            if (was_inside && round == 0) points.note_inside(i, s, height_of(s, surface.innermost) - height);
            const double pushed = height + s.push - (surface.top - surface.lowest) / 2,
                         least = was_inside ? std::min(surface.lowest, level_of(s, pushed)) : surface.lowest;
            if (level(s, d) >= least) continue;
            if (round > 0 && last && !was_inside) {
                end.position = on_both(*last, last_top, s, surface.top, end.position);
            } else {
                push_out<double>(s, surface.top, was_inside ? height : height_of(s, surface.top), d.data(),
                                 v.data());
                const PointState out{vec(s.end) + d, vec(s.velocity) + v};
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
    const PointState start = points.before(i), free_end = points.now(i);
    PointState end = free_end;
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
                touch<double>(s, points.surface_at(i, s), p0.data(), q.data(), v.data(), gain.data());
            if (!t.hit || (first && t.time >= soonest.time)) continue;
            first = &s;
            soonest = t;
        }
        done = !first;
        if (!first) break;
        const PointState next = respond(points, i, *first, soonest, end);
        points.give(i, *first, next.velocity - end.velocity);
        if (soonest.rested) points.press(i, std::max(soonest.speed, soonest.bounce) - soonest.speed);
        end = next;
        elapsed += soonest.time * (1 - elapsed);
        x = vec(first->start) + elapsed * (vec(first->end) - vec(first->start)) + vec(soonest.place);
        last = first;
    }
    if (!done) end.position = x;
    const bool out = resolve(points, i, spheres, start.position, end);
    // Two floats of other values may have the same sum, so a point without contact keeps its own.
    if (last || end.position != free_end.position || end.velocity != free_end.velocity) points.set(i, end);
    return out;
}

}  // namespace exact
}  // namespace clothsim
