// Continuous contact of a mass point with spheres or planes: the time of impact within a step, and
// what follows it. The pass over many points (kernels/contact) leaves here those that do not rest
// on one sphere.
//
// A sphere is told by a place p0 on it, its normal n there and its curvature k = 1/R; 0 is a plane.
// With d = p - p0 the level of a place and the height over the surface are
//
//     f(d) = 2 n.d + k d.d = d.(n + m(d))    m(d) = n + k d    height = f / (1 + sqrt(1 + k f))
//
// No large numbers cancel. |m| = sqrt(1 + k f), m / |m| is the normal at the place, and f = h (2 +
// k h).
//
// Everything is in the sphere's frame. Within a step the point goes straight from the start of the
// step to the end of the free step. The sphere goes straight between its two places, so that
//
//     d(t) = d0 + t q,   t = 0..1           f(d(t)) = top
//
// With a = k q.q and b = m(d0).q, let s be the time of closest approach, at most 1, and b' = b + s
// a there:
//
//     t = (f(d0) - top) / (-b + sqrt(b'^2 + a (top - f(d(s)))))
//
// which does not cancel for a point at the surface. Nor does it for a point that grazes after a
// long way, where b^2 and a (f(d0) - top) are nearly equal.
//
// At t the normal is fixed. The part of the remaining way along it, of length `depth`, is taken
// back: the point ends in the tangent plane. Its speed there follows from energy, as its free end
// lies `depth` lower. With u its normal speed at the free end and `press` its mean acceleration
// towards the sphere,
//
//     uc^2 = u^2 - 2 press depth
//
// so that a point at rest (u^2 = 2 press depth) is at rest afterwards, at any time step. It leaves
// with e uc. A bounce that flies for longer than a step goes on to the end of the mirrored way. Its
// energy is balanced exactly, springs included.
//
// `Points` gives access to the cloth by the index of a mass point:
//   before(i), now(i)       PointState at the start of the step, and after the free step
//   set(i, state)
//   mass(i), field_at(i)
//   spring_energy(i, x)     of all springs of point i if it were at x [J]
//   postpones(i)            whether this bounce has to wait until the points that lie on spheres
//                           are done
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
#include "kernels/contact/contact_arguments.hpp"
#include "model/cloth.hpp"

