// Offset "cell": each mass point keeps sqrt(R^2 + rho^2) from a sphere of radius R.
//
//        o-----o-----o      rho^2 of a cell: the largest squared radius of the smallest circles around its
//        |  A  |  B  |      four triangles, two beside either diagonal. rho of the point P: the largest of A,
//        o-----P-----o      B, C and D. A triangle's corners keep then sqrt(R^2 + r^2) or more, where r is
//        the |  C  |  D  |      radius of its own circle, and for a place q = sum(w p) of the triangle
//        o-----o-----o          sum(w |p - c|^2) <= |q - c|^2 + r^2,    so that |q - c| >= R.
//
// A triangle with squared sides s, t and d, d the longest, has r^2 = d / 4 if s + t <= d. The circle with
// diameter d then holds it. Otherwise r^2 = d / (4 sin^2) = d / (4 - w^2 / (s t)) with w = s + t - d.
#pragma once

#include "kernels/contact/cell_arguments.hpp"
#include "kernels/contact/contact_impl.hpp"

namespace clothsim {
namespace {

template <class V>
CLOTHSIM_INLINE V squared_distance(const Vector3<V>& a, const Vector3<V>& b) {
    const Vector3<V> d = b - a;
    return d.x * d.x + d.y * d.y + d.z * d.z;
}

// The corners a, b of a cell, and c, d below them.
template <class V>
CLOTHSIM_INLINE V cell_radius2(const Vector3<V>& a, const Vector3<V>& b, const Vector3<V>& c,
                               const Vector3<V>& d) {
    using Real = typename V::value_type;
    const V top = squared_distance(a, b), right = squared_distance(b, d), low = squared_distance(d, c),
            left = squared_distance(c, a), falling = squared_distance(a, d), rising = squared_distance(b, c);
    const V zero(Real(0)), four(Real(4)), quarter(Real(0.25));
    V radius2 = quarter *
        xsimd::max(xsimd::max(xsimd::max(top, right), xsimd::max(low, left)), xsimd::max(falling, rising));
    // Acute triangles whose circle is larger than the one on the longest of all lines.
    const auto acute = [&](const V& s, const V& t, const V& e) __attribute__((always_inline)) {
        const V w = s + t - e, st = s * t;
        const auto counts = (w > zero) & (s + e > t) & (t + e > s) & (e * st > radius2 * (four * st - w * w));
        if (xsimd::any(counts)) {
            const V circle = e * st / xsimd::select(counts, four * st - w * w, V(Real(1)));
            radius2 = xsimd::select(counts, xsimd::max(circle, radius2), radius2);
        }
    };
    acute(top, right, falling);
    acute(low, left, falling);
    acute(right, low, rising);
    acute(left, top, rising);
    return radius2;
}

// rho^2 of the cells of the rows [begin, end).
template <class Arch, class Real>
void cell_radii(const CellArguments<Real>& a, const Real* state, int begin, int end) {
    using V = Lanes<Real, Arch>;
    constexpr int W = int(V::size);
    const VectorGeometry& g = a.contact.geometry;
    for (int row = begin; row < end; ++row)
        for (int vector = 0; vector < g.vectors; ++vector) {
            const Real* const p = state + row * g.row + vector * g.vector;
            const Real* const q = p + (vector + 1 < g.vectors ? a.right : a.right_of_last);
            const std::ptrdiff_t index = std::ptrdiff_t(row) * g.vectors + vector;
            const V radius2 =
                cell_radius2(load3<V>(p, g.component), load3<V>(q, g.component),
                             load3<V>(p + a.below, g.component), load3<V>(q + a.below, g.component));
            xsimd::select(lanes_of<V>(a.cells[index]), radius2, V(Real(0)))
                .store_unaligned(a.cell_radii2 + index * W);
        }
}

// rho^2 of the points of a vector.
template <class Arch, class Real>
CLOTHSIM_INLINE Lanes<Real, Arch> point_radius2(const CellArguments<Real>& a, int row, int vector) {
    using V = Lanes<Real, Arch>;
    constexpr int W = int(V::size);
    const int vectors = a.contact.geometry.vectors;
    const auto of_row = [&](int r) __attribute__((always_inline)) {
        const Real* const first = a.cell_radii2 + std::ptrdiff_t(r) * vectors * W;
        const V own = V::load_unaligned(first + vector * W);
        if (a.transposed && vector == 0)
            return xsimd::max(own, next_lane(V::load_unaligned(first + (vectors - 1) * W)));
        return xsimd::max(own, V::load_unaligned(first + (a.transposed ? (vector - 1) * W : vector * W - 1)));
    };
    return row > 0 ? xsimd::max(of_row(row), of_row(row - 1)) : of_row(row);
}

// Which points of the rows may touch a sphere in the step.
template <class Arch, class Real>
void near_points(const CellArguments<Real>& a, int begin, int end) {
    using V = Lanes<Real, Arch>;
    const ContactArguments<Real>& c = a.contact;
    const VectorGeometry& g = c.geometry;
    for (int row = begin; row < end; ++row) a.near_rows[row] = 0;
    for (int s = 0; s < c.sphere_count; ++s) {
        SphereNear<V, Real> sphere;
        sphere.prepare(c.spheres[s]);
        for (int row = begin; row < end; ++row)
            for (int vector = 0; vector < g.vectors; ++vector) {
                const std::ptrdiff_t at = row * g.row + vector * g.vector;
                const std::uint64_t near =
                    sphere.near(load3<V>(c.state + at, g.component), load3<V>(c.before + at, g.component))
                        .mask();
                std::uint64_t& all = a.near[std::ptrdiff_t(row) * g.vectors + vector];
                all = (s > 0 ? all : 0) | near;
                c.open[std::ptrdiff_t(row) * g.vectors + vector] = 0;
                a.near_rows[row] |= near != 0;
            }
    }
}

// The response of the near points of the rows, as `contact_rows`.
template <class Arch, class Real, Arithmetic arithmetic>
void cell_rows(const CellArguments<Real>& a, int begin, int end) {
    using V = Lanes<Real, Arch>;
    constexpr int W = int(V::size);
    const ContactArguments<Real>& c = a.contact;
    const VectorGeometry& g = c.geometry;
    OnSphere<Arch, Real, true> resting;
    if constexpr (arithmetic == Arithmetic::fused) resting.prepare(c.spheres[0]);
    for (int row = begin; row < end; ++row) {
        if (!a.near_rows[row]) continue;
        for (int vector = 0; vector < g.vectors; ++vector) {
            const std::ptrdiff_t index = std::ptrdiff_t(row) * g.vectors + vector;
            std::uint64_t unresolved = a.near[index], responded = 0;
            Real* const radii2 = a.point_radii2 + index * W;
            if (unresolved) point_radius2<Arch>(a, row, vector).store_unaligned(radii2);
            if (unresolved && c.sphere_count == 1) {
                if constexpr (arithmetic == Arithmetic::fused) {
                    const std::ptrdiff_t at = row * g.row + vector * g.vector;
                    unresolved =
                        resting.respond(g, c.state + at, c.before + at, lanes_of<V>(unresolved),
                                        lanes_of<V>(c.free[index]), radii2, c.mass + index * W, responded);
                }
                if (unresolved)
                    unresolved = respond_vector<Arch, Real, W>(c, row, vector, unresolved, radii2, responded);
            }
            if (unresolved) c.unresolved(c.context, row, vector, unresolved);
            c.open[index] =
                std::uint8_t((unresolved ? vector_unresolved : 0) | (responded ? vector_responded : 0));
        }
        if constexpr (arithmetic == Arithmetic::fused) resting.end_row(c.impulses + row * c.impulse_row);
    }
}

// Points of the rows may lie deeper than the largest of rho before the step and now. They are moved outwards
// and keep their velocity. Points that began inside have a speed of their own for that.
template <class Arch, class Real>
void raise_rows(const CellArguments<Real>& a, int begin, int end) {
    using V = Lanes<Real, Arch>;
    using Memory = Wide<Arch, Real>;
    using D = typename Memory::D;
    constexpr int W = int(V::size);
    const ContactArguments<Real>& c = a.contact;
    const VectorGeometry& g = c.geometry;
    const SweptSphere& s = c.spheres[0];
    // In Real, with room for the rounding of squares.
    const V surface2(Real(s.surface * s.surface * (1 + 8 * std::numeric_limits<Real>::epsilon()))),
        inflation(Real(cell_rounding<Real> + 8 * std::numeric_limits<Real>::epsilon()));
    V center[3], rest[3];
    for (int k = 0; k < 3; ++k) {
        center[k] = V(Real(s.end[k]));
        rest[k] = V(Real(s.end[k] - double(Real(s.end[k]))));
    }
    for (int row = begin; row < end; ++row) {
        a.raised_rows[row] = a.capped_rows[row] = 0;
        if (!a.near_rows[row]) continue;
        for (int vector = 0; vector < g.vectors; ++vector) {
            const std::ptrdiff_t index = std::ptrdiff_t(row) * g.vectors + vector;
            const std::uint64_t moves = a.near[index] & c.free[index];
            if (!moves) continue;
            Real* const state = c.state + row * g.row + vector * g.vector;
            const V radius2 = xsimd::max(V::load_unaligned(a.point_radii2 + index * W),
                                         point_radius2<Arch>(a, row, vector));
            V p[3];
            each<3>([&](auto k) __attribute__((always_inline)) {
                p[k] = V::load_unaligned(state + k * g.component) - center[k];
                if constexpr (sizeof(Real) == 4)
                    p[k] += V::load_unaligned(state + k * g.component + g.compensation) - rest[k];
            });
            const V least2 = surface2 + xsimd::min(radius2 * inflation, surface2);
            const V distance2 = p[0] * p[0] + p[1] * p[1] + p[2] * p[2];
            const auto capped =
                (radius2 > surface2) & (distance2 < least2 * V(Real(1 + 4 * cell_band<Real>)));
            a.capped_rows[row] |= (capped.mask() & moves) != 0;
            const auto low = (distance2 < least2) & lanes_of<V>(moves);
            if (xsimd::none(low)) continue;
            const std::uint64_t lanes = low.mask();
            alignas(64) Real radii2[W];
            radius2.store_aligned(radii2);
            for (int l = 0; l < W; l += Memory::N) {
                const auto wide = [&](const Real* from) __attribute__((always_inline)) {
                    return Memory::batch(Memory::widen(Memory::load(from + l)));
                };
                const Surface<D> began = cell_surface<Real>(s, wide(a.point_radii2 + index * W)),
                                 ends = cell_surface<Real>(s, wide(radii2));
                D start[3], end_[3];
                each<3>([&](auto k) __attribute__((always_inline)) {
                    start[k] =
                        Memory::read(c.before + (state - c.state) + l + k * g.component, g.compensation) -
                        D(s.start[k]);
                    end_[k] = Memory::read(state + l + k * g.component, g.compensation) - D(s.end[k]);
                });
                const auto chosen = lanes_of<D>(lanes >> l & ((std::uint64_t(1) << Memory::N) - 1)) &
                    (dot3(start, start) >= began.innermost * began.innermost);
                if (xsimd::none(chosen)) continue;
                const auto lifted = lift(end_, ends.held, ends.top) & chosen;
                if (xsimd::none(lifted)) continue;
                a.raised_rows[row] = 1;
                const D written = xsimd::select(lifted, D(1.0), D(0.0));
                each<3>([&](auto k) __attribute__((always_inline)) {
                    Memory::write(state + l + k * g.component, g.compensation, D(s.end[k]) + end_[k],
                                  written);
                });
                c.open[index] |= vector_responded;
            }
        }
    }
}

}  // namespace
}  // namespace clothsim
