// The usual case of continuous contact, at the full width of the lanes. The points lie on the
// sphere when the step begins and are pressed against it. Their time of impact is 0, so
// contact/continuous.hpp reduces to
//
//     n = m(d0) / |m(d0)|   x = x1 - lost q - kept (q.n) n   v = v1 - lost u - kept (u.n) n + u' n
//
// with `lost` the part of the tangential motion that friction takes and kept = 1 - lost. The
// change, which is small, is added to the compensated state as a stage of the integrator is.
//
// Real decides where its rounding leaves no doubt that a point is such a point, or that it keeps
// clear of the sphere in this step. In double that includes points that come down from just above
// the sphere. All others go to contact/continuous.hpp, in double: they come from further away, were
// inside, bounce, or go far in a step.
//
// Its arithmetic is fused, so the strict class does without.
#pragma once

#include "kernels/contact/contact_arguments.hpp"
#include "lanes/vector3.hpp"

namespace clothsim {
namespace {

template <class Arch, class Real>
class OnSphere {
    using V = Lanes<Real, Arch>;
    using Mask = xsimd::batch_bool<Real, Arch>;
    static constexpr bool compensated = sizeof(Real) == 4;
    // The square of the least sine between a way and the surface whose sign is certain.
    static constexpr double least_sine2 = compensated ? 1e-12 : 0;

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
        each<3>([&](auto k) __attribute__((always_inline)) {
            start_[k].set(s.start[k]);
            way_[k].set(s.end[k] - s.start[k]);
            velocity_[k].set(s.velocity[k]);
            normal_[k] = V(Real(s.normal[k]));
            momentum_[k] = V(Real(0));
        });
        curvature_ = V(Real(s.curvature));
        least_ = V(Real(s.least + s.tolerance / 4));
        of_cells_ = V(Real(s.cells ? s.curvature * cell_rounding<Real> : 0));
        most_of_cells_ = V(Real(s.most_of_cells));
        band_ = V(Real(s.band));
        tolerance_ = V(Real(s.tolerance));
        brief2_ = V(Real(s.size * s.size / 256));
        inverse_dt_ = V(Real(1 / s.dt));
        restitution_ = V(Real(s.restitution));
        friction_ = V(Real(s.friction));
        bounces_ = s.restitution > 0;
        rough_ = s.friction > 0;
        still_ = true;
        for (int k = 0; k < 3; ++k) still_ &= s.end[k] == s.start[k];
    }

    // Responds in those lanes of `near` that are such points, and adds them to `responded`. Returns
    // the other lanes that have to be inspected. `radius2`: rho^2 of the points, 0 without cells.
    // `press`: of the points that respond.
    CLOTHSIM_INLINE std::uint64_t respond(const VectorGeometry& g, Real* state, const Real* before,
                                          const Mask& near, const Mask& moves, const V& radius2,
                                          const Real* mass, std::uint64_t& responded, V& press) {
        const V zero(Real(0)), one(Real(1));
        V d[3], q[3], m[3], sum[3];
        each<3>([&](auto k) __attribute__((always_inline)) {
            const Real* const x0 = before + k * g.component;
            const Real* const x1 = state + k * g.component;
            d[k] = load(x0) - start_[k].value;
            q[k] = load(x1) - load(x0) - way_[k].value;
            if constexpr (compensated) {
                const V rest = load(x0 + g.compensation);
                d[k] += rest - start_[k].rest;
                q[k] += load(x1 + g.compensation) - rest - way_[k].rest;
            }
            m[k] = xsimd::fma(curvature_, d[k], normal_[k]);
            sum[k] = m[k] + normal_[k];
        });
        const V start = inner(d, sum), way2 = inner(q, q);
        V inwards = inner(m, q);
        const V least = least_ + xsimd::min(radius2 * of_cells_, most_of_cells_),
                top = least + band_;
        const V end = start + (inwards + inwards + curvature_ * way2);
        const auto outside = start >= least, brief = way2 < brief2_;
        const auto certain = inwards * inwards >= V(Real(least_sine2)) * way2;
        // Still approaching when the step ends, well outside.
        const auto falls_short =
            brief & (xsimd::fma(curvature_, way2, inwards) < zero) & (end > top + tolerance_);
        const auto clear = outside & (falls_short | (certain & !(inwards < zero)));
        const Mask sinks = near & moves & outside & certain & (inwards < zero) & brief;
        Mask touches = sinks & (start <= top + tolerance_ * V(Real(0.75))), lands = sinks & !sinks;
        if constexpr (!compensated) {
            // Cells that shrink lower the surface, so that points at rest come from just above it.
            // Here q becomes the rest of the way, and m that of the place of impact.
            const V above = start - top;
            lands = sinks & (start > top + tolerance_ + tolerance_) & (end <= top);
            if (xsimd::any(lands)) {
                const V root =
                    xsimd::sqrt(xsimd::max(inwards * inwards - curvature_ * way2 * above, zero));
                const V time = xsimd::select(lands, above / (root - inwards), zero);
                each<3>([&](auto k) __attribute__((always_inline)) {
                    m[k] = xsimd::fma(curvature_ * time, q[k], m[k]);
                    q[k] = xsimd::fnma(time, q[k], q[k]);
                });
                inwards = inner(m, q);
                touches = touches | lands;
            }
        }
        const std::uint64_t unresolved = (near & !(touches | clear)).mask();
        if (xsimd::none(touches)) return unresolved;

        const V inverse = inverse_root(inner(m, m)),
                normal_way = xsimd::min(inwards, zero) * inverse;
        V n[3], u[3];
        each<3>([&](auto k) __attribute__((always_inline)) {
            n[k] = m[k] * inverse;
            u[k] = load(state + (k + 3) * g.component) - velocity_[k].value;
            if constexpr (compensated)
                u[k] += load(state + (k + 3) * g.component + g.compensation) - velocity_[k].rest;
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
                if constexpr (compensated)
                    gain[k] += load(v1 + g.compensation) - load(v0 + g.compensation);
            });
            const V pull = -inner(gain, n);
            const V arrival2 = xsimd::fma((pull + pull) * inverse_dt_, normal_way, speed * speed);
            const V bounce = restitution_ * xsimd::sqrt(xsimd::max(arrival2, zero));
            const Mask flies = touches & (bounce > zero) & (bounce + bounce > pull);
            in_the_air = flies.mask();
            touches = touches & !flies;
            leaving = xsimd::max(speed, bounce);
        }
        V lost = zero;  // part of the tangential motion that friction takes
        if (rough_) {
            V tangential[3];
            each<3>([&](auto k) __attribute__((always_inline)) {
                tangential[k] = xsimd::fnma(speed, n[k], u[k]);
            });
            const V slip2 = inner(tangential, tangential), most = friction_ * (leaving - speed);
            const Mask slides = touches & (slip2 > most * most);
            lost = one;
            if (xsimd::any(slides)) lost = xsimd::select(slides, most * inverse_root(slip2), one);
            else if (still_ && xsimd::none(lands | (touches & (leaving > zero)))) {
                stay(g, state, before, u, mass, touches);
                press = xsimd::select(touches, -speed, press);
                responded |= touches.mask();
                return unresolved | in_the_air;
            }
        }
        // Without friction along the normal alone, at rest exactly back: a normal part far below
        // q's rounding counts.
        const V kept = one - lost, normal_gain = xsimd::fnma(kept, speed, leaving),
                normal_change = kept * normal_way;
        each<3>([&](auto k) __attribute__((always_inline)) {
            add(g, state + k * g.component, xsimd::fnms(lost, q[k], normal_change * n[k]), touches);
            const V gain = xsimd::fnma(lost, u[k], normal_gain * n[k]);
            add(g, state + (k + 3) * g.component, gain, touches);
            momentum_[k] = xsimd::fma(load(mass), xsimd::select(touches, gain, zero), momentum_[k]);
        });
        gave_ = true;
        press = xsimd::select(touches & !lands, leaving - speed, press);
        responded |= touches.mask();
        return unresolved | in_the_air;
    }

