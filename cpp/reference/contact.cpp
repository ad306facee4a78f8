#include "reference/contact.hpp"

#include <algorithm>
#include <cmath>
#include <Eigen/Geometry>
#include <limits>
#include <optional>

namespace clothsim::reference {
namespace {

Vec3 direction(const Vec3& p) {
    const double length = p.norm();
    if (length == 0) return Vec3::UnitY();
    return p / length;
}

// |v|, also where v.v would overflow or vanish.
double speed_of(const Vec3& v) { return std::hypot(v[0], v[1], v[2]); }

// Where a point first meets a sphere within a step, and with what it gets there. From the centre, in the
// sphere's frame.
struct Hit {
    double time;  // part of the way
    Vec3 place, normal;
    double depth;   // of the way's end below the tangent plane [m]
    Vec3 along;     // rest of the way along the tangent plane [m]
    double speed;   // along the normal at the free end [m/s]
    double bounce;  // along the normal after the contact [m/s]
    bool flies;     // longer than a step
};

// |p + t q|^2 = surface^2 for the first t in [0, 1]. `v`, `gain`: velocity at the free end, and what the step
// added to it.
std::optional<Hit> first_hit(const Sweep& s, const Vec3& p, const Vec3& q, const Vec3& v, const Vec3& gain) {
    if (s.inside(p) || p.dot(q) >= 0) return {};
    const double a = q.squaredNorm(), nearest = (p - p.dot(q) / a * q).norm();
    if (nearest >= s.surface) return {};
    // Half a chord before the nearest place; on the surface already: at once.
    const double half_chord = std::sqrt((s.surface - nearest) * (s.surface + nearest));
    const double time =
        p.norm() <= s.surface ? 0 : std::max(0.0, (-p.dot(q) / std::sqrt(a) - half_chord) / std::sqrt(a));
    if (time > 1) return {};
    Hit hit{};
    hit.time = time;
    hit.place = p + time * q;
    hit.normal = direction(hit.place);
    const double towards = std::min(q.dot(hit.normal), 0.0);
    hit.depth = -(1 - time) * towards;
    hit.along = (1 - time) * (q - towards * hit.normal);
    hit.speed = v.dot(hit.normal);
    const double pressing = -gain.dot(hit.normal) / s.dt;  // acceleration towards the sphere
    hit.bounce = s.restitution * std::sqrt(std::max(hit.speed * hit.speed - 2 * pressing * hit.depth, 0.0));
    hit.flies = hit.bounce > 0 && 2 * hit.bounce > pressing * s.dt;
    return hit;
}

// Energy of the normal motion. The fall from the tangent plane to the free end is given back on arrival, and
// paid for the mirrored way up.
State leave(const FreeStep& step, const Sweep& s, const Hit& hit, const State& end) {
    double normal_speed = std::max(hit.speed, hit.bounce), height = 0;
    if (hit.flies) {
        const Vec3 plane = end.x + hit.depth * hit.normal,
                   mirrored = plane + s.restitution * hit.depth * hit.normal;
        const double gained = step.potential(end.x) - step.potential(plane),
                     paid = step.potential(mirrored) - step.potential(plane);
        const double leaving2 =
            s.restitution * s.restitution * std::max(hit.speed * hit.speed + 2 * gained / step.mass, 0.0);
        const double last2 = leaving2 - 2 * paid / step.mass;
        if (last2 >= 0) height = s.restitution * hit.depth;
        normal_speed = std::sqrt(last2 >= 0 ? last2 : leaving2);
    }
    const Vec3 relative = end.v - s.velocity, tangential = relative - hit.speed * hit.normal;
    double kept = 1;  // part of the tangential motion: Coulomb
    if (s.friction > 0) {
        const double most = s.friction * std::max(normal_speed - hit.speed, 0.0), slip = tangential.norm();
        kept = slip > most ? 1 - most / slip : 0;
    }
    Vec3 p = hit.place + kept * hit.along + height * hit.normal;
    if (p.norm() < s.surface) p = s.surface * direction(p);
    return {s.end + p, s.velocity + kept * tangential + normal_speed * hit.normal};
}

// The nearest place on both spheres' surfaces.
Vec3 on_both(const Sweep& a, const Sweep& b, const Vec3& x) {
    const Vec3 between = b.end - a.end;
    const double distance = between.norm();
    if (distance == 0) return x;
    const Vec3 axis = between / distance;
    const double along =
        (distance * distance + a.surface * a.surface - b.surface * b.surface) / (2 * distance);
    const double radius2 = a.surface * a.surface - along * along;
    if (radius2 <= 0) return x;
    Vec3 aside = x - a.end - (x - a.end).dot(axis) * axis;
    if (aside.norm() <= 1e-12 * distance) aside = axis.unitOrthogonal();
    return a.end + along * axis + (std::sqrt(radius2) + a.slop() + b.slop()) * aside.normalized();
}

// Out of every sphere at the end of the step; what began inside goes outwards no faster than it is pushed.
State resolve(const State& before, State end, const std::vector<Sweep>& spheres) {
    constexpr int rounds = 100;
    for (int round = 0; round < rounds; ++round) {
        const Sweep* last = nullptr;  // of this round
        for (const Sweep& s : spheres) {
            const double began = (before.x - s.start).norm();
            const bool was_inside = s.inside(before.x - s.start);
            const double lowest = was_inside ? std::min(s.surface, began + s.push) : s.surface;
            const Vec3 p = end.x - s.end;
            if (p.norm() >= lowest - s.slop() / 2) continue;
            if (round > 0 && last && !was_inside) {
                end.x = on_both(*last, s, end.x);
            } else {
                const Vec3 n = direction(p);
                end.x = s.end + std::max(p.norm(), lowest) * n;
                end.v -= std::min((end.v - s.velocity).dot(n), 0.0) * n;
            }
            last = &s;
        }
        if (!last) break;
    }
    return end;
}

}  // namespace

State respond(const Sphere& sphere, double t, const State& point) {
    const Vec3 center = sphere.center_at(t), m = point.x - center;
    if (m.squaredNorm() >= sphere.contact_radius * sphere.contact_radius) return point;
    const Vec3 moved = sphere.as_printed ? Vec3(Vec3::Zero()) : sphere.velocity_at(t),
               relative = point.v - moved;
    State after = point;
    Vec3 n = direction(m);
    double since = 0;  // the surface was passed [s]
    if (sphere.response == Response::ray) {
        // Eq 8-12: back along the velocity, x - s v/|v|, to where |x - center| is the radius.
        if (const double speed = speed_of(relative); speed > 0) {
            const Vec3 back = -relative / speed;
            const double b = m.dot(back), c = m.squaredNorm() - sphere.contact_radius * sphere.contact_radius;
            if (b < 0 && !sphere.as_printed) return point;  // leaves by itself
            const double s = -b + std::sqrt(b * b - c);
            n = direction(m + s * back);
            since = s / speed;
        }
        after.x = center + sphere.contact_radius * n;
    }
    // Eq 7 with restitution, and Coulomb's friction.
    const double approach = relative.dot(n);
    if (approach >= 0 && !sphere.as_printed) return after;
    after.v -= (1 + sphere.restitution) * approach * n;
    const Vec3 tangential = relative - approach * n;
    const double slip = tangential.norm(),
                 most = sphere.friction * std::abs((1 + sphere.restitution) * approach);
    if (sphere.friction > 0 && slip > 0) after.v -= std::min(1.0, most / slip) * tangential;
    // A point that does not bounce for good travels the rest of the step.
    if (!sphere.as_printed && (sphere.restitution < 1 || sphere.friction > 0))
        after.x += since * (after.v - moved);
    return after;
}

Sweep::Sweep(const Sphere& sphere, double t0, double t1, double dt)
    : start(sphere.center_at(t0)),
      end(sphere.center_at(t1)),
      velocity((end - start) / dt),
      radius(sphere.contact_radius),
      surface(radius + 4 * std::numeric_limits<double>::epsilon() * (end.cwiseAbs().sum() + radius)),
      restitution(sphere.restitution),
      friction(sphere.friction),
      push(sphere.push_out_speed * dt),
      dt(dt) {}

bool bounces_off(const FreeStep& step, const Sweep& s) {
    const Vec3 p = step.before.x - s.start;
    const auto hit =
        first_hit(s, p, step.after.x - s.end - p, step.after.v - s.velocity, step.after.v - step.before.v);
    return hit && hit->flies;
}

State respond(const FreeStep& step, const std::vector<Sweep>& spheres) {
    constexpr int most_contacts = 16;
    const Vec3 gain = step.after.v - step.before.v;
    State end = step.after;
    Vec3 here = step.before.x;
    double elapsed = 0;
    for (int contact = 0; contact < most_contacts; ++contact) {
        const Sweep* first = nullptr;
        std::optional<Hit> soonest;
        for (const Sweep& s : spheres) {
            const Vec3 p = here - (s.start + elapsed * (s.end - s.start));
            const auto hit = first_hit(s, p, end.x - s.end - p, end.v - s.velocity, gain);
            if (!hit || (soonest && hit->time >= soonest->time)) continue;
            first = &s;
            soonest = hit;
        }
        if (!first) return resolve(step.before, end, spheres);
        end = leave(step, *first, *soonest, end);
        elapsed += soonest->time * (1 - elapsed);
        here = first->start + elapsed * (first->end - first->start) + soonest->place;
        if (spheres.size() == 1) return resolve(step.before, end, spheres);
    }
    end.x = here;  // spheres close on it
    return resolve(step.before, end, spheres);
}

}  // namespace clothsim::reference
