// Continuous contact, a vector of mass points at a time: which of them may touch a sphere within the step, and
// the answer to those that do (collision/continuous.hpp).
//
// A point at distance |m| after the step, having gone |q| in the sphere's frame, cannot have met it unless
// |m| <= R + |q|. That costs a root; (R + |q|)^2 <= (1 + k) R^2 + (1 + 1/k) q^2 for any k does not.
//
// The state of vectors that are far from every sphere is copied for the next step on the way.
#pragma once

#include "kernels/contact_arguments.hpp"
#include "kernels/vector3.hpp"

namespace clothsim {
namespace {

constexpr double near_margin = 1.0 / 64;

template <class V, class Real>
struct SphereNear {
    V center[3], way[3], radius2;

    CLOTHSIM_INLINE void prepare(const SweptSphere& s) {
        double size = 0;
        for (int k = 0; k < 3; ++k) {
            center[k] = V(Real(s.end[k]));
            way[k] = V(Real(s.end[k] - s.start[k]));
            size += s.end[k] < 0 ? -s.end[k] : s.end[k];
        }
        // What rounding to Real may take from the distance.
        const double rounding = 16 * (size + s.surface) * (sizeof(Real) == 4 ? 0x1p-23 : 0x1p-52);
        const double radius = s.surface + rounding;
        radius2 = V(Real((1 + near_margin) * radius * radius * (1 + 1e-6)));
    }
    CLOTHSIM_INLINE auto near(const Vector3<V>& x, const Vector3<V>& x0) const {
        const Vector3<V> m{x.x - center[0], x.y - center[1], x.z - center[2]};
        const Vector3<V> q{x.x - x0.x - way[0], x.y - x0.y - way[1], x.z - x0.z - way[2]};
        const V m2 = m.x * m.x + m.y * m.y + m.z * m.z;
        const V q2 = q.x * q.x + q.y * q.y + q.z * q.z;
        return m2 < radius2 + V(Real(1 + 1 / near_margin)) * q2;
    }
};

// One vector of points in double, answered lane by lane.
template <class Real, int W>
struct PointBlock {
    double x0[3][W], v0[3][W], x[3][W], v[3][W];
    int met[W];

    CLOTHSIM_INLINE void load(const Real* from, const VectorGeometry& g, double (&x)[3][W], double (&v)[3][W]) {
        for (int k = 0; k < 3; ++k) {
            const Real* const px = from + k * g.component;
            const Real* const pv = px + 3 * g.component;
            if constexpr (sizeof(Real) == 4) {
                const Real* const cx = px + g.compensation;
                const Real* const cv = pv + g.compensation;
                for (int l = 0; l < W; ++l) x[k][l] = double(px[l]) + double(cx[l]);
                for (int l = 0; l < W; ++l) v[k][l] = double(pv[l]) + double(cv[l]);
            } else {
                for (int l = 0; l < W; ++l) x[k][l] = px[l];
                for (int l = 0; l < W; ++l) v[k][l] = pv[l];
            }
        }
    }
    void meet_all(const SweptSphere& s, const double* free) {
        for (int l = 0; l < W; ++l) {
            const double a0[3] = {x0[0][l], x0[1][l], x0[2][l]}, b0[3] = {v0[0][l], v0[1][l], v0[2][l]};
            double a[3] = {x[0][l], x[1][l], x[2][l]}, b[3] = {v[0][l], v[1][l], v[2][l]};
            const Meeting meeting = meet(s, a0, b0, a, b);
            const bool moves = free[l] != 0;
            for (int k = 0; k < 3; ++k) x[k][l] = moves ? a[k] : x[k][l];
            for (int k = 0; k < 3; ++k) v[k][l] = moves ? b[k] : v[k][l];
            met[l] = int(meeting) + (moves ? 0 : 4);
        }
    }
    CLOTHSIM_INLINE void store(Real* to, const VectorGeometry& g, int lane) const {
        for (int k = 0; k < 3; ++k)
            for (int part = 0; part < 2; ++part) {
                const double value = part == 0 ? x[k][lane] : v[k][lane];
                Real* const place = to + (k + 3 * part) * g.component + lane;
                *place = Real(value);
                if constexpr (sizeof(Real) == 4) place[g.compensation] = Real(value - double(*place));
            }
    }
};

template <class V, class Real>
CLOTHSIM_INLINE void copy_vector(const Real* from, Real* to, const VectorGeometry& g) {
    each<6>([&](auto k) __attribute__((always_inline)) {
        V::load_unaligned(from + k * g.component).store_unaligned(to + k * g.component);
        if constexpr (sizeof(Real) == 4)
            V::load_unaligned(from + k * g.component + g.compensation)
                .store_unaligned(to + k * g.component + g.compensation);
    });
}

// Every lane of a vector that may touch the one sphere there is.
template <class Real, int W>
__attribute__((noinline)) void meet_vector(const ContactArguments<Real>& a, int row, int vector, std::uint64_t mask) {
    const VectorGeometry& g = a.geometry;
    const std::ptrdiff_t at = row * g.row + vector * g.vector;
    PointBlock<Real, W> block;
    block.load(a.before + at, g, block.x0, block.v0);
    block.load(a.state + at, g, block.x, block.v);
    block.meet_all(a.spheres[0], a.free + (std::ptrdiff_t(row) * g.vectors + vector) * W);
    std::uint64_t left_over = 0;
    for (; mask != 0; mask &= mask - 1) {
        const int lane = __builtin_ctzll(mask);
        const int met = block.met[lane];
        if (met == int(Meeting::answered)) block.store(a.state + at, g, lane);
        else if (met != int(Meeting::none) && met != 4) left_over |= std::uint64_t(1) << lane;
    }
    if (left_over) a.left_over(a.context, row, vector, left_over);
}

template <class Arch, class Real>
void contact_rows(const ContactArguments<Real>& a, int begin, int end) {
    using V = Lanes<Real, Arch>;
    constexpr int W = int(V::size);
    constexpr int most = 8;  // spheres looked at side by side
    const VectorGeometry& g = a.geometry;
    for (int first = 0; first < a.sphere_count; first += most) {
        const int count = a.sphere_count - first < most ? a.sphere_count - first : most;
        SphereNear<V, Real> spheres[most];
        for (int s = 0; s < count; ++s) spheres[s].prepare(a.spheres[first + s]);
        for (int row = begin; row < end; ++row)
            for (int vector = 0; vector < g.vectors; ++vector) {
                const std::ptrdiff_t at = row * g.row + vector * g.vector;
                const Vector3<V> x = load3<V>(a.state + at, g.component);
                const Vector3<V> x0 = load3<V>(a.before + at, g.component);
                auto near = spheres[0].near(x, x0);
                for (int s = 1; s < count; ++s) near = near | spheres[s].near(x, x0);
                std::uint8_t& flag = a.near[std::ptrdiff_t(row) * g.vectors + vector];
                const bool any = xsimd::any(near);
                flag = first == 0 ? any : flag | any;
                if (__builtin_expect(!flag && first + count == a.sphere_count, 1))
                    copy_vector<V>(a.state + at, a.before + at, g);
                if (!any) continue;
                if (a.sphere_count == 1) meet_vector<Real, W>(a, row, vector, near.mask());
                else a.left_over(a.context, row, vector, near.mask());
            }
    }
}

}  // namespace
}  // namespace clothsim
