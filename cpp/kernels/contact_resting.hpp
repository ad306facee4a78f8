// The usual case of continuous contact, at the full width of the lanes: points that lie on the sphere when the step
// begins and are pressed against it. They meet it at time 0, so that nothing is left of collision/continuous.hpp but
//
//     n = p0 / |p0|      x = x1 - (q - keep (q - (q.n) n))      v = v1 - (u - keep (u - (u.n) n) - u' n)
//
// and the change, which is small, is added to the compensated state as a stage of the integrator is. "On the sphere"
// is within a quarter of the slop, which Real can tell. Everything else is left over, and decided in double: points
// that come from further away, were inside, bounce, or go far in a step.
//
// Its arithmetic is fused, so the strict class does without.
#pragma once

#include "kernels/contact_arguments.hpp"
#include "kernels/vector3.hpp"

namespace clothsim {
namespace {

template <class Arch, class Real>
class OnSphere {
    using V = Lanes<Real, Arch>;
    using Mask = xsimd::batch_bool<Real, Arch>;
    static constexpr bool compensated = sizeof(Real) == 4;
    static constexpr double epsilon = compensated ? 0x1p-23 : 0x1p-52;

    // A double as its nearest Real and the rest.
    struct Split {
        V value, rest;
        CLOTHSIM_INLINE void set(double d) {
            value = V(Real(d));
            rest = V(Real(d - double(Real(d))));
        }
    };

public:
    CLOTHSIM_INLINE void prepare(const SweptSphere& s) {
        const double surface2 = s.surface * s.surface, low = s.surface - s.slop / 4, high = s.surface + s.slop / 4;
        for (int k = 0; k < 3; ++k) {
            center_[k].set(s.start[k]);
            way_[k].set(s.end[k] - s.start[k]);
            velocity_[k].set(s.velocity[k]);
        }
        lowest2_ = V(Real(low * low));
        highest2_ = V(Real(high * high));
        clear2_ = V(Real(high * high * (1 + 256 * epsilon)));
        short2_ = V(Real(surface2 / 256));
        inverse_surface2_ = V(Real(1 / surface2));
        half_inverse_surface_ = V(Real(0.5 / s.surface));
        inverse_dt_ = V(Real(1 / s.dt));
        restitution_ = V(Real(s.restitution));
        friction_ = V(Real(s.friction));
        bounces_ = s.restitution > 0;
        rough_ = s.friction > 0;
    }

    // Answers those of the lanes `near` that are such points; of the others, those that have to be looked at.
    CLOTHSIM_INLINE std::uint64_t answer(const VectorGeometry& g, Real* state, const Real* before, const Mask& near,
                                         const Mask& moves) const {
        const V zero(Real(0)), one(Real(1));
        V p[3], q[3];
        each<3>([&](auto k) __attribute__((always_inline)) {
            const Real* const x0 = before + k * g.component;
            const Real* const x1 = state + k * g.component;
            p[k] = load(x0) - center_[k].value;
            q[k] = load(x1) - load(x0) - way_[k].value;
            if constexpr (compensated) {
                const V rest = load(x0 + g.compensation);
                p[k] += rest - center_[k].rest;
                q[k] += load(x1 + g.compensation) - rest - way_[k].rest;
            }
        });
        const V start2 = inner(p, p), b = inner(p, q), a = inner(q, q);
        const Mask outside = start2 >= lowest2_, inwards = b < zero, brief = a < short2_;
        Mask touches = near & moves & outside & (start2 <= highest2_) & inwards & brief;
        // Still approaching when the step ends, well outside.
        const Mask falls_short = brief & (a + b < zero) & (start2 + (b + b + a) > clear2_);
        const Mask left_over = near & !touches & !(outside & (falls_short | !inwards));
        if (xsimd::none(touches)) return left_over.mask();

        // 1 / |p|, as |p| is the surface but for rounding: a Newton step.
        const V inverse = half_inverse_surface_ * xsimd::fnma(start2, inverse_surface2_, V(Real(3)));
        const V normal_way = b * inverse;
        V n[3], u[3];
        each<3>([&](auto k) __attribute__((always_inline)) {
            n[k] = p[k] * inverse;
            u[k] = load(state + (k + 3) * g.component) - velocity_[k].value;
            if constexpr (compensated) u[k] += load(state + (k + 3) * g.component + g.compensation) - velocity_[k].rest;
        });
        const V speed = inner(u, n);
        V leaving = xsimd::max(speed, zero);
        std::uint64_t in_the_air = 0;
        if (bounces_) {
            V gain[3];
            each<3>([&](auto k) __attribute__((always_inline)) {
                const Real* const v0 = before + (k + 3) * g.component;
                const Real* const v1 = state + (k + 3) * g.component;
                gain[k] = load(v1) - load(v0);
                if constexpr (compensated) gain[k] += load(v1 + g.compensation) - load(v0 + g.compensation);
            });
            const V pull = -inner(gain, n);
            const V arrival2 = xsimd::fma((pull + pull) * inverse_dt_, normal_way, speed * speed);
            const V bounce = restitution_ * xsimd::sqrt(xsimd::max(arrival2, zero));
            const Mask flies = touches & (bounce > zero) & (bounce + bounce > pull);
            in_the_air = flies.mask();
            touches = touches & !flies;
            leaving = xsimd::max(speed, bounce);
        }
        V tangential[3], keep = one;
        each<3>([&](auto k) __attribute__((always_inline)) { tangential[k] = xsimd::fnma(speed, n[k], u[k]); });
        if (rough_) {
            const V slip2 = inner(tangential, tangential), most = friction_ * (leaving - speed);
            const Mask slides = touches & (slip2 > most * most);
            keep = zero;
            if (xsimd::any(slides)) keep = xsimd::select(slides, one - most / xsimd::sqrt(slip2), zero);
        }
        each<3>([&](auto k) __attribute__((always_inline)) {
            const V along = xsimd::fnma(normal_way, n[k], q[k]);
            add(g, state + k * g.component, xsimd::fms(keep, along, q[k]), touches);
            add(g, state + (k + 3) * g.component,
                xsimd::fma(leaving, n[k], xsimd::fms(keep, tangential[k], u[k])), touches);
        });
        return left_over.mask() | in_the_air;
    }

private:
    static CLOTHSIM_INLINE V load(const Real* p) { return V::load_unaligned(p); }
    static CLOTHSIM_INLINE V inner(const V (&a)[3], const V (&b)[3]) {
        return xsimd::fma(a[2], b[2], xsimd::fma(a[1], b[1], a[0] * b[0]));
    }
    static CLOTHSIM_INLINE void add(const VectorGeometry& g, Real* place, const V& change, const Mask& chosen) {
        const V old = load(place);
        if constexpr (compensated) {
            const V rest = load(place + g.compensation);
            const V increment = change + rest, next = old + increment;
            xsimd::select(chosen, next, old).store_unaligned(place);
            xsimd::select(chosen, increment - (next - old), rest).store_unaligned(place + g.compensation);
        } else {
            xsimd::select(chosen, old + change, old).store_unaligned(place);
        }
    }

    Split center_[3], way_[3], velocity_[3];
    V lowest2_, highest2_, clear2_, short2_, inverse_surface2_, half_inverse_surface_, inverse_dt_, restitution_, friction_;
    bool bounces_, rough_;
};

}  // namespace
}  // namespace clothsim
