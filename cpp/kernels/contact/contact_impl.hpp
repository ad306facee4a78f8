// The contact pass, a vector of mass points at a time: the points that may touch a sphere within
// the step, and the responses of the many that lie on it (kernels/contact/contact_resting.hpp). The
// others are left to contact/continuous.hpp.
//
// A point that needs a response came to the level `top` or below, at a right angle to its way or at
// its end. With q its way in the sphere's frame, it ends at a level of at most top + k q^2. That
// check is in Real, and rounding never hides a point: a way that is wrong by e counts 2 q^2 >= q'^2
// - 2 e^2. Rounding of a level grows with the distance from p0, which a slightly smaller curvature
// covers.
//
// Offset "cell": each mass point keeps sqrt(R^2 + rho^2) from a sphere of radius R.
//
//        o-----o-----o      rho^2 of a cell: the largest squared radius of the smallest circles
//        |  A  |  B  |      around its four triangles, two beside either diagonal. rho of the
//        o-----P-----o      point P: the largest of A, B, C and D. A triangle's corners keep then
//        |  C  |  D  |      sqrt(R^2 + r^2) or more, where r is the radius of its own circle, and
//        o-----o-----o      for a place q = sum(w p) of the triangle
//                               sum(w |p - c|^2) <= |q - c|^2 + r^2,    so that |q - c| >= R.
//
// A triangle with squared sides s, t and d, d the longest, has r^2 = d / 4 if s + t <= d. The
// circle with diameter d then holds it. Otherwise r^2 = d / (4 sin^2) = d / (4 - w^2 / (s t)) with
// w = s + t - d.
#pragma once

#include "kernels/contact/contact_resting.hpp"

namespace clothsim {
namespace {

// Points that may respond to a sphere.
template <class V, class Real>
struct SphereNear {
    V place[3], way[3], normal[3], curvature, way_factor, level, of_cells, most_of_cells;

