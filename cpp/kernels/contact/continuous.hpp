// Continuous contact of a mass point with a sphere or a plane: the time of impact within a step, and what
// follows it.
//
// A sphere is told by a place p0 on it, its normal n there and its curvature k = 1/R; 0 is a plane. With
// d = p - p0 the level of a place and the height over the surface are
//
//     f(d) = 2 n.d + k d.d = d.(n + m(d))    m(d) = n + k d    height = f / (1 + sqrt(1 + k f))
//
// No large numbers cancel. |m| = sqrt(1 + k f), m / |m| is the normal at the place, and f = h (2 + k h).
//
// Everything is in the sphere's frame. Within a step the point goes straight from the start of the step to
// the end of the free step. The sphere goes straight between its two places, so that
//
//     d(t) = d0 + t q,   t = 0..1           f(d(t)) = top
//
// With a = k q.q and b = m(d0).q, let s be the time of closest approach, at most 1, and b' = b + s a there:
//
//     t = (f(d0) - top) / (-b + sqrt(b'^2 + a (top - f(d(s)))))
//
// which does not cancel for a point at the surface. Nor does it for a point that grazes after a long way,
// where b^2 and a (f(d0) - top) are nearly equal.
//
// At t the normal is fixed. The part of the remaining way along it, of length `depth`, is taken back: the
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
    double start[3], end[3];  // p0 [m]
    double velocity[3];  // (end - start) / dt [m/s]
    double normal[3], curvature;  // n, k [1/m]
    double size;  // the radius, or less: points are expected this near p0 [m]
    // Levels [m]: a point was inside if it began below `innermost`. None may end below `least`. A response
    // puts it on top of a band over that, and it may lie anywhere within.
    double innermost, least, band;
    bool cells;  // each point keeps the level k rho^2 more, but no more than `most_of_cells`
    double most_of_cells;
    double near_level, near_curvature;  // of the check for points that may respond (contact_impl.hpp)
    double tolerance;  // see ContactBand [m]
    double restitution, friction;
    double push;  // how far a point that was inside is pushed outwards in a step, at most [m]
    double dt;
};

// Bands [of the size].
struct ContactBand {
    // Without cells, as a level in epsilon; rounding of a level is up to 5 epsilon.
    static constexpr double least = 8;
    // Points that lie so far above the top, as a level in epsilon, rest there: sliding on a sphere raises
    // them. With half of it more of them go to the slower path; twice is seen in "single".
    static constexpr double tolerance = 16;
    // With cells, as lengths. In double it is bounded by a part of what a cell at rest adds to the radius.
    // With half of it a violent impact takes more rounds, with twice as much points stand off farther by
    // another millionth.
    static constexpr double of_cells = 1e-6, least_of_cells = 64 * 0x1p-52, of_cells_in_single = 8e-6;
    // Half: more rounds on large spheres. Twice: points stand off by another hundredth.
    static constexpr double part_of_cell = 0.01;
    // Rounding of rho^2 in the kernels, in epsilon; found by comparison with 64 bits of mantissa: up to 9.
    static constexpr double rounding_of_cells = 32;
    // Circles around three corners that exceed the largest circle on two by less are not computed, but
    // covered. Cells of a cloth that lies smoothly have such circles. A part of rho^2. With half of it more
    // circles are computed, with twice as much points stand off farther by another 1e-4 of their stand-off.
    static constexpr double excess = 1e-4;
};
template <class Real>
inline constexpr double cell_rounding =
    1 + ContactBand::excess + ContactBand::rounding_of_cells * (sizeof(Real) == 4 ? 0x1p-23 : 0x1p-52);

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

// m(d); returns f(d).
template <class D>
CLOTHSIM_LANE D level(const SweptSphere& s, const D d[3], D m[3]) {
    D sum[3];
    for (int j = 0; j < 3; ++j) {
        m[j] = D(s.normal[j]) + D(s.curvature) * d[j];
        sum[j] = D(s.normal[j]) + m[j];
    }
    return dot3(d, sum);
}
template <class D>
CLOTHSIM_LANE D height_of(const SweptSphere& s, const D& level) {
    return level / (D(1) + root(larger(D(1) + D(s.curvature) * level, D(0))));
}
template <class D>
CLOTHSIM_LANE D level_of(const SweptSphere& s, const D& height) {
    return height * (D(2) + D(s.curvature) * height);
}

