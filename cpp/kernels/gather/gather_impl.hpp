// The gather kernel: one lane is one thread of the compute shader, one thread one mass point.
//
// A lane reads its neighbours in the order of `neighbours` (model/stencil.hpp). It sums the spring
// forces on its own point and finishes its own point's Runge-Kutta stage. Nothing is written for
// other lanes, so any number of threads gives the same bits.
//
//   force on i from the spring to j, d = x_j - x_i, w = v_j - v_i, l = |d|, L its rest length:
//   f = (K (l - L) / l + c (w.d) / l^2) d      (Kim et al., eq 1 with p_i - p_j; damping along d)
//
// Roots and divisions are exact and nothing is fused, so every instruction set and the shader give
// the same bits.
//
// Rows are padded with far, finite points. So a lane may read a neighbour that its point does not
// have, and takes no force from it. Neighbours of a family that the cloth lacks are skipped, and so
// are missing neighbours above or below. A bit per neighbour marks them, the same for a whole row,
// so that the processor predicts the branches.
#pragma once

#include "forces/penalty_lanes.hpp"
#include "kernels/kernel_table.hpp"
#include "lanes/vector3.hpp"

namespace clothsim {
namespace {

template <class V>
struct SpringLanes {
    V stiffness, rest, damping;
};

// Elements from a component to the ones after it.
struct PlaneOffsets {
    std::ptrdiff_t one, three, five;
    explicit CLOTHSIM_INLINE PlaneOffsets(std::ptrdiff_t plane)
        : one(plane), three(3 * plane), five(5 * plane) {
        // The compiler would make a pointer of each row and component, which are more than there
        // are registers.
        asm("" : "+r"(one), "+r"(three), "+r"(five));
    }
};

template <class V, class Real>
CLOTHSIM_INLINE Vector3<V> position(const Real* p, const PlaneOffsets& planes) {
    return {V::load_unaligned(p), V::load_unaligned(p + planes.one),
            V::load_unaligned(p + 2 * planes.one)};
}

template <class V, class Real>
CLOTHSIM_INLINE Vector3<V> velocity(const Real* p, const PlaneOffsets& planes) {
    return {V::load_unaligned(p + planes.three), V::load_unaligned(p + 4 * planes.one),
            V::load_unaligned(p + planes.five)};
}

// Adds the force of a spring. `all`: every point has this neighbour; otherwise those of the lanes
// whose bit is set in `there`.
template <bool damped, bool all, class V, class Real>
CLOTHSIM_INLINE void add_spring(Vector3<V>& force, const Vector3<V>& x, const Vector3<V>& v,
                                const Real* other, const PlaneOffsets& planes,
                                const SpringLanes<V>& spring, std::uint64_t there) {
    const Vector3<V> d = position<V>(other, planes) - x;
    // What the most operations wait for comes first. Coincident points: a spring without direction
    // gives no force instead of a NaN.
    const V l = xsimd::sqrt(xsimd::max(dot(d, d), V(smallest_squared_length<Real>)));
    const V r = V(Real(1)) / l;
    V damping_force;  // c (w.d)
    if constexpr (damped) damping_force = spring.damping * dot(velocity<V>(other, planes) - v, d);
    V scale = spring.stiffness * (l - spring.rest);
    if constexpr (damped) scale = damping_force * r + scale;
    scale = scale * r;
    if constexpr (!all) scale = xsimd::select(lanes_of<V>(there), scale, V(Real(0)));
    force = {scale * d.x + force.x, scale * d.y + force.y, scale * d.z + force.z};
}

// Returns a bit for each of `neighbours` that the points of a row may have.
CLOTHSIM_INLINE unsigned neighbours_of_row(const Features& features, int row, int rows) {
    unsigned present = 0;
    each<neighbour_count>([&](auto n) __attribute__((always_inline)) {
        constexpr MirroredNeighbour neighbour = neighbours[n];
        const bool there =
            features.has(neighbour) && row + neighbour.row >= 0 && row + neighbour.row < rows;
        present |= unsigned(there) << n;
    });
    return present;
}

template <bool damped, class V, class Real>
CLOTHSIM_INLINE void add_springs(Vector3<V>& force, const Vector3<V>& x, const Vector3<V>& v,
                                 const Real* point, const PlaneOffsets& planes,
                                 const SpringLanes<V> (&springs)[spring_kind_count],
                                 const LanesWithNeighbour& lanes, unsigned present,
                                 std::ptrdiff_t stride) {
    each<neighbour_count>([&](auto n) __attribute__((always_inline)) {
        constexpr MirroredNeighbour neighbour = neighbours[n];
        if (!(present >> n & 1)) return;
        constexpr bool all = neighbour.column == 0;
        const std::uint64_t there =
            all ? 0 : lanes.bits[LanesWithNeighbour::index(neighbour.column)];
        add_spring<damped, all>(force, x, v, point + neighbour.row * stride + neighbour.column,
                                planes, springs[neighbour.kind], there);
    });
}

template <class V, class Real>
CLOTHSIM_INLINE void finish_stage(const GatherArguments<Real>& g, std::ptrdiff_t point,
                                  const PlaneOffsets& planes, const V (&v_here)[3],
                                  const V (&a)[3]) {
    each<3>([&](auto k) __attribute__((always_inline)) {
        const std::ptrdiff_t at = point + k * planes.one;
        Real *const x = g.state + at, *const v = x + planes.three;
        Real *const first = g.first_acceleration + at, *const sum = g.acceleration_sum + at;
        if (g.stage == Stage::evaluate) return a[k].store_unaligned(first);
        if (g.stage == Stage::fourth) {
            constexpr bool compensated = sizeof(Real) == 4;
            const V one = V::load_unaligned(first);
            const V middle = V::load_unaligned(sum);
            const V dx = V(g.h) * V::load_unaligned(v) + V(g.h2_6) * (one + middle);
            const V dv = V(g.h_6) * ((one + a[k]) + (middle + middle));
            Real* const low = compensated ? g.compensation + at : nullptr;
            add_increment<compensated>(x, low, dx);
            add_increment<compensated>(v, compensated ? low + planes.three : nullptr, dv);
            return;
        }
        const bool whole = g.stage == Stage::third;
        const V step(whole ? g.h : g.half_h);
        const V step_a(whole ? g.h_a : g.half_h_a);
        (step * v_here[k] + V::load_unaligned(x)).store_unaligned(g.target + at);
        (step_a * a[k] + V::load_unaligned(v)).store_unaligned(g.target + at + planes.three);
        if (g.stage == Stage::first) a[k].store_unaligned(first);
        else (whole ? V::load_unaligned(sum) + a[k] : a[k]).store_unaligned(sum);
    });
}

template <bool flat, class V>
CLOTHSIM_INLINE Vector3<V> push_of(const PenaltyPlace<V>& at, V depth, const Vector3<V>& v,
                                   const PenaltyLanes<V>& constants, bool rough) {
    return rough ? penalty_force<flat, true>(at, depth, v, constants)
                 : penalty_force<flat, false>(at, depth, v, constants);
}

// Adds the forces of the obstacles on a vector of points. Sums go from point to point, so that they
// are the same for any number of lanes.
template <class V, class Real>
__attribute__((noinline)) void add_contacts(const GatherArguments<Real>& g, int row, int column,
                                            const Real* free, const Vector3<V>& x,
                                            const Vector3<V>& v, Vector3<V>& force) {
    constexpr int W = int(V::size);
    constexpr int lanes = group_size;
    const V zero(Real(0));
    for (int i = 0; i < g.contacts.count; ++i) {
        const PenaltyArguments<Real>& p = g.contacts.obstacles[i];
        double* const record = g.contacts.sums + row * g.contacts.row +
            column / group_size * ContactRecord::size(group_size) + p.number * g.contacts.obstacle;
        if (p.axis >= 0) {
            const V along = p.axis == 0 ? x.x : p.axis == 1 ? x.y : x.z;
            if (xsimd::none(V(p.side) * along < V(p.bound))) continue;
        }
        const PenaltyLanes<V> constants(p);
        const bool flat = p.curvature == 0;
        const PenaltyPlace<V> at =
            flat ? penalty_place<true>(x, constants) : penalty_place<false>(x, constants);
        const V depth =
            xsimd::select(V::load_unaligned(free) != zero, xsimd::max(at.depth, zero), zero);
        if (xsimd::none(depth > zero)) continue;
        const Vector3<V> f = flat ? push_of<true>(at, depth, v, constants, p.friction > 0)
                                  : push_of<false>(at, depth, v, constants, p.friction > 0);
        force = force + f;
        double* const sums = record + column % group_size;
        alignas(64) Real values[4][W];
        f.x.store_aligned(values[0]);
        f.y.store_aligned(values[1]);
        f.z.store_aligned(values[2]);
        depth.store_aligned(values[3]);
        for (int l = 0; l < W; ++l) {
            double work = 0;
            for (int j = 0; j < 3; ++j) {
                const double impulse = p.weight * double(values[j][l]);
                sums[j * lanes + l] += impulse;
                work += impulse * double(p.velocity[j]);
            }
            sums[ContactRecord::work * lanes + l] += work;
            double& deepest = sums[ContactRecord::depth * lanes + l];
            if (p.between_steps && double(values[3][l]) > deepest) deepest = double(values[3][l]);
        }
        double* const tail = record + ContactRecord::tail * lanes;
        tail[ContactRecord::touched] = 1;
        if (!p.between_steps ||
            (tail[ContactRecord::met] != 0 && tail[ContactRecord::first] <= p.time))
            continue;
        tail[ContactRecord::first] = p.time;
        tail[ContactRecord::met] = 1;
    }
}

template <class V, class Real, bool damped>
__attribute__((noinline)) void gather_rows(const GatherArguments<Real>& g, const Tile& tile) {
    const V zero(Real(0));
    const PlaneOffsets planes(g.plane);
    const std::ptrdiff_t stride = g.stride;
    SpringLanes<V> springs[spring_kind_count];
    each<spring_kind_count>([&](auto kind) __attribute__((always_inline)) {
        springs[kind] = {V(g.spring[kind].stiffness), V(g.spring[kind].rest),
                         V(g.spring[kind].damping)};
    });
    for (int row = tile.row_begin; row < tile.row_end; ++row) {
        const unsigned present = neighbours_of_row(g.features, row, g.rows);
        for (int column = tile.column_begin; column < tile.column_end; column += int(V::size)) {
            std::ptrdiff_t at = row * stride + column;
            // The compiler would keep a pointer of its own to each row and array, which are more
            // than there are registers.
            asm("" : "+r"(at));
            const Real* const point = g.source + at;
            const Vector3<V> x = position<V>(point, planes);
            const Vector3<V> v = velocity<V>(point, planes);
            Vector3<V> a{zero, zero, zero};
            add_springs<damped>(a, x, v, point, planes, springs, g.lanes[column / int(V::size)],
                                present, stride);
            if (g.contacts.count) add_contacts(g, row, column, g.free + at, x, v, a);
            if (__builtin_expect(g.drag != 0, 0)) {
                const V c(g.drag);
                a = {a.x - c * v.x, a.y - c * v.y, a.z - c * v.z};
            }
            if (__builtin_expect(g.inverse_mass != nullptr, 0)) {
                const V w = V::load_unaligned(g.inverse_mass + at);
                a = {a.x * w, a.y * w, a.z * w};
                if (g.applied) a = a + position<V>(g.applied + at, planes);
            }
            a = {a.x + V(g.gravity[0]), a.y + V(g.gravity[1]), a.z + V(g.gravity[2])};
            if (__builtin_expect(g.row_has_fixed[row], 0)) {
                const auto moves = V::load_unaligned(g.free + at) != zero;
                a = {xsimd::select(moves, a.x, zero), xsimd::select(moves, a.y, zero),
                     xsimd::select(moves, a.z, zero)};
            }
            finish_stage(g, at, planes, {v.x, v.y, v.z}, {a.x, a.y, a.z});
        }
    }
}

template <class Arch, class Real>
void gather_tile(const GatherArguments<Real>& g, const Tile& tile) {
    using V = Lanes<Real, Arch>;
    if (g.features.spring_damping) gather_rows<V, Real, true>(g, tile);
    else gather_rows<V, Real, false>(g, tile);
}

}  // namespace
}  // namespace clothsim
