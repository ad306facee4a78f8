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

template <Arithmetic arithmetic, class V>
CLOTHSIM_INLINE V squared_distance(const Vector3<V>& a, const Vector3<V>& b) {
    const Vector3<V> d = b - a;
    return multiply_add<arithmetic>(d.z, d.z, multiply_add<arithmetic>(d.y, d.y, d.x * d.x));
}

// From the squared sides of a cell and its diagonals. Acute triangles count whose circle is larger than the
// one on the longest of all lines (CellBand::excess): those with w^2 > 2 excess s t. The largest w and the
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
        (excess > zero) & (excess * excess > V(Real(2 * CellBand::excess)) * (shortest * shortest));
    if (!xsimd::any(acute_cells)) return quarter;
    const V more = quarter * V(Real(1 + CellBand::excess));
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
CLOTHSIM_INLINE void cell_radii_of_row(const CellArguments<Real>& a, const Real* state, int row) {
    using V = Lanes<Real, Arch>;
    constexpr int W = int(V::size);
    const VectorGeometry& g = a.contact.geometry;
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
        xsimd::select(lanes_of<V>(a.cells[index]), radius2, V(Real(0)))
            .store_unaligned(a.cell_radii2 + index * W);
        p = q;
        below = q_below;
        left = right;
    }
}

