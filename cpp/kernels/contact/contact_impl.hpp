// Continuous contact, a vector of mass points at a time. The pass finds the points that may touch a sphere
// within the step, and responds. The many points that lie on the sphere go to
// kernels/contact/contact_resting.hpp, the others to kernels/contact/continuous.hpp.
//
// A point at distance |m| after the step, having gone |q| in the sphere's frame, cannot have touched it
// unless |m| <= R + |q|. That costs a root; (R + |q|)^2 <= (1 + k) R^2 + (1 + 1/k) q^2 for any k does not.
//
// This check is in Real, and rounding never hides a point. A point that needs a response came to R or nearer,
// at a right angle to its way or at its end. So even m^2 <= R^2 + q^2 holds for it. Let m and q be wrong by
// up to d. R + 2 d for R covers both, since (1 + 1/k) (q - d)^2 >= q^2 - (1 + k) d^2. Each dropped or rounded
// quantity is a place or a way of at most |c1| + |c1 - c0| + R + |q|. The part of |q| is covered by the
// factor 1 + 1/k.
//
// The state of vectors that are done is copied for the next step on the way.
#pragma once

#include "kernels/contact/contact_arguments.hpp"
#include "kernels/contact/contact_resting.hpp"
#include "kernels/contact/contact_wide.hpp"
#include "kernels/vector3.hpp"

namespace clothsim {
namespace {

constexpr double near_margin = 1.0 / 64;  // 1/k: half passes more fast points, twice more near points

template <class V, class Real>
struct SphereNear {
    V center[3], way[3], radius2;

