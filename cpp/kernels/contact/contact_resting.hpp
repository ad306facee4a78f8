// The usual case of continuous contact, at the full width of the lanes. The points lie on the sphere when the
// step begins and are pressed against it. Their time of impact is 0, so kernels/contact/continuous.hpp
// reduces to
//
//     n = p0 / |p0|      x = x1 - lost q - kept (q.n) n      v = v1 - lost u - kept (u.n) n + u' n
//
// with `lost` the part of the tangential motion that friction takes and kept = 1 - lost. The change, which is
// small, is added to the compensated state as a stage of the integrator is. "On the sphere" is within a
// quarter of the slop.
//
// Two questions are decided in double whatever Real is. First, whether a point is such a point. Second,
// whether another point keeps clear of the sphere in this step. All others go to
// kernels/contact/continuous.hpp. They come from further away, were inside, bounce, or go far in a step.
//
// With offset "cell" the band above the distance (CellBand) is far wider than rounding in Real, so Real
// decides.
//
// Its arithmetic is fused, so the strict class does without.
#pragma once

#include "kernels/contact/contact_arguments.hpp"
#include "kernels/contact/contact_wide.hpp"
#include "kernels/vector3.hpp"

namespace clothsim {
namespace {

template <class Arch, class Real, bool cells>
class OnSphere {
    using V = Lanes<Real, Arch>;
    using Mask = xsimd::batch_bool<Real, Arch>;
    using Memory = Wide<Arch, Real>;
    using D = typename Memory::D;
    static constexpr bool compensated = sizeof(Real) == 4;
    // Rounding of squares in single [part], up to 6e-7. Half of it would find points on the surface inside;
    // with twice as much more points of the band go to the slower path.
    static constexpr double rounding_in_single = 1e-6;

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
        const double surface2 = s.surface * s.surface, low = s.surface - s.slop / 4,
                     high = s.surface + s.slop / 4;
        for (int k = 0; k < 3; ++k) {
            center_[k].set(s.start[k]);
            way_[k].set(s.end[k] - s.start[k]);
            velocity_[k].set(s.velocity[k]);
            wide_center_[k] = D(s.start[k]);
            wide_way_[k] = D(s.end[k] - s.start[k]);
        }
        lowest2_ = D(low * low);
        highest2_ = D(high * high);
        clear2_ = D(high * high * (1 + 0x1p-44));
        short2_ = D(surface2 / 256);
        surface2_ = V(Real(surface2));
        in_a_step2_ = V(Real(surface2 / 256));
        if constexpr (cells) {
            const double top = 1 + s.band, held = 1 + s.band / 2;
            const double rounding = compensated ? rounding_in_single : s.slop / (2 * s.surface);
            top2_ = V(Real(top * top));
            held2_ = V(Real(held * held));
            top_part_ = V(Real(top * top * (1 + rounding)));
            clear_part_ =
                V(Real(top * top * (1 + rounding) * (1 + (compensated ? rounding_in_single : 0x1p-44))));
        }
        inverse_surface2_ = V(Real(1 / surface2));
        half_inverse_surface_ = V(Real(0.5 / s.surface));
        inverse_dt_ = V(Real(1 / s.dt));
        restitution_ = V(Real(s.restitution));
        friction_ = V(Real(s.friction));
        bounces_ = s.restitution > 0;
        rough_ = s.friction > 0;
        each<3>([&](auto k) __attribute__((always_inline)) { momentum_[k] = V(Real(0)); });
    }

