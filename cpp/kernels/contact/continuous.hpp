// Continuous contact of a mass point with a sphere: the time of impact within a step, and what follows.
//
// Everything is in the sphere's frame and in double. Within a step the point goes straight from the start of
// the step to the end of the free step. The sphere goes straight between its two places, so that
//
//     p(t) = p0 + t q,   t = 0..1            |p(t)| = surface          (surface: contact radius + slop)
//
// With s the time of closest approach, m = p0 + s q there, a = q.q, b = p0.q and c = p0.p0 - surface^2:
//
//     t = c / (-b + sqrt(a (surface^2 - m.m)))
//
// which does not cancel for a point at the surface (c small). Nor does it for a point that grazes after a
// long way (b^2 and a c nearly equal: m is formed first).
//
// At t the normal n is fixed. The part of the remaining way along -n, of length `depth`, is taken back: the
// point ends in the tangent plane. Its speed there follows from energy, as its free end lies `depth` lower.
// With u its normal speed at the free end and `press` its mean acceleration towards the sphere,
//
//     uc^2 = u^2 - 2 press depth
//
// so that a point at rest (u^2 = 2 press depth) is at rest afterwards, at any time step. It leaves with e uc.
// A bounce that flies for longer than a step goes on to the end of the mirrored way. Its energy is balanced
// exactly, springs included: contact/exact.hpp.
//
// Written for a number type D that is a double or a SIMD vector of doubles: branches only skip what no lane
// needs. In an anonymous namespace because files of several instruction sets include it.
#pragma once