// Levels at which a point responds. One that starts no more than `SweptSphere::tolerance` above the top lies
// on the sphere.
template <class D>
struct Surface {
    D top;  // on to which it is put
    D innermost;  // it was inside if it began below
    D lowest;  // if it ends below, it is put on top
};

// `radius2`: rho^2 of the point's cells, with offset "cell".
template <class Real, class D>
CLOTHSIM_LANE D least_level(const SweptSphere& s, const D& radius2) {
    const D more = radius2 * D(s.curvature * cell_rounding<Real>);
    return D(s.least) + smaller(more, D(s.most_of_cells));
}
template <class Real, class D>
CLOTHSIM_LANE Surface<D> surface_of(const SweptSphere& s, const D& radius2) {
    const D least = s.cells ? least_level<Real>(s, radius2) : D(s.least);
    return {least + D(s.band), least - D(s.least - s.innermost), least};
}

// Where a point touches the sphere within a step.
template <class D>
struct Touch {
    MaskOf<D> hit;  // within the step
    MaskOf<D> inside;  // at the start, by more than rounding
    MaskOf<D> rested;  // on the sphere at the start
    D time;  // of the hit, part of the way that was left
    D normal[3];
    D place[3];  // of the hit, from p0 [m]
    D depth;  // how far the rest of the way leads below the tangent plane [m]
    D along[3];  // the rest of the way along the tangent plane [m]
    D speed;  // normal speed at the free end [m/s], negative: towards the sphere
    D press;  // mean acceleration towards the sphere [m/s^2]
    D bounce;  // normal speed after the contact [m/s], before anything presses again
};

// d0, q: start and way from there; v: velocity at the free end; gain: what the free step added to the
// velocity. All relative to the sphere.
template <class D>
CLOTHSIM_LANE Touch<D> touch(const SweptSphere& s, const Surface<D>& surface, const D d0[3], const D q[3],
                             const D v[3], const D gain[3]) {
    Touch<D> r;
    const D zero(0), one(1);
    D m[3];
    const D start = level(s, d0, m), a = D(s.curvature) * dot3(q, q), b = dot3(m, q);
    r.inside = start < surface.innermost;
    r.rested = start <= surface.top + D(s.tolerance);
    const D closest = smaller(pick<D>(a > zero, -b / a, one), one);
    const D nearest[3] = {d0[0] + closest * q[0], d0[1] + closest * q[1], d0[2] + closest * q[2]};
    const D below = surface.top - level(s, nearest, m), last = b + closest * a;
    const D down = root(larger(last * last + a * below, zero)) - b;
    r.time = pick<D>(r.rested | (down <= zero), zero, (start - surface.top) / down);
    r.hit = (b < zero) & (r.rested | ((below > zero) & (r.time <= one))) & !r.inside;
    const D rest = one - r.time;
    for (int k = 0; k < 3; ++k) r.place[k] = d0[k] + r.time * q[k];
    level(s, r.place, m);
    const D length2 = dot3(m, m), inverse = pick<D>(length2 > zero, one / root(length2), zero);
    for (int k = 0; k < 3; ++k) r.normal[k] = m[k] * inverse;
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

// Place (from p0) and velocity (relative; before: at the free end) after a contact, `height` above the
// tangent plane. Coulomb: the tangential change is at most friction times the normal one.
template <class D>
CLOTHSIM_LANE void leave(const SweptSphere& s, const Touch<D>& t, const D& height, const D& normal_speed,
                         D d[3], D v[3]) {
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
        d[k] = t.place[k] + keep * t.along[k] + height * t.normal[k];
        v[k] = keep * tangential[k] + normal_speed * t.normal[k];
    }
}

// d brought along its normal to the level `top` if it is below `limit`. The exact centre goes along n.
template <class D>
CLOTHSIM_LANE MaskOf<D> lift(const SweptSphere& s, D d[3], const D& limit, const D& top) {
    const D zero(0), one(1), k(s.curvature);
    D m[3];
    const D now = level(s, d, m), length2 = one + k * now;
    const MaskOf<D> low = now<limit, away = length2> zero;
    if (!any<D>(low)) return low;
    const D rise = (top - now) / pick<D>(away, length2 + root(length2 * (one + k * top)), one);
    const D from_centre = height_of(s, top);
    for (int j = 0; j < 3; ++j)
        d[j] = pick<D>(low, pick<D>(away, d[j] + rise * m[j], from_centre * D(s.normal[j])), d[j]);
    return low;
}