    CLOTHSIM_INLINE void prepare(const SweptSphere& s) {
        double size = s.reach;
        for (int k = 0; k < 3; ++k) {
            const double gone = s.end[k] - s.start[k];
            center[k] = V(Real(s.end[k]));
            way[k] = V(Real(gone));
            size += __builtin_fabs(s.end[k]) + __builtin_fabs(gone);
        }
        const double rounding = 16 * size * (sizeof(Real) == 4 ? 0x1p-23 : 0x1p-52);
        const double radius = s.reach + rounding;
        radius2 = V(Real((1 + near_margin) * radius * radius * (1 + 1e-6)));
    }
    // The squared radius for a point that keeps less than `reach`: with offset "cell", by its rho^2.
    CLOTHSIM_INLINE V radius_of(const SweptSphere& s, const V& rho2) const {
        if (!s.cells) return radius2;
        const V largest(Real(s.reach * s.reach)), own = V(Real(s.surface * s.surface)) + rho2;
        return xsimd::min(radius2, radius2 * (own * V(Real(1 + 1e-5)) / largest));
    }
    CLOTHSIM_INLINE auto near(const Vector3<V>& x, const Vector3<V>& x0) const {
        return near(x, x0, radius2);
    }
    CLOTHSIM_INLINE auto near(const Vector3<V>& x, const Vector3<V>& x0, const V& within2) const {
        const Vector3<V> m{x.x - center[0], x.y - center[1], x.z - center[2]};
        const Vector3<V> q{x.x - x0.x - way[0], x.y - x0.y - way[1], x.z - x0.z - way[2]};
        const V m2 = m.x * m.x + m.y * m.y + m.z * m.z;
        const V q2 = q.x * q.x + q.y * q.y + q.z * q.z;
        return m2 < within2 + V(Real(1 + 1 / near_margin)) * q2;
    }
};

template <class Arch>
struct Number<xsimd::batch<double, Arch>> {
    using D = xsimd::batch<double, Arch>;
    using Mask = xsimd::batch_bool<double, Arch>;
    static CLOTHSIM_LANE D select(const Mask& c, const D& a, const D& b) { return xsimd::select(c, a, b); }
    static CLOTHSIM_LANE D root(const D& a) { return xsimd::sqrt(a); }
    static CLOTHSIM_LANE bool any(const Mask& c) { return xsimd::any(c); }
};

template <class V, class Real>
CLOTHSIM_INLINE void copy_vector(const Real* from, Real* to, const VectorGeometry& g, bool velocities) {
    const auto copy = [&](auto k) __attribute__((always_inline)) {
        V::load_unaligned(from + k * g.component).store_unaligned(to + k * g.component);
        if constexpr (sizeof(Real) == 4)
            V::load_unaligned(from + k * g.component + g.compensation)
                .store_unaligned(to + k * g.component + g.compensation);
    };
    if (velocities) each<6>(copy);
    else each<3>(copy);
}

// Adds those `lanes` of a vector that touch the one sphere to `responded_lanes`, those that began outside to
// `outside_lanes`, and returns the remaining lanes. `radii2`: rho^2 of the points, null without cells.
// Momenta are added lane after lane, so that the strict class has the same bits for lanes of any width.
template <class Arch, class Real, int W>
__attribute__((noinline)) std::uint64_t respond_vector(const ContactArguments<Real>& a, int row, int vector,
                                                       std::uint64_t lanes, const Real* radii2,
                                                       std::uint64_t& responded_lanes,
                                                       std::uint64_t& outside_lanes) {
    using D = xsimd::batch<double, Arch>;
    using Memory = Wide<Arch, Real>;
    const VectorGeometry& g = a.geometry;
    const std::ptrdiff_t first = row * g.row + vector * g.vector;
    const std::ptrdiff_t index = std::ptrdiff_t(row) * g.vectors + vector;
    const std::uint64_t free = a.free[index];
    constexpr std::uint64_t part = (std::uint64_t(1) << Memory::N) - 1;
    std::uint64_t unresolved = 0;
    for (int l = 0; l < W; l += Memory::N) {
        if ((lanes >> l & part) == 0) continue;
        Real* const state = a.state + first + l;
        const Real* const before = a.before + first + l;
        D x0[3], v0[3], x[3], v[3];
        each<3>([&](auto k) __attribute__((always_inline)) {
            x0[k] = Memory::read(before + k * g.component, g.compensation);
            v0[k] = Memory::read(before + (k + 3) * g.component, g.compensation);
            x[k] = Memory::read(state + k * g.component, g.compensation);
            v[k] = Memory::read(state + (k + 3) * g.component, g.compensation);
        });
        const SweptSphere& s = a.spheres[0];
        const Surface<D> surface = radii2
            ? cell_surface<Real>(s, Memory::batch(Memory::widen(Memory::load(radii2 + l))))
            : surface_of<D>(s);
        const D free_end[3] = {v[0], v[1], v[2]};
        const VectorResponse<D> m = respond(s, surface, x0, v0, x, v);
        const auto asked = lanes_of<D>(lanes >> l & part), moves = lanes_of<D>(free >> l & part);
        outside_lanes |= std::uint64_t((asked & !m.inside).mask()) << l;
        unresolved |= std::uint64_t((asked & (m.in_the_air | (m.responded & !moves))).mask()) << l;
        const auto responded = asked & m.responded & moves;
        if (xsimd::none(responded)) continue;
        responded_lanes |= std::uint64_t(responded.mask()) << l;
        const D chosen = xsimd::select(responded, D(1.0), D(0.0));
        each<3>([&](auto k) __attribute__((always_inline)) {
            Memory::write(state + k * g.component, g.compensation, x[k], chosen);
            Memory::write(state + (k + 3) * g.component, g.compensation, v[k], chosen);
            const D mass = Memory::batch(Memory::widen(Memory::load(a.mass + index * W + l)));
            alignas(64) double momentum[Memory::N];
            xsimd::select(responded, mass * (v[k] - free_end[k]), D(0.0)).store_aligned(momentum);
            double& impulse = a.impulses[row * a.impulse_row + k];
            double sum = impulse;
            for (const double of_lane : momentum) sum -= of_lane;
            impulse = sum;
        });
    }
    return unresolved;
}

template <class Arch, class Real>
void inside_rows(const ContactArguments<Real>& a, const Real* center, Real radius2, int begin, int end) {
    using V = Lanes<Real, Arch>;
    const VectorGeometry& g = a.geometry;
    for (int row = begin; row < end; ++row)
        for (int vector = 0; vector < g.vectors; ++vector) {
            const Vector3<V> x = load3<V>(a.state + row * g.row + vector * g.vector, g.component);
            const Vector3<V> m{x.x - V(center[0]), x.y - V(center[1]), x.z - V(center[2])};
            const auto inside = m.x * m.x + m.y * m.y + m.z * m.z < V(radius2);
            if (__builtin_expect(xsimd::any(inside), 0)) a.unresolved(a.context, row, vector, inside.mask());
        }
}

template <class Arch, class Real, Arithmetic arithmetic>
void contact_rows(const ContactArguments<Real>& a, int begin, int end) {
    using V = Lanes<Real, Arch>;
    constexpr int W = int(V::size);
    constexpr int most = 8;  // spheres checked side by side
    const VectorGeometry& g = a.geometry;
    for (int first = 0; first < a.sphere_count; first += most) {
        const int count = a.sphere_count - first < most ? a.sphere_count - first : most;
        SphereNear<V, Real> spheres[most];
        for (int s = 0; s < count; ++s) spheres[s].prepare(a.spheres[first + s]);
        OnSphere<Arch, Real, false> resting;
        if constexpr (arithmetic == Arithmetic::fused) resting.prepare(a.spheres[0]);
        for (int row = begin; row < end; ++row) {
            for (int vector = 0; vector < g.vectors; ++vector) {
                const std::ptrdiff_t at = row * g.row + vector * g.vector;
                const Vector3<V> x = load3<V>(a.state + at, g.component);
                const Vector3<V> x0 = load3<V>(a.before + at, g.component);
                auto near = spheres[0].near(x, x0);
                for (int s = 1; s < count; ++s) near = near | spheres[s].near(x, x0);
                const std::ptrdiff_t index = std::ptrdiff_t(row) * g.vectors + vector;
                std::uint64_t unresolved = near.mask(), responded = 0, outside = 0;
                if (unresolved && a.sphere_count == 1) {
                    if constexpr (arithmetic == Arithmetic::fused)
                        unresolved = resting.respond(g, a.state + at, a.before + at, near,
                                                     lanes_of<Lanes<Real, Arch>>(a.free[index]), V(Real(0)),
                                                     a.mass + index * W, responded);
                    if (unresolved)
                        unresolved = respond_vector<Arch, Real, W>(a, row, vector, unresolved, nullptr,
                                                                   responded, outside);
                }
                if (unresolved) a.unresolved(a.context, row, vector, unresolved);
                std::uint8_t& open = a.open[index];
                open = std::uint8_t((unresolved ? vector_unresolved : 0) |
                                    (responded ? vector_responded : 0) | (first > 0 ? open : 0));
                if (__builtin_expect(!(open & vector_unresolved) && first + count == a.sphere_count, 1))
                    copy_vector<V>(a.state + at, a.before + at, g, a.bounces);
            }
            if constexpr (arithmetic == Arithmetic::fused) resting.end_row(a.impulses + row * a.impulse_row);
        }
    }
}

}  // namespace
}  // namespace clothsim