    CLOTHSIM_INLINE void prepare(const SweptSphere& s) {
        for (int k = 0; k < 3; ++k) {
            place[k] = V(Real(s.end[k]));
            way[k] = V(Real(s.end[k] - s.start[k]));
            normal[k] = V(Real(s.normal[k]));
        }
        curvature = V(Real(s.near_curvature));
        way_factor = V(Real(2 * s.curvature));
        level = V(Real(s.near_level));
        of_cells = V(Real(s.curvature * cell_rounding<Real> * (1 + 1e-5)));
        most_of_cells = V(Real(s.cells ? s.most_of_cells : 0));
    }
    CLOTHSIM_INLINE auto near_at_end(const Vector3<V>& x) const { return level_at(x) < level; }
    CLOTHSIM_INLINE auto near(const Vector3<V>& x, const Vector3<V>& x0) const {
        return near(x, x0, most_of_cells);
    }
    CLOTHSIM_INLINE auto near_by_cells(const Vector3<V>& x, const Vector3<V>& x0,
                                       const V& radius2) const {
        return near(x, x0, xsimd::min(radius2 * of_cells, most_of_cells));
    }

private:
    CLOTHSIM_INLINE V level_at(const Vector3<V>& x) const {
        const V d[3] = {x.x - place[0], x.y - place[1], x.z - place[2]};
        V f(Real(0));
        each<3>([&](auto k) __attribute__((always_inline)) {
            f += d[k] * (normal[k] + normal[k] + curvature * d[k]);
        });
        return f;
    }
    CLOTHSIM_INLINE auto near(const Vector3<V>& x, const Vector3<V>& x0, const V& more) const {
        const V q[3] = {x.x - x0.x - way[0], x.y - x0.y - way[1], x.z - x0.z - way[2]};
        V q2(Real(0));
        each<3>([&](auto k) __attribute__((always_inline)) { q2 += q[k] * q[k]; });
        return level_at(x) < level + more + way_factor * q2;
    }
};

template <class V, class Real>
CLOTHSIM_INLINE void copy_vector(const Real* from, Real* to, const VectorGeometry& g,
                                 bool velocities) {
    const auto copy = [&](auto k) __attribute__((always_inline)) {
        V::load_unaligned(from + k * g.component).store_unaligned(to + k * g.component);
        if constexpr (sizeof(Real) == 4)
            V::load_unaligned(from + k * g.component + g.compensation)
                .store_unaligned(to + k * g.component + g.compensation);
    };
    if (velocities) each<6>(copy);
    else each<3>(copy);
}

template <Arithmetic arithmetic, class V>
CLOTHSIM_INLINE V squared_distance(const Vector3<V>& a, const Vector3<V>& b) {
    const Vector3<V> d = b - a;
    return multiply_add<arithmetic>(d.z, d.z, multiply_add<arithmetic>(d.y, d.y, d.x * d.x));
}

// From the squared sides of a cell and its diagonals. Acute triangles count whose circle is larger
// than the one on the longest of all lines (ContactBand::excess): those with w^2 > 2 excess s t.
// The largest w and the shortest side tell whether a cell can have one.
template <Arithmetic arithmetic, class V>
CLOTHSIM_INLINE V cell_radius2(const V& top, const V& right, const V& low, const V& left,
                               const V& falling, const V& rising) {
    using Real = typename V::value_type;
    const V zero(Real(0)), four(Real(4));
    const V longest = xsimd::max(xsimd::max(top, right), xsimd::max(low, left)),
            shortest = xsimd::min(xsimd::min(top, right), xsimd::min(low, left));
    const V quarter = xsimd::max(longest, xsimd::max(falling, rising)) * V(Real(0.25));
    const V excess = xsimd::max(xsimd::max(top + right, low + left) - falling,
                                xsimd::max(right + low, left + top) - rising);
    const auto acute_cells = (excess > zero) &
        (excess * excess > V(Real(2 * ContactBand::excess)) * (shortest * shortest));
    if (!xsimd::any(acute_cells)) return quarter;
    const V more = quarter * V(Real(1 + ContactBand::excess));
    V radius2 = quarter;
    const auto acute = [&](const V& s, const V& t, const V& e) __attribute__((always_inline)) {
        const V w = s + t - e, st = s * t, sine2 = multiply_add<arithmetic>(-w, w, four * st);
        if (!xsimd::any((w > zero) & (e * st > more * sine2))) return;
        const auto counts = (w > zero) & (s + e > t) & (t + e > s) & (e * st > more * sine2);
        const V circle = e * st / xsimd::select(counts, sine2, V(Real(1)));
        radius2 = xsimd::select(counts, xsimd::max(circle, radius2), radius2);
    };
    acute(top, right, falling);
    acute(low, left, falling);
    acute(right, low, rising);
    acute(left, top, rising);
    return radius2;
}

// rho^2 of the cells of a row.
template <class Arch, Arithmetic arithmetic, class Real>
CLOTHSIM_INLINE void cell_radii_of_row(const ContactArguments<Real>& a, const Real* state,
                                       int row) {
    using V = Lanes<Real, Arch>;
    constexpr int W = int(V::size);
    const VectorGeometry& g = a.geometry;
    const auto distance2 =
        [](const Vector3<V>& from, const Vector3<V>& to)
            __attribute__((always_inline)) { return squared_distance<arithmetic>(from, to); };
    Vector3<V> p, below;  // the left side of the cells
    V left(Real(0));
    for (int vector = 0; vector < g.vectors; ++vector) {
        const Real* const at = state + row * g.row + vector * g.vector;
        const Real* const next = at + (vector + 1 < g.vectors ? a.right : a.right_of_last);
        if (vector == 0 || !a.transposed) {
            p = load3<V>(at, g.component);
            below = load3<V>(at + a.below, g.component);
            left = distance2(p, below);
        }
        const Vector3<V> q = load3<V>(next, g.component),
                         q_below = load3<V>(next + a.below, g.component);
        const V right = distance2(q, q_below);
        const V radius2 =
            cell_radius2<arithmetic>(distance2(p, q), right, distance2(below, q_below), left,
                                     distance2(p, q_below), distance2(q, below));
        const std::ptrdiff_t index = std::ptrdiff_t(row) * g.vectors + vector;
        xsimd::select(lanes_of<V>(a.cell_lanes[index]), radius2, V(Real(0)))
            .store_unaligned(a.cell_radii2 + index * W);
        p = q;
        below = q_below;
        left = right;
    }
}

// rho^2 of the wanted rows of cells in [begin, end).
template <class Arch, class Real, Arithmetic arithmetic>
void cell_radii(const ContactArguments<Real>& a, const Real* state, int begin, int end) {
    for (int row = begin; row < end; ++row)
        if (a.wanted[row]) cell_radii_of_row<Arch, arithmetic>(a, state, row);
}

// rho^2 of the points of a vector.
template <class Arch, class Real>
CLOTHSIM_INLINE Lanes<Real, Arch> point_radius2(const ContactArguments<Real>& a, int row,
                                                int vector) {
    using V = Lanes<Real, Arch>;
    constexpr int W = int(V::size);
    const int vectors = a.geometry.vectors;
    const auto of_row = [&](int r) __attribute__((always_inline)) {
        const Real* const first = a.cell_radii2 + std::ptrdiff_t(r) * vectors * W;
        const V own = V::load_unaligned(first + vector * W);
        if (a.transposed && vector == 0)
            return xsimd::max(own, next_lane(V::load_unaligned(first + (vectors - 1) * W)));
        return xsimd::max(
            own, V::load_unaligned(first + (a.transposed ? (vector - 1) * W : vector * W - 1)));
    };
    return row > 0 ? xsimd::max(of_row(row), of_row(row - 1)) : of_row(row);
}

// Of the points of a vector, those that may touch another sphere, too.
template <class Real>
CLOTHSIM_INLINE std::uint64_t near_others(const ContactArguments<Real>& a, int sphere,
                                          std::ptrdiff_t index) {
    const std::ptrdiff_t vectors = std::ptrdiff_t(a.geometry.rows) * a.geometry.vectors;
    std::uint64_t near = 0;
    for (int s = 0; s < a.sphere_count; ++s)
        if (s != sphere) near |= a.near[s * vectors + index];
    return near;
}

// Marks the points that may touch a sphere. A vector is marked without inspection if all its points
// were near in the step before and some of the row responded. A point that is marked and not near
// has no response.
template <class Arch, class Real>
void find_rows(const ContactArguments<Real>& a, int begin, int end) {
    using V = Lanes<Real, Arch>;
    const VectorGeometry& g = a.geometry;
    constexpr std::uint64_t all = ~std::uint64_t(0) >> (64 - V::size);
    SphereNear<V, Real> sphere;
    for (int s = 0; s < a.sphere_count; ++s) {
        sphere.prepare(a.spheres[s]);
        for (int row = begin; row < end; ++row) {
            std::uint64_t* const near = a.near + (std::ptrdiff_t(s) * g.rows + row) * g.vectors;
            std::uint8_t& marks = a.marks[row];
            if (s == 0) marks &= ContactMarks::responded;
            const bool again = marks & ContactMarks::responded;
            std::uint64_t any = 0;
            for (int vector = 0; vector < g.vectors; ++vector) {
                const std::ptrdiff_t at = row * g.row + vector * g.vector;
                if (!a.before)
                    near[vector] = sphere.near_at_end(load3<V>(a.state + at, g.component)).mask();
                else if (!again || near[vector] != all)
                    near[vector] = sphere
                                       .near(load3<V>(a.state + at, g.component),
                                             load3<V>(a.before + at, g.component))
                                       .mask();
                any |= near[vector];
            }
            if (any) marks |= ContactMarks::near;
        }
    }
}

// The responses of the points of marked rows that lie on one sphere.
template <class Arch, class Real, Arithmetic arithmetic>
void respond_rows(const ContactArguments<Real>& a, int begin, int end) {
    using V = Lanes<Real, Arch>;
    constexpr int W = int(V::size);
    const VectorGeometry& g = a.geometry;
    SphereNear<V, Real> sphere;
    OnSphere<Arch, Real> resting;
    for (int s = 0; s < a.sphere_count; ++s) {
        sphere.prepare(a.spheres[s]);
        if constexpr (arithmetic == Arithmetic::fused) resting.prepare(a.spheres[s]);
        for (int row = begin; row < end; ++row) {
            std::uint8_t& marks = a.marks[row];
            if (s == 0) marks &= ContactMarks::near;
            for (int vector = 0; vector < g.vectors && marks; ++vector) {
                const std::ptrdiff_t index = std::ptrdiff_t(row) * g.vectors + vector,
                                     at = row * g.row + vector * g.vector;
                std::uint64_t near = a.near[std::ptrdiff_t(s) * g.rows * g.vectors + index];
                const std::uint64_t others = near_others(a, s, index);
                if (!(near | others)) continue;
                V radius2(Real(0)), press(Real(0));
                if (s == 0) a.unresolved[index] = a.inside[index] = 0;
                if (a.cells && s == 0) {
                    radius2 = point_radius2<Arch>(a, row, vector);
                    radius2.store_unaligned(a.point_radii2 + index * W);
                    press.store_unaligned(a.press + index * W);
                } else if (a.cells) {
                    radius2 = V::load_unaligned(a.point_radii2 + index * W);
                    press = V::load_unaligned(a.press + index * W);
                }
                if (a.cells && (a.sphere_count > 1 || arithmetic == Arithmetic::strict))
                    near &= sphere
                                .near_by_cells(load3<V>(a.state + at, g.component),
                                               load3<V>(a.before + at, g.component), radius2)
                                .mask();
                std::uint64_t unresolved = near;
                if constexpr (arithmetic == Arithmetic::fused) {
                    std::uint64_t responded = 0;
                    unresolved = near & others;
                    if (near & ~others)
                        unresolved |=
                            resting.respond(g, a.state + at, a.before + at,
                                            lanes_of<V>(near & ~others), lanes_of<V>(a.free[index]),
                                            radius2, a.mass + index * W, responded, press);
                    if (responded) marks |= ContactMarks::responded;
                    if (a.cells && responded) press.store_unaligned(a.press + index * W);
                }
                a.unresolved[index] |= unresolved;
                if (unresolved) marks |= ContactMarks::unresolved;
            }
            if constexpr (arithmetic == Arithmetic::fused)
                resting.end_row(a.impulses[s] + row * a.impulse_row);
        }
    }
}

// Points below what rho of the present cells asks for are lifted on to the top, and keep their
// velocity. Points that began inside have a speed of their own for that.
template <class Arch, class Real>
class LiftRow {
    using V = Lanes<Real, Arch>;
    static constexpr bool compensated = sizeof(Real) == 4;

public:
    CLOTHSIM_INLINE void prepare(const SweptSphere& s) {
        least_ = V(Real(s.least + s.tolerance / 4));
        band_ = V(Real(s.band - s.tolerance / 4));
        of_cells_ = V(Real(s.curvature * cell_rounding<Real>));
        most_of_cells_ = V(Real(s.most_of_cells));
        curvature_ = V(Real(s.curvature));
        for (int k = 0; k < 3; ++k) {
            place_[k] = V(Real(s.end[k]));
            rest_[k] = V(Real(s.end[k] - double(Real(s.end[k]))));
            normal_[k] = V(Real(s.normal[k]));
        }
    }
    // Whether some of the points near the sphere `alone` were lifted. Others of `near` are left.
    CLOTHSIM_INLINE bool lift(const ContactArguments<Real>& a, int row, int vector,
                              std::uint64_t alone, std::uint64_t near) const {
        constexpr int W = int(V::size);
        const V zero(Real(0)), one(Real(1));
        const VectorGeometry& g = a.geometry;
        const std::ptrdiff_t index = std::ptrdiff_t(row) * g.vectors + vector;
        Real* const state = a.state + row * g.row + vector * g.vector;
        const V radius2 = a.cells ? point_radius2<Arch>(a, row, vector) : zero;
        V m[3], f(zero);
        each<3>([&](auto k) __attribute__((always_inline)) {
            V d = V::load_unaligned(state + k * g.component) - place_[k];
            if constexpr (compensated)
                d += V::load_unaligned(state + k * g.component + g.compensation) - rest_[k];
            m[k] = normal_[k] + curvature_ * d;
            f += d * (normal_[k] + m[k]);
        });
        const V least = least_ + xsimd::min(radius2 * of_cells_, most_of_cells_);
        const std::uint64_t low = (f < least).mask() & near & a.free[index] & ~a.inside[index];
        if (__builtin_expect(low == 0, 1)) return false;
        a.unresolved[index] |= low & ~alone;
        if ((low & alone) == 0) return false;
        const auto lifted = lanes_of<V>(low & alone);
        const V top = least + band_, length2 = one + curvature_ * f;
        const V rise = xsimd::select(
            lifted, (top - f) / (length2 + xsimd::sqrt(length2 * (one + curvature_ * top))), zero);
        each<3>([&](auto k) __attribute__((always_inline)) {
            Real* const x = state + k * g.component;
            add_increment<compensated>(x, x + g.compensation, rise * m[k]);
        });
        const V work = V::load_unaligned(a.mass + index * W) *
            V::load_unaligned(a.press + index * W) * (rise * xsimd::sqrt(length2));
        alignas(64) Real lanes[W];
        xsimd::select(lifted, work, zero).store_aligned(lanes);
        // In this order for any width.
        for (const Real lane : lanes) a.lift_work[row] += double(lane);
        return true;
    }

private:
    V least_, band_, of_cells_, most_of_cells_, curvature_, place_[3], rest_[3], normal_[3];
};

// The wanted rows of cells and the rows of points beside them; in the first round all rows. No
// point of the cells of a row is moved before their rho is found. With one sphere the rows are
// copied for the next step.
template <class Arch, class Real, Arithmetic arithmetic>
void lift_rows(const ContactArguments<Real>& a, int begin, int end) {
    using V = Lanes<Real, Arch>;
    const VectorGeometry& g = a.geometry;
    constexpr bool fused = arithmetic == Arithmetic::fused;
    const bool inspects = a.cells || (fused && a.sphere_count > 1);
    LiftRow<Arch, Real> points;
    for (int s = 0; s < a.sphere_count; ++s) {
        points.prepare(a.spheres[s]);
        for (int row = begin; row < end; ++row) {
            if (!a.first_round && !a.wanted[row] && !(row > 0 && a.wanted[row - 1])) continue;
            std::uint8_t& marks = a.marks[row];
            if (s == 0) marks &= std::uint8_t(~ContactMarks::lifted);
            for (int vector = 0; vector < g.vectors; ++vector) {
                const std::ptrdiff_t index = std::ptrdiff_t(row) * g.vectors + vector,
                                     at = row * g.row + vector * g.vector;
                if (marks && inspects) {
                    const std::uint64_t near =
                                            a.near[std::ptrdiff_t(s) * g.rows * g.vectors + index],
                                        others = near_others(a, s, index);
                    if ((near | others) &&
                        points.lift(a, row, vector, fused ? near & ~others : 0, near | others))
                        marks |= ContactMarks::lifted | ContactMarks::responded;
                }
                if (fused && a.sphere_count == 1)
                    copy_vector<V>(a.state + at, a.before + at, g, a.bounces);
            }
        }
    }
}

}  // namespace
}  // namespace clothsim
