// Continuous contact of a mass point with a sphere: when within a step they meet, and what follows.
//
// Everything is in the sphere's frame and in double. Within a step the point goes straight from where the step
// began to where the free step ended, the sphere straight between its two places, so that
//
//     p(t) = p0 + t q,   t = 0..1            |p(t)| = surface          (surface: contact radius + slop)
//
// With s the time of closest approach, m = p0 + s q there, a = q.q, b = p0.q and c = p0.p0 - surface^2:
//
//     t = c / (-b + sqrt(a (surface^2 - m.m)))
//
// which cancels neither for a point at the surface (c small) nor for one that grazes after a long way (b^2 and
// a c nearly equal: m is formed first).
//
// At t the normal n is fixed. Of the rest of the way the part along -n, of length `depth`, is taken back: the
// point ends in the tangent plane. What speed it had there follows from energy, as its free end lies `depth`
// lower: with u its normal speed at the free end and `press` its mean acceleration towards the sphere,
//
//     uc^2 = u^2 - 2 press depth
//
// so that a point at rest (u^2 = 2 press depth) is at rest afterwards, at any time step. It leaves with e uc.
// A bounce that flies for longer than a step goes on to where the mirrored way leads, and its energy is
// balanced exactly, springs included: that is `bounce` in collision/exact.hpp.
//
// Lane by lane without a branch, so that a compiler makes SIMD code of a loop over it; in an anonymous
// namespace because files of several instruction sets include it.
#pragma once

