// The edge kernel: a vector of springs, from points to forces.
#pragma once

#include <array>

#include "kernels/edge/edge_arguments.hpp"
#include "kernels/vector3.hpp"

namespace clothsim {
namespace {

// Springs that start in a vector of points, and the spring that rises from the row below to the next vector.
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
static_assert(legs_needed() == leg_count,
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
struct Points {
    Vector3<V> x, v;
};

// A vector of springs on its way to a force, in the steps `stretch`, `root` and `force`, which wait for each
// other.
template <class V>
struct Spring {
    Vector3<V> d;  // difference of positions
    V rate;        // its product with the difference of velocities
    V root;        // squared length, then root_scale / length
};

// From points in registers to points in memory at `b`.
template <bool damped, class V, class Real>
CLOTHSIM_INLINE Spring<V> stretch(const Points<V>& a, const Real* b, const SpringConstants<V>& constants) {
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

// Which lanes have a spring, and how: all of them, some, or those whose coefficients are not 0. In the first
// two all families are damped alike or not at all: the damping constant is in the unit of acceleration.
enum class Springs { all, some, by_coefficient };

// On the points at b; an acceleration where all points have one mass.
template <bool damped, Springs springs, class V, class Real>
CLOTHSIM_INLINE Vector3<V> force(const Spring<V>& s, const Real* coefficients, SomeLanes<V> lanes = {}) {
    constexpr int W = int(V::size);
    const V stiffness = V::load_aligned(coefficients + EdgeCoefficientIndex::stiffness * W);
    const V tension = V::load_aligned(coefficients + EdgeCoefficientIndex::tension * W);
    V scale;
    if constexpr (damped) {
        scale = s.rate;
        if constexpr (springs == Springs::by_coefficient)
            scale = scale * V::load_aligned(coefficients + EdgeCoefficientIndex::damping * W);
        scale = xsimd::fms(scale, s.root, tension);
        scale = exact_at_rest<Real> ? scale * s.root + stiffness : xsimd::fma(scale, s.root, stiffness);
    } else {
        scale = exact_at_rest<Real> ? stiffness - s.root * tension : xsimd::fnma(s.root, tension, stiffness);
    }
    if constexpr (springs == Springs::some) scale = zero_elsewhere(lanes, scale);
    return {scale * s.d.x, scale * s.d.y, scale * s.d.z};
}

// The lanes of a row's vectors from which a spring leads one or two columns on: not of the last points, nor
// of padding. With `fixed` vectors they are looked up once.
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

// Whether a stage reads x_n and v_n in state records, or the result of the stage before in work records.
constexpr bool source_is_state(Stage stage) { return stage == Stage::first || stage == Stage::evaluate; }

// Elements from vector to vector of the rows that a stage reads.
template <class V>
CLOTHSIM_INLINE std::ptrdiff_t source_stride(Stage stage) {
    return (source_is_state(stage) ? StateRecord::count : WorkRecord::count) * int(V::size);
}

}  // namespace
}  // namespace clothsim