// A point that was inside, `start` high, goes outwards by no more than `push` a step unless it moves so
// itself, and never deeper. Its velocity is not directed inwards any more. Returns whether the point was
// changed.
template <class D>
CLOTHSIM_LANE MaskOf<D> push_out(const SweptSphere& s, const D& top, const D& start, D d[3], D v[3]) {
    const D zero(0), one(1);
    D m[3];
    const D now = level(s, d, m), length2 = dot3(m, m);
    const MaskOf<D> inside = now<top, away = length2> zero;
    const D inverse = pick<D>(away, one / root(length2), zero);
    for (int j = 0; j < 3; ++j) m[j] = pick<D>(away, m[j] * inverse, D(s.normal[j]));
    const D inwards = smaller(dot3(v, m), zero);
    for (int j = 0; j < 3; ++j) v[j] = pick<D>(inside, v[j] - inwards * m[j], v[j]);
    const D aim = smaller(height_of(s, top), larger(height_of(s, now), start + D(s.push)));
    lift(s, d, top, pick<D>(inside, level_of(s, aim), now));
    return inside;
}

// Outcome of a point in the pass over many.
template <class D>
struct VectorResponse {
    MaskOf<D> responded, in_the_air, inside;
    D press;  // the speed that a contact from the start of the step on has taken [m/s]
    D height;  // at the end [m]
};

// The common case of a whole step for one point, from x0, v0. The response replaces x, v after the free step,
// unless the point bounces off and flies.
template <class D>
CLOTHSIM_LANE VectorResponse<D> respond(const SweptSphere& s, const Surface<D>& surface, const D x0[3],
                                        const D v0[3], D x[3], D v[3]) {
    const D zero(0);
    D d0[3], d1[3], q[3], relative[3], gain[3], m[3];
    for (int k = 0; k < 3; ++k) {
        d0[k] = x0[k] - D(s.start[k]);
        d1[k] = x[k] - D(s.end[k]);
        q[k] = d1[k] - d0[k];
        relative[k] = v[k] - D(s.velocity[k]);
        gain[k] = v[k] - v0[k];
    }
    const Touch<D> t = touch(s, surface, d0, q, relative, gain);
    const MaskOf<D> in_the_air = flies(s, t);
    const D leaving = larger(t.speed, t.bounce);

    D d[3], u[3];
    for (int k = 0; k < 3; ++k) u[k] = relative[k];
    leave(s, t, zero, leaving, d, u);
    for (int k = 0; k < 3; ++k) {
        d[k] = pick<D>(t.hit, d[k], d1[k]);
        u[k] = pick<D>(t.hit, u[k], relative[k]);
    }
    MaskOf<D> pushed = t.inside;
    if (any<D>(t.inside)) {
        D out[3], w[3];
        for (int k = 0; k < 3; ++k) {
            out[k] = d1[k];
            w[k] = relative[k];
        }
        pushed = t.inside & push_out(s, surface.top, height_of(s, level(s, d0, m)), out, w);
        for (int k = 0; k < 3; ++k) {
            d[k] = pick<D>(pushed, out[k], d[k]);
            u[k] = pick<D>(pushed, w[k], u[k]);
        }
    }
    // Rounding: a point that was outside ends outside.
    const MaskOf<D> lifted = lift(s, d, pick<D>(t.inside, D(-1e300), surface.lowest), surface.top);
    const MaskOf<D> responded = (t.hit | pushed | lifted) & !in_the_air;
    for (int k = 0; k < 3; ++k) {
        x[k] = pick<D>(responded, D(s.end[k]) + d[k], x[k]);
        v[k] = pick<D>(responded, D(s.velocity[k]) + u[k], v[k]);
    }
    const D height = any<D>(t.inside) ? height_of(s, level(s, d, m)) : zero;
    return {responded, in_the_air, t.inside, pick<D>(t.hit & t.rested, leaving - t.speed, zero), height};
}

}  // namespace
}  // namespace clothsim