namespace clothsim {

// A sphere over one step, prepared for many points.
struct SweptSphere {
    double start[3], end[3];  // centre [m]
    double velocity[3];       // (end - start) / dt [m/s]
    double radius;            // below it a point is inside: the contact radius [m]
    double surface;           // on to which points are put, a few rounding errors further out [m]
    double slop;              // surface - radius
    double restitution, friction;
    double push;  // how far a point that was inside is pushed outwards in a step, at most [m]
    double dt;
};

namespace {

#define CLOTHSIM_LANE inline __attribute__((always_inline))

CLOTHSIM_LANE double dot3(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
CLOTHSIM_LANE double larger(double a, double b) { return a > b ? a : b; }
CLOTHSIM_LANE double smaller(double a, double b) { return a < b ? a : b; }

// Where a point meets the sphere within a step.
struct Touch {
    bool hit;     // within the step
    bool inside;  // at the start, by more than rounding
    double time;  // of the hit, part of the way that was left
    double normal[3];
    double place[3];  // of the hit, from the centre [m]
    double depth;     // how far the rest of the way leads below the tangent plane [m]
    double along[3];  // the rest of the way along the tangent plane [m]
    double speed;     // normal speed at the free end [m/s], negative: towards the sphere
    double press;     // mean acceleration towards the sphere [m/s^2]
    double bounce;    // normal speed after the contact [m/s], before anything presses again
};

// p0, q: start and way from there; v: velocity at the free end; gain: what the free step added to the velocity.
// All relative to the sphere.
CLOTHSIM_LANE Touch touch(const SweptSphere& s, const double p0[3], const double q[3], const double v[3],
                          const double gain[3]) {
    Touch r;
    const double surface2 = s.surface * s.surface;
    const double start2 = dot3(p0, p0);
    const double innermost = s.surface - 2 * s.slop;
    r.inside = start2 < innermost * innermost;
    const double a = dot3(q, q), b = dot3(p0, q);
    const double closest = a > 0 ? -b / a : 0;
    const double m[3] = {p0[0] + closest * q[0], p0[1] + closest * q[1], p0[2] + closest * q[2]};
    const double below = surface2 - dot3(m, m);
    const double c = larger(start2 - surface2, 0);
    const double root = __builtin_sqrt(larger(a * below, 0));
    const double down = -b + root;
    r.time = down > 0 ? c / down : 0;
    r.hit = (b < 0) & (below > 0) & (r.time <= 1) & !r.inside;
    const double rest = 1 - r.time;
    for (int k = 0; k < 3; ++k) r.place[k] = p0[k] + r.time * q[k];
    const double distance2 = dot3(r.place, r.place);
    const double inverse = distance2 > 0 ? 1 / __builtin_sqrt(distance2) : 0;
    for (int k = 0; k < 3; ++k) r.normal[k] = r.place[k] * inverse;
    const double normal_way = smaller(dot3(q, r.normal), 0);
    r.depth = -rest * normal_way;
    for (int k = 0; k < 3; ++k) r.along[k] = rest * (q[k] - normal_way * r.normal[k]);
    r.speed = dot3(v, r.normal);
    r.press = -dot3(gain, r.normal) / s.dt;
    const double arrival = larger(r.speed * r.speed - 2 * r.press * r.depth, 0);
    r.bounce = s.restitution * __builtin_sqrt(arrival);
    return r;
}

// Whether a bounce is still in the air when the step after it begins. The others are over before anybody could
// see them: the point stays at the surface and keeps the speed.
CLOTHSIM_LANE bool flies(const SweptSphere& s, const Touch& t) { return t.hit & (2 * t.bounce > t.press * s.dt); }

// Position (from the centre) and velocity (relative) after a contact that does not fly. `normal_speed`: after it.
// Coulomb: the tangential change is at most friction times the normal one.
CLOTHSIM_LANE void leave(const SweptSphere& s, const Touch& t, double height, double normal_speed, double p[3],
                         double v[3]) {
    const double change = normal_speed - t.speed;
    double tangential[3];
    for (int k = 0; k < 3; ++k) tangential[k] = v[k] - t.speed * t.normal[k];
    const double slip = __builtin_sqrt(dot3(tangential, tangential));
    const double most = s.friction * larger(change, 0);
    const double kept = slip > most ? 1 - most / slip : 0;
    const double keep = s.friction > 0 ? kept : 1;
    for (int k = 0; k < 3; ++k) {
        p[k] = t.place[k] + keep * t.along[k] + height * t.normal[k];
        v[k] = keep * tangential[k] + normal_speed * t.normal[k];
    }
}

// p brought to the distance `surface` if it is nearer than `limit`.
CLOTHSIM_LANE bool lift(double p[3], double limit, double surface) {
    const double distance2 = dot3(p, p);
    const bool low = distance2 < limit * limit;
    const double distance = __builtin_sqrt(distance2);
    const bool at_center = !(distance > 0);
    const double scale = at_center ? 0 : surface / distance;
    for (int k = 0; k < 3; ++k) p[k] = low ? p[k] * scale : p[k];
    p[1] = (low & at_center) ? surface : p[1];
    return low;
}

// A point that was inside: it goes outwards by no more than `push` a step unless it moves so itself, never
// deeper, and its velocity is not directed inwards any more.
CLOTHSIM_LANE void push_out(const SweptSphere& s, double start_distance, double p[3], double v[3]) {
    const double distance = __builtin_sqrt(dot3(p, p));
    const double aim = smaller(s.surface, larger(distance, start_distance + s.push));
    const bool inside = distance < s.surface;
    double n[3];
    for (int k = 0; k < 3; ++k) n[k] = distance > 0 ? p[k] / distance : (k == 1 ? 1.0 : 0.0);
    const double inwards = smaller(dot3(v, n), 0);
    for (int k = 0; k < 3; ++k) {
        p[k] = inside ? aim * n[k] : p[k];
        v[k] = inside ? v[k] - inwards * n[k] : v[k];
    }
}

// What became of a point in the pass over many.
enum class Meeting : int { none = 0, answered = 1, flies = 2 };

// The common case of a whole step for one point: x0, v0 before it, x, v after the free step, replaced by the
// answer unless it `flies`.
CLOTHSIM_LANE Meeting meet(const SweptSphere& s, const double x0[3], const double v0[3], double x[3], double v[3]) {
    double p0[3], p1[3], q[3], relative[3], gain[3];
    for (int k = 0; k < 3; ++k) {
        p0[k] = x0[k] - s.start[k];
        p1[k] = x[k] - s.end[k];
        q[k] = p1[k] - p0[k];
        relative[k] = v[k] - s.velocity[k];
        gain[k] = v[k] - v0[k];
    }
    const Touch t = touch(s, p0, q, relative, gain);
    const bool in_the_air = flies(s, t);

    double p[3], u[3], out[3], w[3];
    for (int k = 0; k < 3; ++k) {
        u[k] = relative[k];
        out[k] = p1[k];
        w[k] = relative[k];
    }
    leave(s, t, 0, larger(t.speed, t.bounce), p, u);
    push_out(s, __builtin_sqrt(dot3(p0, p0)), out, w);
    const double p1_2 = dot3(p1, p1);
    const bool pushed = t.inside & (p1_2 < s.surface * s.surface);
    for (int k = 0; k < 3; ++k) {
        p[k] = t.hit ? p[k] : (t.inside ? out[k] : p1[k]);
        u[k] = t.hit ? u[k] : (t.inside ? w[k] : relative[k]);
    }
    // Rounding: whoever was outside ends outside.
    const double limit = t.inside ? 0 : (t.hit ? s.surface : s.surface - s.slop / 2);
    const bool lifted = lift(p, limit, s.surface);
    const bool changed = (t.hit | pushed | lifted) & !in_the_air;
    for (int k = 0; k < 3; ++k) {
        x[k] = changed ? s.end[k] + p[k] : x[k];
        v[k] = changed ? s.velocity[k] + u[k] : v[k];
    }
    return in_the_air ? Meeting::flies : changed ? Meeting::answered : Meeting::none;
}

}  // namespace
}  // namespace clothsim