    // Responds in those lanes of `near` that are such points, and adds them to `responded`. Returns the other
    // lanes that have to be inspected. `radius2`: rho^2 of the points, for offset "cell". `mass`: of the
    // points.
    CLOTHSIM_INLINE std::uint64_t respond(const VectorGeometry& g, Real* state, const Real* before,
                                          const Mask& near, const Mask& moves,
                                          [[maybe_unused]] const V& radius2, const Real* mass,
                                          std::uint64_t& responded) {
        const V zero(Real(0)), one(Real(1));
        V p[3], q[3], pq, raised(zero);
        Decision decided;
        if constexpr (cells) {
            start_and_way(g, state, before, p, q);
            decided = decide_in_cells(p, q, radius2, pq, raised);
        } else {
            // In double down to here: their signs and sizes hang on digits that Real lacks.
            alignas(64) Real products[V::size];
            decided = decide(g, state, before, products);
            pq = V::load_aligned(products);
        }
        Mask touches = near & moves & lanes_of<V>(decided.touching);
        const std::uint64_t unresolved = near.mask() & ~(touches.mask() | decided.clear);
        if (xsimd::none(touches)) return unresolved;

        if constexpr (!cells) start_and_way(g, state, before, p, q);
        // 1 / |p|. Without cells |p| is the surface but for rounding, so that a Newton step is enough.
        V inverse;
        if constexpr (cells) inverse = scaled_reciprocal_root(inner(p, p)) * V(1 / root_scale<Real, Arch>());
        else inverse = half_inverse_surface_ * xsimd::fnma(inner(p, p), inverse_surface2_, V(Real(3)));
        const V normal_way = pq * inverse;
        V n[3], u[3];
        each<3>([&](auto k) __attribute__((always_inline)) {
            n[k] = p[k] * inverse;
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
        V lost = zero;  // part of the tangential motion that friction takes
        if (rough_) {
            V tangential[3];
            each<3>([&](auto k)
                        __attribute__((always_inline)) { tangential[k] = xsimd::fnma(speed, n[k], u[k]); });
            const V slip2 = inner(tangential, tangential), most = friction_ * (leaving - speed);
            const Mask slides = touches & (slip2 > most * most);
            lost = one;
            if (xsimd::any(slides)) lost = xsimd::select(slides, most / xsimd::sqrt(slip2), one);
        }
        // Without friction along the normal alone, at rest exactly back: a normal part far below q's rounding
        // counts.
        const V kept = one - lost, normal_gain = xsimd::fnma(kept, speed, leaving);
        V normal_change = kept * normal_way;
        if constexpr (cells)  // a radius that has grown moves points and gives no velocity
            normal_change = xsimd::fnma(raised * V(Real(0.5)), inverse, normal_change);
        each<3>([&](auto k) __attribute__((always_inline)) {
            add(g, state + k * g.component, xsimd::fnms(lost, q[k], normal_change * n[k]), touches);
            const V gain = xsimd::fnma(lost, u[k], normal_gain * n[k]);
            add(g, state + (k + 3) * g.component, gain, touches);
            momentum_[k] = xsimd::fma(load(mass), xsimd::select(touches, gain, zero), momentum_[k]);
        });
        gave_ = true;
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
    // Lanes of points on the sphere and pressed against it; of points outside that do not touch it in this
    // step.
    struct Decision {
        std::uint64_t touching, clear;
    };
    // From the centre to the points, and their way in the frame of the sphere.
    CLOTHSIM_INLINE void start_and_way(const VectorGeometry& g, const Real* state, const Real* before,
                                       V (&p)[3], V (&q)[3]) const {
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
    }
    // `raised`: how much further |p|^2 has to be where it lies in the lower half of the band.
    CLOTHSIM_INLINE Decision decide_in_cells(const V (&p)[3], const V (&q)[3], const V& radius2, V& pq,
                                             V& raised) const {
        constexpr double least = compensated ? 1 + rounding_in_single : 1;
        const V zero(Real(0)), start2 = inner(p, p), a = inner(q, q);
        const V least2 = surface2_ + xsimd::min(radius2 * V(Real(cell_rounding<Real>)), surface2_);
        pq = inner(p, q);
        raised = xsimd::select(start2 < least2 * held2_, least2 * top2_ - start2, zero);
        const auto outside = start2 >= least2 * V(Real(least)), inwards = pq < zero, brief = a < in_a_step2_;
        const auto touching = outside & (start2 <= least2 * top_part_) & inwards & brief;
        // Still approaching when the step ends, well outside.
        const auto falls_short = brief & (a + pq < zero) & (start2 + (pq + pq + a) > least2 * clear_part_);
        return {touching.mask(), (outside & (falls_short | !inwards)).mask()};
    }
    CLOTHSIM_INLINE Decision decide(const VectorGeometry& g, const Real* state, const Real* before,
                                    Real* pq) const {
        const D zero(0.0);
        Decision decided{0, 0};
        each<int(V::size) / Memory::N>([&](auto part) __attribute__((always_inline)) {
            constexpr int l = part * Memory::N;
            D p[3], q[3];
            each<3>([&](auto k) __attribute__((always_inline)) {
                const std::ptrdiff_t at = l + k * g.component;
                const D x0 = Memory::read(before + at, g.compensation);
                p[k] = x0 - wide_center_[k];
                q[k] = Memory::read(state + at, g.compensation) - x0 - wide_way_[k];
            });
            const D start2 = inner(p, p), b = inner(p, q), a = inner(q, q);
            Memory::store(pq + l, Memory::narrow(Memory::doubles(b)));
            const auto outside = start2 >= lowest2_, inwards = b < zero, brief = a < short2_;
            const auto touching = outside & (start2 <= highest2_) & inwards & brief;
            // Still approaching when the step ends, well outside.
            const auto falls_short = brief & (a + b < zero) & (start2 + (b + b + a) > clear2_);
            decided.touching |= std::uint64_t(touching.mask()) << l;
            decided.clear |= std::uint64_t((outside & (falls_short | !inwards)).mask()) << l;
        });
        return decided;
    }

    static CLOTHSIM_INLINE V load(const Real* p) { return V::load_unaligned(p); }
    template <class T>
    static CLOTHSIM_INLINE T inner(const T (&a)[3], const T (&b)[3]) {
        return xsimd::fma(a[2], b[2], xsimd::fma(a[1], b[1], a[0] * b[0]));
    }
    static CLOTHSIM_INLINE void add(const VectorGeometry& g, Real* place, const V& change,
                                    const Mask& chosen) {
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
    D wide_center_[3], wide_way_[3], lowest2_, highest2_, clear2_, short2_;
    V surface2_, in_a_step2_, top2_, held2_, top_part_, clear_part_, inverse_surface2_, half_inverse_surface_,
        inverse_dt_, restitution_, friction_;
    V momentum_[3];  // that this row has been given [N s]
    bool bounces_, rough_, gave_ = false;
};

}  // namespace
}  // namespace clothsim