namespace clothsim {

// A sphere over one step, prepared for many points.
struct SweptSphere {
    double start[3], end[3];  // centre [m]
    double velocity[3];  // (end - start) / dt [m/s]
    double radius;  // below it a point is inside: the contact radius [m]
    double surface;  // on to which points are put, a few rounding errors further out [m]
    double slop;  // surface - radius
    double reach;  // no point keeps a larger distance [m]
    bool cells;  // each point keeps sqrt(surface^2 + rho^2), see CellBand
    double band;  // with cells, over that distance, as a part of it
    double restitution, friction;
    double push;  // how far a point that was inside is pushed outwards in a step, at most [m]
    double dt;
};

namespace {

#define CLOTHSIM_LANE inline __attribute__((always_inline))

// Differences between a double and a vector of doubles.
template <class D>
struct Number {
    using Mask = bool;
    static CLOTHSIM_LANE bool any(bool c) { return c; }
    static CLOTHSIM_LANE D select(bool c, D a, D b) { return c ? a : b; }
    static CLOTHSIM_LANE D root(D a) { return __builtin_sqrt(a); }
};
template <class D>
using MaskOf = typename Number<D>::Mask;
template <class D>
CLOTHSIM_LANE D pick(const MaskOf<D>& c, const D& a, const D& b) {
    return Number<D>::select(c, a, b);
}
template <class D>
CLOTHSIM_LANE bool any(const MaskOf<D>& c) {
    return Number<D>::any(c);
}
template <class D>
CLOTHSIM_LANE D root(const D& a) {
    return Number<D>::root(a);
}
template <class D>
CLOTHSIM_LANE D larger(const D& a, const D& b) {
    return pick<D>(a > b, a, b);
}
template <class D>
CLOTHSIM_LANE D smaller(const D& a, const D& b) {
    return pick<D>(a < b, a, b);
}
template <class D>
CLOTHSIM_LANE D dot3(const D a[3], const D b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Distances from the centre at which a point responds.
template <class D>
struct Surface {
    D top;  // on to which it is put [m]
    D innermost;  // it was inside if it began below [m]
    D lowest;  // if it ends below without contact, it is put on top [m]
    D held;  // the same after a contact [m]
};

template <class D>
CLOTHSIM_LANE Surface<D> surface_of(const SweptSphere& s) {
    return {D(s.surface), D(s.surface - 2 * s.slop), D(s.surface - s.slop / 2), D(s.surface)};
}

// Offset "cell": a point keeps at least sqrt(surface^2 + rho^2), rho at most the surface. A response puts it
// on top of a band over this distance, and it may lie anywhere within. So rho can change a little without a
// second round of responses. The band is a part of the distance. With half of it a violent impact takes more
// rounds, with twice as much points stand off farther by another millionth.
struct CellBand {
    static constexpr double part = 1e-6;
    // But at most this part of the distance that a cell at rest adds to a large sphere. Half: more rounds
    // there. Twice: points stand off by another hundredth.
    static constexpr double part_of_cell = 0.01;
    // In single, which has to resolve a quarter of the band.
    static constexpr double part_in_single = 8e-6;
    // Rounding of rho^2 in the kernels, in epsilon; found by comparison with long double: up to 9.
    static constexpr double rounding = 32;
    // Circles around three corners that exceed the largest circle on two by less are not computed, but
    // covered. Cells of a cloth that lies smoothly have such circles. A part of rho^2. With half of it more
    // circles are computed, with twice as much points stand off farther by another 1e-4 of their stand-off.
    static constexpr double excess = 1e-4;
};
template <class Real>
inline constexpr double cell_band = sizeof(Real) == 4 ? CellBand::part_in_single : CellBand::part;
template <class Real>
inline constexpr double cell_rounding =
    1 + CellBand::excess + CellBand::rounding * (sizeof(Real) == 4 ? 0x1p-23 : 0x1p-52);

template <class Real, class D>
CLOTHSIM_LANE D least_distance2(const SweptSphere& s, const D& radius2) {
    const D surface2(s.surface * s.surface), inflated = radius2 * D(cell_rounding<Real>);
    return surface2 + pick<D>(inflated < surface2, inflated, surface2);
}
template <class Real, class D>
CLOTHSIM_LANE Surface<D> cell_surface(const SweptSphere& s, const D& radius2) {
    const D least = root(least_distance2<Real>(s, radius2));
    return {least * D(1 + s.band), least - D(s.slop), least, least * D(1 + s.band / 2)};
}

// Where a point touches the sphere within a step.
template <class D>
struct Touch {
    MaskOf<D> hit;  // within the step
    MaskOf<D> inside;  // at the start, by more than rounding
    D time;  // of the hit, part of the way that was left
    D normal[3];
    D place[3];  // of the hit, from the centre [m]
    D depth;  // how far the rest of the way leads below the tangent plane [m]
    D along[3];  // the rest of the way along the tangent plane [m]
    D speed;  // normal speed at the free end [m/s], negative: towards the sphere
    D press;  // mean acceleration towards the sphere [m/s^2]
    D bounce;  // normal speed after the contact [m/s], before anything presses again
};

// p0, q: start and way from there; v: velocity at the free end; gain: what the free step added to the
// velocity. All relative to the sphere.
template <class D>
CLOTHSIM_LANE Touch<D> touch(const SweptSphere& s, const Surface<D>& surface, const D p0[3], const D q[3],
                             const D v[3], const D gain[3]) {
    Touch<D> r;
    const D zero(0), one(1), surface2 = surface.top * surface.top;
    const D start2 = dot3(p0, p0);
    r.inside = start2 < surface.innermost * surface.innermost;
    const D a = dot3(q, q), b = dot3(p0, q);
    const D closest = pick<D>(a > zero, -b / a, zero);
    const D m[3] = {p0[0] + closest * q[0], p0[1] + closest * q[1], p0[2] + closest * q[2]};
    const D below = surface2 - dot3(m, m);
    const D c = larger(start2 - surface2, zero);
    const D down = root(larger(a * below, zero)) - b;
    r.time = pick<D>(down > zero, c / down, zero);
    r.hit = (b < zero) & (below > zero) & (r.time <= one) & !r.inside;
    const D rest = one - r.time;
    for (int k = 0; k < 3; ++k) r.place[k] = p0[k] + r.time * q[k];
    const D distance2 = dot3(r.place, r.place);
    const D inverse = pick<D>(distance2 > zero, one / root(distance2), zero);
    for (int k = 0; k < 3; ++k) r.normal[k] = r.place[k] * inverse;
    const D normal_way = smaller(dot3(q, r.normal), zero);
    r.depth = -rest * normal_way;
    for (int k = 0; k < 3; ++k) r.along[k] = rest * (q[k] - normal_way * r.normal[k]);
    r.speed = dot3(v, r.normal);
    r.press = -dot3(gain, r.normal) / D(s.dt);
    const D arrival2 = r.speed * r.speed - D(2) * r.press * r.depth;
    r.bounce = s.restitution > 0 ? D(s.restitution) * root(larger(arrival2, zero)) : zero;
    return r;
}

// Whether a bounce is still in the air when the step after it begins. The others are over before anybody
// could see them: the point stays at the surface and keeps the speed.
template <class D>
CLOTHSIM_LANE MaskOf<D> flies(const SweptSphere& s, const Touch<D>& t) {
    return t.hit & (t.bounce > D(0)) & (D(2) * t.bounce > t.press * D(s.dt));
}

// Position (from the centre) and velocity (relative; before: at the free end) after a contact, `height` above
// the tangent plane. Coulomb: the tangential change is at most friction times the normal one.
template <class D>
CLOTHSIM_LANE void leave(const SweptSphere& s, const Touch<D>& t, const D& height, const D& normal_speed,
                         D p[3], D v[3]) {
    const D zero(0), one(1);
    D tangential[3];
    for (int k = 0; k < 3; ++k) tangential[k] = v[k] - t.speed * t.normal[k];
    D keep = one;
    if (s.friction > 0) {
        constexpr double a_little_less = 1 - 0x1p-40;  // for the rounding of squares; not tuned
        const D slip2 = dot3(tangential, tangential);
        const D most = D(s.friction) * larger(normal_speed - t.speed, zero);
        keep = zero;
        if (any<D>(t.hit & (slip2 > D(a_little_less) * most * most))) {
            const D slip = root(slip2);
            keep = pick<D>(slip > most, one - most / slip, zero);
        }
    }
    for (int k = 0; k < 3; ++k) {
        p[k] = t.place[k] + keep * t.along[k] + height * t.normal[k];
        v[k] = keep * tangential[k] + normal_speed * t.normal[k];
    }
}

// p brought to the distance `surface` if it is nearer than `limit`.
template <class D>
CLOTHSIM_LANE MaskOf<D> lift(D p[3], const D& limit, const D& surface) {
    const D zero(0), distance2 = dot3(p, p);
    const MaskOf<D> low = distance2<limit * limit, away = distance2> zero;
    if (!any<D>(low)) return low;
    const D scale = pick<D>(away, surface / root(distance2), zero);
    for (int k = 0; k < 3; ++k) p[k] = pick<D>(low, p[k] * scale, p[k]);
    p[1] = pick<D>(low & !away, surface, p[1]);
    return low;
}

// A point that was inside goes outwards by no more than `push` a step unless it moves so itself, and never
// deeper. Its velocity is not directed inwards any more. Returns whether the point was changed.
template <class D>
CLOTHSIM_LANE MaskOf<D> push_out(const SweptSphere& s, const D& surface, const D& start_distance, D p[3],
                                 D v[3]) {
    const D zero(0), distance = root(dot3(p, p));
    const D aim = smaller(surface, larger(distance, start_distance + D(s.push)));
    const MaskOf<D> inside = distance<surface, away = distance> zero;
    D n[3];
    for (int k = 0; k < 3; ++k) n[k] = pick<D>(away, p[k] / distance, D(k == 1));
    const D inwards = smaller(dot3(v, n), zero);
    for (int k = 0; k < 3; ++k) {
        p[k] = pick<D>(inside, aim * n[k], p[k]);
        v[k] = pick<D>(inside, v[k] - inwards * n[k], v[k]);
    }
    return inside;
}

// Outcome of a point in the pass over many.
template <class D>
struct VectorResponse {
    MaskOf<D> responded, in_the_air, inside;
};

// The common case of a whole step for one point, from x0, v0. The response replaces x, v after the free step,
// unless the point bounces off and flies.
template <class D>
CLOTHSIM_LANE VectorResponse<D> respond(const SweptSphere& s, const Surface<D>& surface, const D x0[3],
                                        const D v0[3], D x[3], D v[3]) {
    D p0[3], p1[3], q[3], relative[3], gain[3];
    for (int k = 0; k < 3; ++k) {
        p0[k] = x0[k] - D(s.start[k]);
        p1[k] = x[k] - D(s.end[k]);
        q[k] = p1[k] - p0[k];
        relative[k] = v[k] - D(s.velocity[k]);
        gain[k] = v[k] - v0[k];
    }
    const Touch<D> t = touch(s, surface, p0, q, relative, gain);
    const MaskOf<D> in_the_air = flies(s, t);

    D p[3], u[3];
    for (int k = 0; k < 3; ++k) u[k] = relative[k];
    leave(s, t, D(0), larger(t.speed, t.bounce), p, u);
    for (int k = 0; k < 3; ++k) {
        p[k] = pick<D>(t.hit, p[k], p1[k]);
        u[k] = pick<D>(t.hit, u[k], relative[k]);
    }
    MaskOf<D> pushed = t.inside;
    if (any<D>(t.inside)) {
        D out[3], w[3];
        for (int k = 0; k < 3; ++k) {
            out[k] = p1[k];
            w[k] = relative[k];
        }
        pushed = t.inside & push_out(s, surface.top, root(dot3(p0, p0)), out, w);
        for (int k = 0; k < 3; ++k) {
            p[k] = pick<D>(pushed, out[k], p[k]);
            u[k] = pick<D>(pushed, w[k], u[k]);
        }
    }
    // Rounding: a point that was outside ends outside.
    const D limit = pick<D>(t.inside, D(0), pick<D>(t.hit, surface.held, surface.lowest));
    const MaskOf<D> lifted = lift(p, limit, surface.top);
    const MaskOf<D> responded = (t.hit | pushed | lifted) & !in_the_air;
    for (int k = 0; k < 3; ++k) {
        x[k] = pick<D>(responded, D(s.end[k]) + p[k], x[k]);
        v[k] = pick<D>(responded, D(s.velocity[k]) + u[k], v[k]);
    }
    return {responded, in_the_air, t.inside};
}

}  // namespace
}  // namespace clothsim