    // Takes the momentum of the responses of a row from the impulse on the sphere.
    CLOTHSIM_INLINE void end_row(double* impulse) {
        if (!gave_) return;
        gave_ = false;
        each<3>([&](auto k) __attribute__((always_inline)) {
            impulse[k] -= double(xsimd::reduce_add(momentum_[k]));
            momentum_[k] = V(Real(0));
        });
    }

private:
    // Points that friction holds on a sphere at rest are where they were.
    CLOTHSIM_INLINE void stay(const VectorGeometry& g, Real* state, const Real* before,
                              const V (&u)[3], const Real* mass, const Mask& touches) {
        const V zero(Real(0));
        gave_ = true;
        each<3>([&](auto k) __attribute__((always_inline)) {
            momentum_[k] =
                xsimd::fnma(load(mass), xsimd::select(touches, u[k], zero), momentum_[k]);
            each<compensated ? 2 : 1>([&](auto part) __attribute__((always_inline)) {
                const std::ptrdiff_t x = k * g.component + part * g.compensation,
                                     v = x + 3 * g.component;
                xsimd::select(touches, load(before + x), load(state + x))
                    .store_unaligned(state + x);
                xsimd::select(touches, zero, load(state + v)).store_unaligned(state + v);
            });
        });
    }
    static CLOTHSIM_INLINE V inverse_root(const V& a) {
        return scaled_reciprocal_root(a) * V(1 / root_scale<Real, Arch>());
    }
    static CLOTHSIM_INLINE V load(const Real* p) { return V::load_unaligned(p); }
    static CLOTHSIM_INLINE V inner(const V (&a)[3], const V (&b)[3]) {
        return xsimd::fma(a[2], b[2], xsimd::fma(a[1], b[1], a[0] * b[0]));
    }
    static CLOTHSIM_INLINE void add(const VectorGeometry& g, Real* place, const V& change,
                                    const Mask& chosen) {
        const V old = load(place);
        if constexpr (compensated) {
            const V rest = load(place + g.compensation);
            const V increment = change + rest, next = old + increment;
            xsimd::select(chosen, next, old).store_unaligned(place);
            xsimd::select(chosen, increment - (next - old), rest)
                .store_unaligned(place + g.compensation);
        } else {
            xsimd::select(chosen, old + change, old).store_unaligned(place);
        }
    }

    Split start_[3], way_[3], velocity_[3];
    V normal_[3], curvature_, least_, of_cells_, most_of_cells_, band_, tolerance_, brief2_,
        inverse_dt_, restitution_, friction_;
    V momentum_[3];  // that this row has been given [N s]
    bool bounces_, rough_, still_, gave_ = false;
};

}  // namespace
}  // namespace clothsim
