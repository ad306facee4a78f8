// The contact pass, a vector of mass points at a time: the points that may touch a sphere within the step,
// and their responses. The many that lie on the sphere go to kernels/contact/contact_resting.hpp, the others
// to kernels/contact/continuous.hpp.
//
// A point that needs a response came to the level `top` or below, at a right angle to its way or at its end.
// With q its way in the sphere's frame, it ends at a level of at most top + k q^2. That check is in Real, and
// rounding never hides a point: a way that is wrong by e counts 2 q^2 >= q'^2 - 2 e^2. Rounding of a level
// grows with the distance from p0, which a slightly smaller curvature covers.
//
// The state of vectors that are done is copied for the next step on the way.
//
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

#include "kernels/contact/contact_resting.hpp"

namespace clothsim {
namespace {

template <class Arch>
struct Number<xsimd::batch<double, Arch>> {
    using D = xsimd::batch<double, Arch>;
    using Mask = xsimd::batch_bool<double, Arch>;
    static CLOTHSIM_LANE D select(const Mask& c, const D& a, const D& b) { return xsimd::select(c, a, b); }
    static CLOTHSIM_LANE D root(const D& a) { return xsimd::sqrt(a); }
    static CLOTHSIM_LANE bool any(const Mask& c) { return xsimd::any(c); }
};

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
    CLOTHSIM_INLINE auto near_by_cells(const Vector3<V>& x, const Vector3<V>& x0, const V& radius2) const {
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

template <Arithmetic arithmetic, class V>
CLOTHSIM_INLINE V squared_distance(const Vector3<V>& a, const Vector3<V>& b) {
    const Vector3<V> d = b - a;
    return multiply_add<arithmetic>(d.z, d.z, multiply_add<arithmetic>(d.y, d.y, d.x * d.x));
}

// From the squared sides of a cell and its diagonals. Acute triangles count whose circle is larger than the
// one on the longest of all lines (ContactBand::excess): those with w^2 > 2 excess s t. The largest w and the
// shortest side tell whether a cell can have one.
template <Arithmetic arithmetic, class V>
CLOTHSIM_INLINE V cell_radius2(const V& top, const V& right, const V& low, const V& left, const V& falling,
                               const V& rising) {
    using Real = typename V::value_type;
    const V zero(Real(0)), four(Real(4));
    const V longest = xsimd::max(xsimd::max(top, right), xsimd::max(low, left)),
            shortest = xsimd::min(xsimd::min(top, right), xsimd::min(low, left));
    const V quarter = xsimd::max(longest, xsimd::max(falling, rising)) * V(Real(0.25));
    const V excess = xsimd::max(xsimd::max(top + right, low + left) - falling,
                                xsimd::max(right + low, left + top) - rising);
    const auto acute_cells =
        (excess > zero) & (excess * excess > V(Real(2 * ContactBand::excess)) * (shortest * shortest));
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
CLOTHSIM_INLINE void cell_radii_of_row(const ContactArguments<Real>& a, const Real* state, int row) {
    using V = Lanes<Real, Arch>;
    constexpr int W = int(V::size);
    const VectorGeometry& g = a.geometry;
    const auto distance2 = [](const Vector3<V>& from, const Vector3<V>& to) __attribute__((always_inline)) {
        return squared_distance<arithmetic>(from, to);
    };
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
        const Vector3<V> q = load3<V>(next, g.component), q_below = load3<V>(next + a.below, g.component);
        const V right = distance2(q, q_below);
        const V radius2 = cell_radius2<arithmetic>(distance2(p, q), right, distance2(below, q_below), left,
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
CLOTHSIM_INLINE Lanes<Real, Arch> point_radius2(const ContactArguments<Real>& a, int row, int vector) {
    using V = Lanes<Real, Arch>;
    constexpr int W = int(V::size);
    const int vectors = a.geometry.vectors;
    const auto of_row = [&](int r) __attribute__((always_inline)) {
        const Real* const first = a.cell_radii2 + std::ptrdiff_t(r) * vectors * W;
        const V own = V::load_unaligned(first + vector * W);
        if (a.transposed && vector == 0)
            return xsimd::max(own, next_lane(V::load_unaligned(first + (vectors - 1) * W)));
        return xsimd::max(own, V::load_unaligned(first + (a.transposed ? (vector - 1) * W : vector * W - 1)));
    };
    return row > 0 ? xsimd::max(of_row(row), of_row(row - 1)) : of_row(row);
}

// Lane after lane, so that the strict class has the same bits for lanes of any width.
template <class D>
CLOTHSIM_INLINE void add_lanes(double& to, const D& values) {
    alignas(64) double lanes[D::size];
    values.store_aligned(lanes);
    double sum = to;
    for (const double lane : lanes) sum += lane;
    to = sum;
}

// Adds those `lanes` of a vector that touch the one sphere to `responded_lanes`, those that began inside to
// a.inside, and returns the remaining lanes.
template <class Arch, class Real>
__attribute__((noinline)) std::uint64_t respond_vector(const ContactArguments<Real>& a, int row, int vector,
                                                       std::uint64_t lanes, std::uint64_t& responded_lanes) {
    using D = xsimd::batch<double, Arch>;
    using Memory = Wide<Arch, Real>;
    constexpr int W = int(Lanes<Real, Arch>::size);
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
        const auto of_lanes = [&](const Real* values) __attribute__((always_inline)) {
            return Memory::batch(Memory::widen(Memory::load(values + index * W + l)));
        };
        const Surface<D> surface = surface_of<Real>(s, s.cells ? of_lanes(a.point_radii2) : D(0.0));
        const D free_end[3] = {v[0], v[1], v[2]};
        const VectorResponse<D> r = respond(s, surface, x0, v0, x, v);
        const auto asked = lanes_of<D>(lanes >> l & part), moves = lanes_of<D>(free >> l & part);
        const auto inside = asked & r.inside;
        if (xsimd::any(inside)) {
            a.inside[index] |= std::uint64_t(inside.mask()) << l;
            const double lowest = xsimd::reduce_min(xsimd::select(inside & moves, r.height, D(0.0)));
            if (-lowest > a.sums[row].depth) a.sums[row].depth = -lowest;
        }
        unresolved |= std::uint64_t((asked & (r.in_the_air | (r.responded & !moves))).mask()) << l;
        const auto responded = asked & r.responded & moves;
        if (xsimd::none(responded)) continue;
        responded_lanes |= std::uint64_t(responded.mask()) << l;
        const D chosen = xsimd::select(responded, D(1.0), D(0.0));
        if (s.cells) Memory::write(a.press + index * W + l, r.press, chosen);
        each<3>([&](auto k) __attribute__((always_inline)) {
            Memory::write(state + k * g.component, g.compensation, x[k], chosen);
            Memory::write(state + (k + 3) * g.component, g.compensation, v[k], chosen);
            add_lanes(a.impulses[row * a.impulse_row + k],
                      xsimd::select(responded, of_lanes(a.mass) * (free_end[k] - v[k]), D(0.0)));
        });
    }
    return unresolved;
}

// Marks the points of a row that may touch a sphere; whether there are such points. A vector is marked
// without inspection if all its points were near in the step before and some of the row responded. A point
// that is marked and not near has no response.
template <class Arch, class Real>
CLOTHSIM_INLINE bool find_near(const ContactArguments<Real>& a, SphereNear<Lanes<Real, Arch>, Real>& sphere,
                               int row) {
    using V = Lanes<Real, Arch>;
    const VectorGeometry& g = a.geometry;
    constexpr std::uint64_t all = ~std::uint64_t(0) >> (64 - V::size);
    std::uint64_t* const near = a.near + std::ptrdiff_t(row) * g.vectors;
    const bool again = a.marks[row] & ContactMarks::responded;
    std::uint64_t any = 0;
    for (int s = 0; s < a.sphere_count; ++s) {
        if (a.sphere_count > 1) sphere.prepare(a.spheres[s]);
        for (int vector = 0; vector < g.vectors; ++vector) {
            if (!again || near[vector] != all) {
                const std::ptrdiff_t at = row * g.row + vector * g.vector;
                const std::uint64_t found =
                    sphere.near(load3<V>(a.state + at, g.component), load3<V>(a.before + at, g.component))
                        .mask();
                near[vector] = (s > 0 ? near[vector] : 0) | found;
            }
            any |= near[vector];
        }
    }
    return any != 0;
}

template <class Arch, class Real>
void find_rows(const ContactArguments<Real>& a, int begin, int end) {
    using V = Lanes<Real, Arch>;
    const VectorGeometry& g = a.geometry;
    SphereNear<V, Real> sphere;
    sphere.prepare(a.spheres[0]);
    for (int row = begin; row < end; ++row) {
        std::uint64_t any = 0;
        for (int vector = 0; vector < g.vectors; ++vector)
            any |= a.near[std::ptrdiff_t(row) * g.vectors + vector] =
                sphere.near_at_end(load3<V>(a.state + row * g.row + vector * g.vector, g.component)).mask();
        a.marks[row] = any ? ContactMarks::near : 0;
    }
}

// The response of the near points of a row. The row waits if rho of its cells is unknown.
template <class Arch, class Real, Arithmetic arithmetic>
class RespondRow {
    using V = Lanes<Real, Arch>;
    static constexpr int W = int(V::size);

public:
    CLOTHSIM_INLINE void prepare(const SweptSphere& s) {
        sphere_.prepare(s);
        if constexpr (arithmetic == Arithmetic::fused) resting_.prepare(s);
    }
    CLOTHSIM_INLINE void respond(const ContactArguments<Real>& a, int row) {
        const VectorGeometry& g = a.geometry;
        std::uint8_t& marks = a.marks[row];
        if (!a.only_waiting) marks = find_near<Arch>(a, sphere_, row) ? ContactMarks::near : 0;
        if (a.only_waiting ? (marks & ContactMarks::waits) != 0 : marks != 0) {
            marks = ContactMarks::near;
            if (a.cells && (!a.known[row] || (row > 0 && !a.known[row - 1]))) {
                marks |= ContactMarks::waits;
                return;
            }
            for (int vector = 0; vector < g.vectors; ++vector)
                if (a.near[std::ptrdiff_t(row) * g.vectors + vector]) marks |= respond_in(a, row, vector);
            if constexpr (arithmetic == Arithmetic::fused) resting_.end_row(a.impulses + row * a.impulse_row);
        }
        if (a.cells) return;  // `lift_rows` copies
        for (int vector = 0; vector < g.vectors; ++vector) {
            const std::ptrdiff_t at = row * g.row + vector * g.vector,
                                 index = std::ptrdiff_t(row) * g.vectors + vector;
            if (__builtin_expect(!marks || !((a.unresolved[index] | a.inside[index]) && a.near[index]), 1))
                copy_vector<V>(a.state + at, a.before + at, g, a.bounces);
        }
    }

private:
    CLOTHSIM_INLINE std::uint8_t respond_in(const ContactArguments<Real>& a, int row, int vector) {
        const VectorGeometry& g = a.geometry;
        const std::ptrdiff_t index = std::ptrdiff_t(row) * g.vectors + vector,
                             at = row * g.row + vector * g.vector;
        std::uint64_t unresolved = a.near[index], responded = 0;
        a.inside[index] = 0;
        V radius2(Real(0)), press(Real(0));
        if (a.cells) {
            radius2 = point_radius2<Arch>(a, row, vector);
            radius2.store_unaligned(a.point_radii2 + index * W);
            press.store_unaligned(a.press + index * W);
            if (a.sphere_count > 1 || arithmetic == Arithmetic::strict) unresolved &= nearer(a, at, radius2);
        }
        if (a.sphere_count == 1 && unresolved) {
            if constexpr (arithmetic == Arithmetic::fused) {
                unresolved = resting_.respond(g, a.state + at, a.before + at, lanes_of<V>(unresolved),
                                              lanes_of<V>(a.free[index]), radius2, a.mass + index * W,
                                              responded, press);
                if (a.cells) press.store_unaligned(a.press + index * W);
            }
            if (unresolved) unresolved = respond_vector<Arch>(a, row, vector, unresolved, responded);
        }
        a.unresolved[index] |= unresolved;
        return responded ? ContactMarks::responded : 0;
    }
    // Points that may touch one of the spheres, with rho before the step.
    CLOTHSIM_INLINE std::uint64_t nearer(const ContactArguments<Real>& a, std::ptrdiff_t at,
                                         const V& radius2) {
        const auto x = load3<V>(a.state + at, a.geometry.component),
                   before = load3<V>(a.before + at, a.geometry.component);
        std::uint64_t near = 0;
        for (int s = 0; s < a.sphere_count; ++s) {
            if (a.sphere_count > 1) sphere_.prepare(a.spheres[s]);
            near |= sphere_.near_by_cells(x, before, radius2).mask();
        }
        return near;
    }

    SphereNear<V, Real> sphere_;
    OnSphere<Arch, Real> resting_;
};

template <class Arch, class Real, Arithmetic arithmetic>
void respond_rows(const ContactArguments<Real>& a, int begin, int end) {
    RespondRow<Arch, Real, arithmetic> points;
    points.prepare(a.spheres[0]);
    for (int row = begin; row < end; ++row) points.respond(a, row);
}

// Lifts `lanes` of a vector on to the level that their cells ask for. They keep their velocity.
template <class Arch, class Real>
__attribute__((noinline)) void lift_vector(const ContactArguments<Real>& a, int row, int vector,
                                           const Real* radii2, std::uint64_t lanes) {
    using Memory = Wide<Arch, Real>;
    using D = typename Memory::D;
    constexpr int W = int(Lanes<Real, Arch>::size);
    const VectorGeometry& g = a.geometry;
    const SweptSphere& s = a.spheres[0];
    for (int l = 0; l < W; l += Memory::N) {
        const auto chosen = lanes_of<D>(lanes >> l & ((std::uint64_t(1) << Memory::N) - 1));
        if (xsimd::none(chosen)) continue;
        Real* const state = a.state + row * g.row + vector * g.vector + l;
        const std::ptrdiff_t own = (std::ptrdiff_t(row) * g.vectors + vector) * W + l;
        const auto of_lanes = [&](const Real* values) __attribute__((always_inline)) {
            return Memory::batch(Memory::widen(Memory::load(values)));
        };
        const Surface<D> surface = surface_of<Real>(s, of_lanes(radii2 + l));
        D d[3], m[3];
        each<3>([&](auto k) __attribute__((always_inline)) {
            d[k] = Memory::read(state + k * g.component, g.compensation) - D(s.end[k]);
        });
        const D raised = height_of(s, surface.top) - height_of(s, level(s, d, m));
        lift(s, d, surface.top, surface.top);
        const D written = xsimd::select(chosen, D(1.0), D(0.0));
        each<3>([&](auto k) __attribute__((always_inline)) {
            Memory::write(state + k * g.component, g.compensation, D(s.end[k]) + d[k], written);
        });
        add_lanes(a.sums[row].work, written * (of_lanes(a.mass + own) * (of_lanes(a.press + own) * raised)));
    }
}

// Points below what rho of the present cells asks for. Points that began inside have a speed of their own for
// that. The row is copied for the next step.
template <class Arch, class Real>
class LiftRow {
    using V = Lanes<Real, Arch>;

public:
    CLOTHSIM_INLINE void prepare(const SweptSphere& s) {
        least_ = V(Real(s.least + s.tolerance / 4));
        of_cells_ = V(Real(s.curvature * cell_rounding<Real>));
        most_of_cells_ = V(Real(s.most_of_cells));
        curvature_ = V(Real(s.curvature));
        for (int k = 0; k < 3; ++k) {
            place_[k] = V(Real(s.end[k]));
            rest_[k] = V(Real(s.end[k] - double(Real(s.end[k]))));
            normal_[k] = V(Real(s.normal[k]));
        }
    }
    CLOTHSIM_INLINE void lift(const ContactArguments<Real>& a, int row) const {
        const VectorGeometry& g = a.geometry;
        std::uint8_t& marks = a.marks[row];
        marks &= std::uint8_t(~ContactMarks::lifted);
        for (int vector = 0; vector < g.vectors; ++vector) {
            const std::ptrdiff_t index = std::ptrdiff_t(row) * g.vectors + vector,
                                 at = row * g.row + vector * g.vector;
            if (marks && a.near[index] &&
                inspect(a, row, vector, a.near[index] & a.free[index] & ~a.inside[index]))
                marks |= ContactMarks::lifted | ContactMarks::responded;
            copy_vector<V>(a.state + at, a.before + at, g, a.bounces);
        }
    }

private:
    // Whether a point was lifted.
    CLOTHSIM_INLINE bool inspect(const ContactArguments<Real>& a, int row, int vector,
                                 std::uint64_t moves) const {
        const VectorGeometry& g = a.geometry;
        const Real* const state = a.state + row * g.row + vector * g.vector;
        const V radius2 = point_radius2<Arch>(a, row, vector);
        V f(Real(0));
        each<3>([&](auto k) __attribute__((always_inline)) {
            V d = V::load_unaligned(state + k * g.component) - place_[k];
            if constexpr (sizeof(Real) == 4)
                d += V::load_unaligned(state + k * g.component + g.compensation) - rest_[k];
            f += d * (normal_[k] + normal_[k] + curvature_ * d);
        });
        const V least = least_ + xsimd::min(radius2 * of_cells_, most_of_cells_);
        const std::uint64_t low = (f < least).mask() & moves;
        if (__builtin_expect(low == 0, 1)) return false;
        alignas(64) Real radii2[V::size];
        radius2.store_aligned(radii2);
        lift_vector<Arch>(a, row, vector, radii2, low);
        return true;
    }

    V least_, of_cells_, most_of_cells_, curvature_, place_[3], rest_[3], normal_[3];
};

// The wanted rows of cells and the rows of points beside them; in the first round all rows. No point of the
// cells of a row is moved before their rho is found.
template <class Arch, class Real>
void lift_rows(const ContactArguments<Real>& a, int begin, int end) {
    LiftRow<Arch, Real> points;
    points.prepare(a.spheres[0]);
    for (int row = begin; row < end; ++row)
        if (a.first_round || a.wanted[row] || (row > 0 && a.wanted[row - 1])) points.lift(a, row);
}

}  // namespace
}  // namespace clothsim