namespace clothsim {

// Heights of points over the offset (the slop), in units of rounding x (|p0|_1 + size). Rounding a
// place on the sphere moves it by at most half a unit. With half of it nothing would be left for
// levels. With twice as much, points only lie farther out.
inline constexpr double slop_epsilons = 2;
// Of Kim et al., eq 13: O = sqrt((D/2)^2 + R^2) - R. Both ends of a spring of length D lie at
// distance R + O from the centre. Then the spring's midpoint just touches the sphere of radius R.
// Written without the cancellation of the printed form.
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
            edge_offset(sphere.radius, std::hypot(cloth.row_spacing, cloth.column_spacing)) /
            s.size;
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

inline Vec3 vec(const double (&a)[3]) { return {a[0], a[1], a[2]}; }
// In this order, as in the shader.
inline double inner(const Vec3& a, const Vec3& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// m(d), and f(d).
inline Vec3 gradient(const SweptSphere& s, const Vec3& d) {
    return vec(s.normal) + s.curvature * d;
}
inline double level(const SweptSphere& s, const Vec3& d) {
    return inner(d, vec(s.normal) + gradient(s, d));
}
inline double height_of(const SweptSphere& s, double level) {
    return level / (1 + std::sqrt(std::max(1 + s.curvature * level, 0.0)));
}
inline double level_of(const SweptSphere& s, double height) {
    return height * (2 + s.curvature * height);
}

// Levels at which a point responds. One that starts no more than `SweptSphere::tolerance` above the
// top lies on the sphere.
struct Surface {
    double top;  // on to which it is put
    double innermost;  // it was inside if it began below
    double lowest;  // if it ends below, it is put on top
};
// `radius2`: rho^2 of the point's cells, with offset "cell".
template <class Real>
Surface surface_of(const SweptSphere& s, double radius2) {
    const double of_cells =
                     std::min(radius2 * (s.curvature * cell_rounding<Real>), s.most_of_cells),
                 least = s.cells ? s.least + of_cells : s.least;
    return {least + s.band, least - (s.least - s.innermost), least};
}

// Where a point touches the sphere within a step.
struct Touch {
    bool hit;  // within the step
    bool rested;  // on the sphere at the start
    double time;  // of the hit, part of the way that was left
    Vec3 normal;
    Vec3 place;  // of the hit, from p0 [m]
    double depth;  // how far the rest of the way leads below the tangent plane [m]
    Vec3 along;  // the rest of the way along the tangent plane [m]
    double speed;  // normal speed at the free end [m/s], negative: towards the sphere
    double press;  // mean acceleration towards the sphere [m/s^2]
    double bounce;  // normal speed after the contact [m/s], before anything presses again

    // Whether a bounce is still in the air when the step after it begins. The others are over
    // before anybody could see them: the point stays at the surface and keeps the speed.
    bool flies(const SweptSphere& s) const { return bounce > 0 && 2 * bounce > press * s.dt; }
};

// d, q: start and way from there; v: velocity at the free end; gain: what the free step added to
// the velocity. All relative to the sphere.
inline Touch touch(const SweptSphere& s, const Surface& surface, const Vec3& d, const Vec3& q,
                   const Vec3& v, const Vec3& gain) {
    Touch t{};
    const double start = level(s, d), a = s.curvature * inner(q, q), b = inner(gradient(s, d), q);
    t.rested = start <= surface.top + s.tolerance;
    if (start < surface.innermost || !(b < 0)) return t;
    const double closest = std::min(a > 0 ? -b / a : 1, 1.0),
                 below = surface.top - level(s, d + closest * q), last = b + closest * a,
                 down = std::sqrt(std::max(last * last + a * below, 0.0)) - b;
    t.time = t.rested || down <= 0 ? 0 : (start - surface.top) / down;
    t.hit = t.rested || (below > 0 && t.time <= 1);
    if (!t.hit) return t;
    t.place = d + t.time * q;
    const Vec3 m = gradient(s, t.place);
    const double length2 = inner(m, m), rest = 1 - t.time;
    t.normal = m * (length2 > 0 ? 1 / std::sqrt(length2) : 0);
    const double normal_way = std::min(inner(q, t.normal), 0.0);
    t.depth = -rest * normal_way;
    t.along = rest * (q - normal_way * t.normal);
    t.speed = inner(v, t.normal);
    t.press = -inner(gain, t.normal) / s.dt;
    const double arrival2 = t.speed * t.speed - 2 * t.press * t.depth;
    t.bounce = s.restitution > 0 ? s.restitution * std::sqrt(std::max(arrival2, 0.0)) : 0;
    return t;
}

// Place (from p0) and velocity (relative; before: at the free end) after a contact, `height` above
// the tangent plane. Coulomb: the tangential change is at most friction times the normal one.
inline PointState leave(const SweptSphere& s, const Touch& t, double height, double normal_speed,
                        const Vec3& v) {
    const Vec3 tangential = v - t.speed * t.normal;
    double keep = 1;
    if (s.friction > 0) {
        const double slip = std::sqrt(inner(tangential, tangential)),
                     most = s.friction * std::max(normal_speed - t.speed, 0.0);
        keep = slip > most ? 1 - most / slip : 0;
    }
    return {t.place + keep * t.along + height * t.normal,
            keep * tangential + normal_speed * t.normal};
}

// d brought along its normal to the level `top` if it is below `limit`. The exact centre goes along
// n.
inline void lift(const SweptSphere& s, Vec3& d, double limit, double top) {
    const double now = level(s, d), length2 = 1 + s.curvature * now;
    if (!(now < limit)) return;
    if (!(length2 > 0)) d = height_of(s, top) * vec(s.normal);
    else
        d +=
            (top - now) / (length2 + std::sqrt(length2 * (1 + s.curvature * top))) * gradient(s, d);
}

// A point that was inside, `start` high, goes outwards by no more than `push` a step unless it
// moves so itself, and never deeper. Its velocity is not directed inwards any more.
inline void push_out(const SweptSphere& s, double top, double start, Vec3& d, Vec3& v) {
    const double now = level(s, d);
    if (!(now < top)) return;
    const Vec3 m = gradient(s, d);
    const double length2 = inner(m, m);
    const Vec3 n = length2 > 0 ? Vec3(m * (1 / std::sqrt(length2))) : vec(s.normal);
    v -= std::min(inner(v, n), 0.0) * n;
    const double aim = std::min(height_of(s, top), std::max(height_of(s, now), start + s.push));
    lift(s, d, top, level_of(s, aim));
}

// A bound: more contacts in a step happen only where spheres close on a point, which is then
// stopped. Half or twice changes no other point.
inline constexpr int most_contacts = 16;
// A bound: rounds over all spheres in which a point is taken out of them, before it counts as
// trapped. Half or twice changes nothing else.
inline constexpr int resolve_rounds = 100;

template <class Points>
double potential(const Points& points, int i, const Vec3& x) {
    return points.spring_energy(i, x) - points.mass(i) * points.field_at(i).dot(x);
}

// The state after the contact `t` of a point whose free end is `end`.
//
// Energy of the normal motion. U is the potential at the free end, on the plane, or at the mirrored
// place. On arrival uc^2 = u^2 + 2 (U_end - U_plane) / m. At last u^2 = (e uc)^2 + 2 (U_plane -
// U_mirrored) / m. If the last square is negative, the point does not get so far and is left on the
// plane.
template <class Points>
PointState respond(const Points& points, int i, const SweptSphere& s, const Touch& t,
                   const PointState& end) {
    double normal_speed = std::max(t.speed, t.bounce), height = 0;
    if (t.flies(s)) {
        const double mass = points.mass(i);
        const Vec3 plane = end.position + t.depth * t.normal;
        const double mirrored = s.restitution * t.depth;
        const double at_plane = potential(points, i, plane);
        const double arrival = std::max(
            t.speed * t.speed + 2 * (potential(points, i, end.position) - at_plane) / mass, 0.0);
        const double leaving2 = s.restitution * s.restitution * arrival;
        const double last2 =
            leaving2 + 2 * (at_plane - potential(points, i, plane + mirrored * t.normal)) / mass;
        height = last2 >= 0 ? mirrored : 0;
        normal_speed = std::sqrt(last2 >= 0 ? last2 : leaving2);
    }
    PointState after = leave(s, t, height, normal_speed, end.velocity - vec(s.velocity));
    const Surface surface = points.surface_at(i, s);
    lift(s, after.position, surface.lowest, surface.top);
    return {vec(s.end) + after.position, vec(s.velocity) + after.velocity};
}

// Where the levels of two spheres intersect: Newton's method along both normals.
inline Vec3 on_both(const SweptSphere& a, double top_a, const SweptSphere& b, double top_b,
                    Vec3 x) {
    constexpr int most_rounds = 30;  // each doubles the digits
    for (int round = 0; round < most_rounds; ++round) {
        const Vec3 from_a = x - vec(a.end), from_b = x - vec(b.end);
        const Vec3 m = vec(a.normal) + a.curvature * from_a,
                   n = vec(b.normal) + b.curvature * from_b;
        const double mm = inner(m, m), mn = inner(m, n), nn = inner(n, n),
                     determinant = mm * nn - mn * mn;
        if (determinant <= 1e-24 * mm * nn) {  // in a line with both centres
            x += 1e-3 * std::min(a.size, b.size) * m.unitOrthogonal();
            continue;
        }
        const double lacks_a = (top_a - level(a, from_a)) / 2,
                     lacks_b = (top_b - level(b, from_b)) / 2;
        x += (lacks_a * nn - lacks_b * mn) / determinant * m +
            (lacks_b * mm - lacks_a * mn) / determinant * n;
        if (std::max(std::abs(lacks_a), std::abs(lacks_b)) < (a.band + b.band) / 8) break;
    }
    return x;
}

// Takes a point out of every sphere at the end of the step. False: no way out is nearby, the point
// is trapped between spheres. `placed`: on to a sphere already; the slop then covers the rounding
// of the place.
template <class Points>
bool resolve(Points& points, int i, const std::vector<SweptSphere>& spheres, const Vec3& start,
             PointState& end, bool placed) {
    for (int round = 0; round < resolve_rounds; ++round) {
        const SweptSphere* last = nullptr;
        double last_top = 0;
        bool moved = false;
        for (const SweptSphere& s : spheres) {
            const Surface surface = points.surface_at(i, s);
            Vec3 d = end.position - vec(s.end), v = end.velocity - vec(s.velocity);
            const double begun = level(s, start - vec(s.start)), height = height_of(s, begun);
            const bool was_inside = begun < surface.innermost;
            double least = placed ? (surface.lowest + surface.innermost) / 2 : surface.lowest;
            if (was_inside && round == 0) {
                points.note_inside(i, s, height_of(s, surface.innermost) - height);
                least = surface.top;
            } else if (was_inside) {
                least = std::min(least,
                                 level_of(s, height + s.push - (surface.top - surface.lowest) / 2));
            }
            if (level(s, d) >= least) continue;
            if (was_inside) {
                push_out(s, surface.top, height, d, v);
                const PointState out{vec(s.end) + d, vec(s.velocity) + v};
                points.give(i, s, out.velocity - end.velocity);
                end = out;
            } else if (round > 0 && last) {
                end.position = on_both(*last, last_top, s, surface.top, end.position);
            } else {
                lift(s, d, surface.top, surface.top);
                end.position = vec(s.end) + d;
            }
            moved = true;
            last = &s;
            last_top = surface.top;
        }
        if (!moved) return true;
        placed = true;
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
    // Away from a convex body there is no second contact with it.
    const SweptSphere* last = nullptr;
    bool done = false;
    for (int contact = 0; contact < most_contacts && !done; ++contact) {
        const SweptSphere* first = nullptr;
        Touch soonest{};
        for (const SweptSphere& s : spheres) {
            // Rounding would find a point that slides on it again and again.
            if (&s == last) continue;
            const Vec3 center = vec(s.start) + elapsed * (vec(s.end) - vec(s.start));
            const Vec3 p0 = x - center, q = (end.position - vec(s.end)) - p0,
                       v = end.velocity - vec(s.velocity);
            const Touch t = touch(s, points.surface_at(i, s), p0, q, v, gain);
            if (!t.hit || (first && t.time >= soonest.time)) continue;
            first = &s;
            soonest = t;
        }
        done = !first;
        if (!first) break;
        if (soonest.flies(*first) && points.postpones(i)) return true;
        const PointState next = respond(points, i, *first, soonest, end);
        points.give(i, *first, next.velocity - end.velocity);
        if (soonest.rested)
            points.press(i, std::max(soonest.speed, soonest.bounce) - soonest.speed);
        end = next;
        elapsed += soonest.time * (1 - elapsed);
        x = vec(first->start) + elapsed * (vec(first->end) - vec(first->start)) + soonest.place;
        last = first;
    }
    if (!done) end.position = x;
    const bool out = resolve(points, i, spheres, start.position, end, last != nullptr);
    // Two floats of other values may have the same sum, so a point without contact keeps its own.
    if (last || end != free_end) points.set(i, end);
    return out;
}

}  // namespace exact
}  // namespace clothsim