// rho^2 of the wanted rows of cells in [begin, end).
template <class Arch, class Real, Arithmetic arithmetic>
void cell_radii(const CellArguments<Real>& a, const Real* state, int begin, int end) {
    for (int row = begin; row < end; ++row)
        if (a.wanted[row]) cell_radii_of_row<Arch, arithmetic>(a, state, row);
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

// Marks the points of a row that may touch a sphere in the step; whether there are such points. A vector is
// marked without inspection if all its points were near in the step before and some responded. A point that
// is marked and not near has no response.
template <class Arch, class Real>
CLOTHSIM_INLINE bool find_near(const CellArguments<Real>& a, SphereNear<Lanes<Real, Arch>, Real>& sphere,
                               int row) {
    using V = Lanes<Real, Arch>;
    const ContactArguments<Real>& c = a.contact;
    const VectorGeometry& g = c.geometry;
    constexpr std::uint64_t all = ~std::uint64_t(0) >> (64 - V::size);
    std::uint64_t* const near = a.near + std::ptrdiff_t(row) * g.vectors;
    std::uint64_t any = 0;
    for (int s = 0; s < c.sphere_count; ++s) {
        if (c.sphere_count > 1) sphere.prepare(c.spheres[s]);
        for (int vector = 0; vector < g.vectors; ++vector) {
            if (near[vector] == all && c.open[std::ptrdiff_t(row) * g.vectors + vector] == vector_responded) {
                any = all;
                continue;
            }
            const std::ptrdiff_t at = row * g.row + vector * g.vector;
            const std::uint64_t found =
                sphere.near(load3<V>(c.state + at, g.component), load3<V>(c.before + at, g.component)).mask();
            near[vector] = (s > 0 ? near[vector] : 0) | found;
            any |= found;
        }
    }
    for (int vector = 0; vector < g.vectors; ++vector) c.open[std::ptrdiff_t(row) * g.vectors + vector] = 0;
    return any != 0;
}

// The response of the near points of a row, as `contact_rows`. The row waits if rho of its cells is unknown.
template <class Arch, class Real, Arithmetic arithmetic>
class RespondRow {
    using V = Lanes<Real, Arch>;

public:
    CLOTHSIM_INLINE void prepare(const SweptSphere& s) {
        sphere_.prepare(s);
        if constexpr (arithmetic == Arithmetic::fused) resting_.prepare(s);
    }
    CLOTHSIM_INLINE void respond(const CellArguments<Real>& a, int row) {
        std::uint8_t& marks = a.marks[row];
        if (!a.only_waiting) marks = find_near<Arch>(a, sphere_, row) ? CellMarks::near : 0;
        if (a.only_waiting ? !(marks & CellMarks::waits) : !marks) return;
        marks = CellMarks::near;
        if (!a.known[row] || (row > 0 && !a.known[row - 1])) {
            marks |= CellMarks::waits;
            return;
        }
        for (int vector = 0; vector < a.contact.geometry.vectors; ++vector)
            if (a.near[std::ptrdiff_t(row) * a.contact.geometry.vectors + vector])
                marks |= respond_in_vector(a, row, vector);
        if constexpr (arithmetic == Arithmetic::fused)
            resting_.end_row(a.contact.impulses + row * a.contact.impulse_row);
    }

private:
    CLOTHSIM_INLINE std::uint8_t respond_in_vector(const CellArguments<Real>& a, int row, int vector) {
        constexpr int W = int(V::size);
        const ContactArguments<Real>& c = a.contact;
        const VectorGeometry& g = c.geometry;
        const std::ptrdiff_t index = std::ptrdiff_t(row) * g.vectors + vector;
        std::uint64_t unresolved = a.near[index], responded = 0, outside = 0;
        Real* const radii2 = a.point_radii2 + index * W;
        const V radius2 = point_radius2<Arch>(a, row, vector);
        radius2.store_unaligned(radii2);
        if (c.sphere_count == 1) {
            if constexpr (arithmetic == Arithmetic::fused) {
                const std::ptrdiff_t at = row * g.row + vector * g.vector;
                unresolved =
                    resting_.respond(g, c.state + at, c.before + at, lanes_of<V>(unresolved),
                                     lanes_of<V>(c.free[index]), radius2, c.mass + index * W, responded);
                outside = a.near[index] & ~unresolved;
            }
            if (unresolved)
                unresolved =
                    respond_vector<Arch, Real, W>(c, row, vector, unresolved, radii2, responded, outside);
        } else {
            unresolved &= nearer(a, row, vector, radius2);
        }
        a.raisable[index] = outside & c.free[index];
        c.open[index] =
            std::uint8_t((unresolved ? vector_unresolved : 0) | (responded ? vector_responded : 0));
        if (unresolved) c.unresolved(c.context, row, vector, unresolved);
        return std::uint8_t((responded ? CellMarks::responded : 0) |
                            (unresolved ? CellMarks::unresolved : 0));
    }

    // Points that may touch one of several spheres, with rho before the step.
    CLOTHSIM_INLINE std::uint64_t nearer(const CellArguments<Real>& a, int row, int vector,
                                         const V& radius2) {
        const ContactArguments<Real>& c = a.contact;
        const std::ptrdiff_t at = row * c.geometry.row + vector * c.geometry.vector;
        const auto x = load3<V>(c.state + at, c.geometry.component),
                   before = load3<V>(c.before + at, c.geometry.component);
        std::uint64_t near = 0;
        for (int s = 0; s < c.sphere_count; ++s) {
            sphere_.prepare(c.spheres[s]);
            near |= sphere_.near(x, before, sphere_.radius_of(c.spheres[s], radius2)).mask();
        }
        return near;
    }

    SphereNear<V, Real> sphere_;
    OnSphere<Arch, Real, true> resting_;
};

template <class Arch, class Real, Arithmetic arithmetic>
void cell_rows(const CellArguments<Real>& a, int begin, int end) {
    RespondRow<Arch, Real, arithmetic> points;
    points.prepare(a.contact.spheres[0]);
    for (int row = begin; row < end; ++row) points.respond(a, row);
}

// Moves the lanes of a vector of a row outwards on to the distance that `radii2` asks for, with their
// velocity.
template <class Arch, class Real>
__attribute__((noinline)) void raise_vector(const CellArguments<Real>& a, Real* state, const Real* radii2,
                                            std::uint64_t lanes) {
    using Memory = Wide<Arch, Real>;
    using D = typename Memory::D;
    const VectorGeometry& g = a.contact.geometry;
    const SweptSphere& s = a.contact.spheres[0];
    for (int l = 0; l < int(Lanes<Real, Arch>::size); l += Memory::N) {
        const auto chosen = lanes_of<D>(lanes >> l & ((std::uint64_t(1) << Memory::N) - 1));
        if (xsimd::none(chosen)) continue;
        const Surface<D> surface =
            cell_surface<Real>(s, Memory::batch(Memory::widen(Memory::load(radii2 + l))));
        D p[3];
        each<3>([&](auto k) __attribute__((always_inline)) {
            p[k] = Memory::read(state + l + k * g.component, g.compensation) - D(s.end[k]);
        });
        const D scale = surface.top / xsimd::sqrt(dot3(p, p));
        const D written = xsimd::select(chosen, D(1.0), D(0.0));
        each<3>([&](auto k) __attribute__((always_inline)) {
            Memory::write(state + l + k * g.component, g.compensation, D(s.end[k]) + p[k] * scale, written);
        });
    }
}

// Points that lie deeper than rho of the present cells allows move outwards and keep their velocity. Points
// that began inside have a speed of their own for that. The row is copied for the next step.
template <class Arch, class Real>
class RaiseRow {
    using V = Lanes<Real, Arch>;

public:
    CLOTHSIM_INLINE void prepare(const SweptSphere& s) {
        // In Real, with room for the rounding of squares.
        constexpr Real rounding = 8 * std::numeric_limits<Real>::epsilon();
        surface2_ = V(Real(s.surface * s.surface * (1 + rounding)));
        inflation_ = V(Real(cell_rounding<Real> + rounding));
        for (int k = 0; k < 3; ++k) {
            center_[k] = V(Real(s.end[k]));
            rest_[k] = V(Real(s.end[k] - double(Real(s.end[k]))));
        }
    }
    CLOTHSIM_INLINE void raise(const CellArguments<Real>& a, int row) const {
        const ContactArguments<Real>& c = a.contact;
        const VectorGeometry& g = c.geometry;
        std::uint8_t& marks = a.marks[row];
        marks &= std::uint8_t(~(CellMarks::raised | CellMarks::capped));
        for (int vector = 0; vector < g.vectors; ++vector) {
            const std::ptrdiff_t index = std::ptrdiff_t(row) * g.vectors + vector;
            const std::ptrdiff_t at = row * g.row + vector * g.vector;
            if (marks && a.near[index] && a.raisable[index] && inspect(a, row, vector, c.state + at))
                c.open[index] |= vector_responded;
            copy_vector<V>(c.state + at, c.before + at, g, c.bounces);
        }
    }

private:
    // Whether a point was moved.
    CLOTHSIM_INLINE bool inspect(const CellArguments<Real>& a, int row, int vector, Real* state) const {
        const VectorGeometry& g = a.contact.geometry;
        const std::uint64_t moves = a.raisable[std::ptrdiff_t(row) * g.vectors + vector];
        const V radius2 = point_radius2<Arch>(a, row, vector);
        V p[3];
        each<3>([&](auto k) __attribute__((always_inline)) {
            p[k] = V::load_unaligned(state + k * g.component) - center_[k];
            if constexpr (sizeof(Real) == 4)
                p[k] += V::load_unaligned(state + k * g.component + g.compensation) - rest_[k];
        });
        const V distance2 = p[0] * p[0] + p[1] * p[1] + p[2] * p[2];
        const V least2 = surface2_ + xsimd::min(radius2 * inflation_, surface2_);
        const auto large = radius2 > surface2_;
        if (__builtin_expect(xsimd::any(large), 0) &&
            ((large & (distance2 < least2 * V(Real(1 + 4 * cell_band<Real>)))).mask() & moves))
            a.marks[row] |= CellMarks::capped;
        const std::uint64_t low = (distance2 < least2).mask() & moves;
        if (__builtin_expect(low == 0, 1)) return false;
        alignas(64) Real radii2[V::size];
        radius2.store_aligned(radii2);
        raise_vector<Arch>(a, state, radii2, low);
        a.marks[row] |= CellMarks::raised;
        return true;
    }

    V surface2_, inflation_, center_[3], rest_[3];
};

// The wanted rows of cells and the rows of points beside them; in the first round all rows. No point of the
// cells of a row is moved before their rho is found.
template <class Arch, class Real, Arithmetic arithmetic>
void raise_rows(const CellArguments<Real>& a, int begin, int end) {
    RaiseRow<Arch, Real> points;
    points.prepare(a.contact.spheres[0]);
    for (int row = begin; row < end; ++row) {
        if (a.wanted[row] && !a.found) cell_radii_of_row<Arch, arithmetic>(a, a.contact.state, row);
        if (a.first_round || a.wanted[row] || (row > 0 && a.wanted[row - 1])) points.raise(a, row);
    }
}

// All rows in one pass: each responds, and the row before it is raised while both are in the cache. From the
// first row that waits on, rows respond alone. The first row that was not raised.
template <class Arch, class Real, Arithmetic arithmetic>
int stream_cells(const CellArguments<Real>& a) {
    RespondRow<Arch, Real, arithmetic> response;
    RaiseRow<Arch, Real> points;
    response.prepare(a.contact.spheres[0]);
    points.prepare(a.contact.spheres[0]);
    const int rows = a.contact.geometry.rows;
    int raised = 0;
    bool streams = true;
    for (int row = 0; row <= rows; ++row) {
        if (row < rows) {
            response.respond(a, row);
            streams = streams && !(a.marks[row] & CellMarks::waits);
        }
        if (row == 0 || !streams) continue;
        const bool near = (a.marks[row - 1] | (row < rows ? a.marks[row] : 0)) != 0;
        if (row < rows || a.below == 0) {
            if (near) cell_radii_of_row<Arch, arithmetic>(a, a.contact.state, row - 1);
            a.known[row - 1] = near;
        }
        points.raise(a, row - 1);
        raised = row;
    }
    return raised;
}

}  // namespace
}  // namespace clothsim
