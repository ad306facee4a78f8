// The edge kernel: a vector of springs, from points to forces; and from the forces on a row to the
// end of its Runge-Kutta stage.
#pragma once

#include <array>

#include "kernels/edge/edge_arguments.hpp"
#include "lanes/vector3.hpp"

namespace clothsim {
namespace {

// Springs that start in a vector of points, and the spring that rises from the row below to the
// next vector.
enum Leg : int {
    rising,
    down,
    falling,
    down_2,
    side,
    side_2,
    leg_count,
};
using Legs = unsigned;  // a set of them
inline constexpr std::array<SpringKind, leg_count> kind_of_leg{to_diagonal, to_below, to_diagonal,
                                                               to_below_2,  to_right, to_right_2};

constexpr int legs_needed() {
    int legs = 0;  // two of a diagonal kind
    for (const MirroredNeighbour& n : neighbours) legs += leads_on(n);
    return legs;
}
static_assert(
    legs_needed() == leg_count,
    "a spring without a leg here lacks a place in the sums of edge_row.hpp and edge_general.hpp");

template <class V>
CLOTHSIM_INLINE Vector3<V> shifted_lanes(const Vector3<V>& a) {
    return {next_lane(a.x), next_lane(a.y), next_lane(a.z)};
}

// Constants of every spring. The compiler would load a constant that it knows for each spring.
template <class V>
struct SpringConstants {
    V smallest = in_register(V(smallest_squared_length<typename V::value_type>));
    V newton = in_register(V(newton_constant<typename V::value_type>));
};

template <class V>
struct PointLanes {
    Vector3<V> x, v;
};

// A vector of springs on its way to a force, in the steps `stretch`, `root` and `force`, which wait
// for each other.
template <class V>
struct Spring {
    Vector3<V> d;  // difference of positions
    V rate;  // its product with the difference of velocities
    V root;  // squared length, then root_scale / length
};

// Stretches springs from points in registers to points in memory at `b`.
template <bool damped, class V, class Real>
CLOTHSIM_INLINE Spring<V> stretch(const PointLanes<V>& a, const Real* b,
                                  const SpringConstants<V>& constants) {
    constexpr int W = int(V::size);
    Spring<V> s;
    s.d = a.x - load3<V>(b, W);
    s.root = xsimd::fma(s.d.x, s.d.x, constants.smallest);
    s.root = xsimd::fma(s.d.y, s.d.y, s.root);
    s.root = xsimd::fma(s.d.z, s.d.z, s.root);
    if constexpr (damped) {
        const Vector3<V> w = a.v - load3<V>(b + 3 * W, W);
        s.rate = w.x * s.d.x;
        s.rate = xsimd::fma(w.y, s.d.y, s.rate);
        s.rate = xsimd::fma(w.z, s.d.z, s.rate);
    }
    return s;
}

template <class V>
CLOTHSIM_INLINE void root(Spring<V>& s, const SpringConstants<V>& constants) {
    s.root = scaled_reciprocal_root(s.root, constants.newton);
}

// Which lanes have a spring, and how: all of them, some, or those whose coefficients are not 0. In
// the first two all families are damped alike or not at all: the damping constant is in the unit of
// acceleration.
enum class SpringChoice { all, some, by_coefficient };

// Returns the force on the points at b, an acceleration where all points have one mass.
template <bool damped, SpringChoice choice, class V, class Real>
CLOTHSIM_INLINE Vector3<V> force(const Spring<V>& s, const Real* coefficients,
                                 SomeLanes<V> lanes = {}) {
    constexpr int W = int(V::size);
    const V stiffness = V::load_aligned(coefficients + EdgeCoefficientIndex::stiffness * W);
    const V tension = V::load_aligned(coefficients + EdgeCoefficientIndex::tension * W);
    V scale;
    if constexpr (damped) {
        scale = s.rate;
        if constexpr (choice == SpringChoice::by_coefficient)
            scale = scale * V::load_aligned(coefficients + EdgeCoefficientIndex::damping * W);
        scale = xsimd::fms(scale, s.root, tension);
        scale =
            exact_at_rest<Real> ? scale * s.root + stiffness : xsimd::fma(scale, s.root, stiffness);
    } else {
        scale = exact_at_rest<Real> ? stiffness - s.root * tension
                                    : xsimd::fnma(s.root, tension, stiffness);
    }
    if constexpr (choice == SpringChoice::some) scale = zero_elsewhere(lanes, scale);
    return {scale * s.d.x, scale * s.d.y, scale * s.d.z};
}

// The lanes of a row's vectors from which a spring leads one or two columns on: not of the last
// points, nor of padding. With `fixed` vectors they are looked up once.
template <class V, int fixed>
class Reach {
public:
    using Real = typename V::value_type;
    CLOTHSIM_INLINE explicit Reach(const Real* table) : table_(table) {
        for (int i = 0; i < 2 * fixed; ++i) known_[i] = some_lanes<V>(table_ + i * int(V::size));
    }
    CLOTHSIM_INLINE SomeLanes<V> operator()(int k, int columns) const {
        const int i = 2 * k + columns - 1;
        return fixed ? known_[i] : some_lanes<V>(table_ + i * int(V::size));
    }

private:
    const Real* table_;
    SomeLanes<V> known_[fixed ? 2 * fixed : 1];
};

// Returns whether a stage reads x_n and v_n in state records, or the result of the stage before in
// work records.
constexpr bool source_is_state(Stage stage) {
    return stage == Stage::first || stage == Stage::evaluate;
}

// Returns the elements from vector to vector of the rows that a stage reads.
template <class V>
CLOTHSIM_INLINE std::ptrdiff_t source_stride(Stage stage) {
    return (source_is_state(stage) ? StateRecord::count : WorkRecord::count) * int(V::size);
}

#define CLOTHSIM_EACH(i) [&](auto i) __attribute__((always_inline))

// The row before, whose forces are known: its stage is finished while the springs of the next row
// are summed.
template <class Real>
struct PendingRow {
    bool exists = false;
    Real* state;
    Real* work;
    const Real* source;
    const Real* inverse_mass;
    const Real* applied;
    const Real* free;
};

template <class Real>
CLOTHSIM_INLINE PendingRow<Real> row_to_finish(const EdgeArguments<Real>& e, int row,
                                               const Real* source) {
    const EdgeRowPointers<Real>& r = e.rows[row];
    return {true, r.state, r.work, source, r.inverse_mass, r.applied, r.free};
}

template <class Real>
CLOTHSIM_INLINE PendingRow<Real> pending_row(const EdgeArguments<Real>& e) {
    if (e.pending < 0) return {};
    return row_to_finish(e, e.pending, e.pending_source);
}

// Finishes the stage of one vector on which these forces act. `fixed`: the number of vectors of a
// row, 0 if not known here.
template <class V, class Real, Stage stage, int fixed>
CLOTHSIM_INLINE void finish_stage(const EdgeArguments<Real>& e, const PendingRow<Real>& row, int k,
                                  const Vector3<V>& force) {
    constexpr int W = int(V::size);
    constexpr bool compensated = sizeof(Real) == 4;
    const Real* const source = row.source + k * source_stride<V>(stage);
    Real* const state = row.state + k * (StateRecord::count * W);
    Real* const work = row.work + k * ((stage == Stage::evaluate ? 3 : WorkRecord::count) * W);
    const V step(stage == Stage::third ? e.h : e.half_h);
    const V step_a(stage == Stage::third ? e.h_a : e.half_h_a);
    const std::ptrdiff_t compensation = fixed ? fixed * StateRecord::count * W : e.compensation;
    const V h2_6(e.h2_6);
    const V h_6(e.h_6);
    V acceleration[3] = {force.x, force.y, force.z};
    if (__builtin_expect(e.drag != 0, 0))
        each<3>(CLOTHSIM_EACH(j) {
            acceleration[j] =
                xsimd::fnma(V(e.drag), V::load_aligned(source + (3 + j) * W), acceleration[j]);
        });
    if (__builtin_expect(row.inverse_mass != nullptr, 0)) {
        const V inverse_mass = V::load_aligned(row.inverse_mass + k * W);
        each<3>(CLOTHSIM_EACH(j) { acceleration[j] = acceleration[j] * inverse_mass; });
        if (row.applied)
            each<3>(CLOTHSIM_EACH(j) {
                acceleration[j] = acceleration[j] + V::load_aligned(row.applied + (3 * k + j) * W);
            });
    }
    each<3>(CLOTHSIM_EACH(j) { acceleration[j] = acceleration[j] + V(e.gravity[j]); });
    if (__builtin_expect(row.free != nullptr, 0)) {
        const V zero(Real(0));
        const auto free = V::load_aligned(row.free + k * W) != zero;
        each<3>(CLOTHSIM_EACH(j) { acceleration[j] = xsimd::select(free, acceleration[j], zero); });
    }
    each<3>(CLOTHSIM_EACH(j) {
        Real* const first = work + (WorkRecord::first + j) * W;
        Real* const sum = work + (WorkRecord::sum + j) * W;
        Real* const x = state + j * W;
        Real* const v = state + (3 + j) * W;
        const V a = acceleration[j];
        if constexpr (stage == Stage::evaluate) {
            (a * V(e.unit)).store_aligned(work + j * W);
        } else if constexpr (stage == Stage::fourth) {
            add_increment<compensated>(v, v + compensation, h_6 * (V::load_aligned(sum) + a));
        } else {
            const V v0 = V::load_aligned(v);
            const V vs = stage == Stage::first ? v0 : V::load_aligned(source + (3 + j) * W);
            xsimd::fma(step, vs, V::load_aligned(x)).store_aligned(work + j * W);
            xsimd::fma(step_a, a, v0).store_aligned(work + (3 + j) * W);
            if constexpr (stage == Stage::first) a.store_aligned(first);
            if constexpr (stage == Stage::second) a.store_aligned(sum);
            if constexpr (stage == Stage::third) {
                const V middle = V::load_aligned(sum) + a;
                const V three = V::load_aligned(first) + middle;
                (three + middle).store_aligned(sum);
                add_increment<compensated>(x, x + compensation, xsimd::fma(step, v0, h2_6 * three));
            }
        }
    });
}

template <class V, class Real, Stage stage, int fixed = 0>
CLOTHSIM_INLINE void finish_vector(const EdgeArguments<Real>& e, const PendingRow<Real>& row,
                                   int k) {
    finish_stage<V, Real, stage, fixed>(e, row, k,
                                        load3<V>(e.force + k * 3 * int(V::size), int(V::size)));
}
// Finishes a vector in the stage of `e`.
template <class V, class Real>
__attribute__((noinline)) void finish_any(const EdgeArguments<Real>& e, const PendingRow<Real>& row,
                                          int k) {
    switch (e.stage) {
        case Stage::first: return finish_vector<V, Real, Stage::first>(e, row, k);
        case Stage::second: return finish_vector<V, Real, Stage::second>(e, row, k);
        case Stage::third: return finish_vector<V, Real, Stage::third>(e, row, k);
        case Stage::fourth: return finish_vector<V, Real, Stage::fourth>(e, row, k);
        case Stage::evaluate: return finish_vector<V, Real, Stage::evaluate>(e, row, k);
    }
}

// Asks for the part of a row ahead that belongs to a vector. In one go the requests would wait for
// each other, and the arithmetic with them.
template <class V, class Real>
CLOTHSIM_INLINE void fetch(const EdgeArguments<Real>& e, const Real* ahead, int k) {
    constexpr int line = 64 / int(sizeof(Real));
    const Real* const record = ahead + k * (StateRecord::count * int(V::size));
    for (std::ptrdiff_t i = e.ahead_begin; i < e.ahead_end; i += line)
        __builtin_prefetch(record + i, 0, 2);  // to the second-level cache
}

template <class Real>
CLOTHSIM_INLINE const Real* row_ahead(const EdgeArguments<Real>& e, int row) {
    return e.ahead > 0 && row + e.ahead < e.row_count ? e.rows[row + e.ahead].state : nullptr;
}

// Finishes the stage of the row that is pending.
template <class Arch, class Real>
void edge_finish(EdgeArguments<Real>& e) {
    using V = Lanes<Real, Arch>;
    const PendingRow<Real> pending = pending_row(e);
    if (!pending.exists) return;
    for (int k = 0; k < e.vectors; ++k) finish_any<V, Real>(e, pending, k);
    e.pending = -1;
}

}  // namespace
}  // namespace clothsim
