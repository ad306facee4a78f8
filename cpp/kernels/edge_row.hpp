// The edge kernel: all springs of a row.
#pragma once

#include "kernels/edge_update.hpp"
#include "kernels/kernel_table.hpp"

namespace clothsim {
namespace {

// Ask for the share of a row ahead that belongs to a vector. In one go the requests would wait for each other, and the
// arithmetic with them.
template <class V, class Real>
CLOTHSIM_INLINE void fetch(const EdgeArguments<Real>& e, const Real* ahead, int k) {
    constexpr int line = 64 / int(sizeof(Real));
    const Real* const record = ahead + k * (StateRecord::count * int(V::size));
    for (std::ptrdiff_t i = e.ahead_begin; i < e.ahead_end; i += line) __builtin_prefetch(record + i, 0, 2);  // to the second-level cache
}

// Where a vector stands among those of its row: how many of its springs along the row lead past the last vector.
enum class Place { inner, second_last, last, any };

// All springs that start in a row (own), or only what they hand down to rows below (a halo row above a band). `fixed` is
// the number of vectors of a row, 0 if it is not known here. `ahead`: a row of which a share is fetched meanwhile.
template <class Arch, class Real, int index, Stage stage, int fixed, bool own, bool has_below, bool has_below_2>
CLOTHSIM_INLINE void edge_row(const EdgeArguments<Real>& e, const EdgeSources<Real>& source, const Real* __restrict received,
                              Real* __restrict hand_down, const PendingRow<Real>& pending, const Real* ahead = nullptr) {
    using V = Lanes<Real, Arch>;
    constexpr int W = int(V::size);
    constexpr Features features = Features::from_index(index);
    constexpr bool damped = features.spring_damping;
    constexpr bool vertical = features.structural && has_below;
    constexpr bool shear = features.shear && has_below;
    constexpr bool bend_down = features.bend && has_below_2;
    constexpr bool along = features.structural && own;
    constexpr bool along_2 = features.bend && own;
    const std::ptrdiff_t stride = source_stride<V>(stage == any_stage ? e.stage : stage);
    const int m = fixed ? fixed : e.vectors;
    const Real* const here = source.here;
    const Real* const below = source.below;
    const Real* const below_2 = source.below_2;
    Real* const __restrict received_2 = e.received_2;
    Real* const __restrict forces = e.force;
    const Real* const __restrict all_springs = e.coefficients;
    const auto points = [&](const Real* p) __attribute__((always_inline)) -> Points<V> {
        if constexpr (damped) return {load3<V>(p, W), load3<V>(p + 3 * W, W)};
        else return {load3<V>(p, W), {}};
    };
    // Behind the last vector stands the first, a lane on.
    const auto place_of = [&](int k) __attribute__((always_inline)) { return k < m ? k * stride : (k - m) * stride + 1; };

    const Vector3<V> none{V(Real(0)), V(Real(0)), V(Real(0))};
    Vector3<V> to_next = none, to_next_2 = none;  // handed on within the row
    Vector3<V> falling = none, rising = none;     // the half of a diagonal pair that the vector before has
    Vector3<V> kept[2];                           // forces to which the row's end adds, where `fixed` keeps them in registers
    const SpringConstants<V> constants{};

    // `cut`: coefficients of springs that some lanes lack. `first`: the row's first vector, which is handed nothing.
    const auto column = [&]<Place place, bool first>(int k, const Real* cut) __attribute__((always_inline)) {
        const std::ptrdiff_t at = k * stride;
        const std::ptrdiff_t next = place == Place::any ? place_of(k + 1) : place == Place::last ? 1 : at + stride;
        const std::ptrdiff_t next_2 = place == Place::any           ? place_of(k + 2)
                                      : place == Place::last        ? stride + 1
                                      : place == Place::second_last ? 1
                                                                    : at + 2 * stride;
        constexpr bool whole = place != Place::any;
        constexpr auto springs_to = [](bool inside) { return !whole ? Springs::by_coefficient : inside ? Springs::all : Springs::all_but_last; };
        constexpr Springs straight_down = springs_to(true), to_next_column = springs_to(place != Place::last);
        constexpr Springs to_next_2_columns = springs_to(place == Place::inner);
        const auto coefficients = [&](SpringKind kind) __attribute__((always_inline)) {
            return (whole ? all_springs : cut) + kind * (EdgeCoefficientIndex::count * W);
        };
        const std::ptrdiff_t vector = std::ptrdiff_t(k) * 3 * W;

        if constexpr (!fixed && own)
            if (ahead) fetch<V>(e, ahead, k);
        Vector3<V> handed = falling, pair = rising, behind = none;
        Spring<V> to_up, to_down, to_far, to_down_2, to_side, to_side_2;
        if constexpr (shear) to_up = stretch<damped>(points(here + next), below + at, constants);
        const Points<V> point = points(here + at);
        if constexpr (vertical) to_down = stretch<damped>(point, below + at, constants);
        if constexpr (shear) root(to_up, constants);
        if constexpr (shear) to_far = stretch<damped>(point, below + next, constants);
        if constexpr (vertical) root(to_down, constants);
        if constexpr (shear) {
            rising = force<damped, to_next_column>(to_up, coefficients(to_diagonal));
            handed = first ? rising : falling + rising;
        }
        if constexpr (bend_down) to_down_2 = stretch<damped>(point, below_2 + at, constants);
        if constexpr (shear) root(to_far, constants);
        if constexpr (vertical) {
            behind = force<damped, straight_down>(to_down, coefficients(to_below));
            const Vector3<V> straight = features.bend ? behind + load3<V>(received_2 + vector, W) : behind;
            handed = shear ? straight + handed : straight;
        } else if constexpr (has_below && features.bend) {
            const Vector3<V> straight = load3<V>(received_2 + vector, W);
            handed = shear ? straight + handed : straight;
        }
        if constexpr (has_below) store3(hand_down + vector, W, handed);
        if constexpr (along) to_side = stretch<damped>(point, here + next, constants);
        if constexpr (bend_down) root(to_down_2, constants);
        if constexpr (shear) {
            falling = force<damped, to_next_column>(to_far, coefficients(to_diagonal));
            pair = first ? falling : pair + falling;
        }
        if constexpr (along_2) to_side_2 = stretch<damped>(point, here + next_2, constants);
        if constexpr (along) root(to_side, constants);
        if constexpr (bend_down) {
            const Vector3<V> down_2 = force<damped, straight_down>(to_down_2, coefficients(to_below_2));
            store3(received_2 + vector, W, down_2);
            behind = vertical ? behind + down_2 : down_2;
        }
        if constexpr (own) {
            if constexpr (shear) behind = vertical || bend_down ? behind + pair : pair;
            Vector3<V> before = load3<V>(received + vector, W);
            if constexpr (vertical || shear || bend_down) before = before - behind;
            if (__builtin_expect(pending.there, 1)) finish<V, Real, stage, fixed>(e, pending, k);
            if constexpr (along_2) root(to_side_2, constants);
            Vector3<V> within = to_next, sum;  // what the row gives to the vector: of the first, what it takes
            to_next = to_next_2;
            if constexpr (along) {
                const Vector3<V> side = force<damped, to_next_column>(to_side, coefficients(to_right));
                within = first ? side : within - side;
                to_next = along_2 && !first ? to_next + side : side;
            }
            if constexpr (along_2) {
                to_next_2 = force<damped, to_next_2_columns>(to_side_2, coefficients(to_right_2));
                within = !first ? within - to_next_2 : along ? within + to_next_2 : to_next_2;
            }
            if constexpr (first) sum = along || along_2 ? before - within : before;
            else sum = within + before;
            if (fixed && k < 2) kept[k] = sum;
            else store3(forces + vector, W, sum);
        }
    };
    constexpr int class_size = spring_kind_count * EdgeCoefficientIndex::count * W;
    if constexpr (fixed > 0) {
        each<fixed - 2>(CLOTHSIM_EACH(k) { column.template operator()<Place::inner, k == 0>(k, nullptr); });
        column.template operator()<Place::second_last, fixed == 2>(fixed - 2, nullptr);
        column.template operator()<Place::last, false>(fixed - 1, nullptr);
    } else if (e.complete) {
        for (int k = 0; k < m - 2; ++k) column.template operator()<Place::inner, false>(k, nullptr);
        column.template operator()<Place::second_last, false>(m - 2, nullptr);
        column.template operator()<Place::last, false>(m - 1, nullptr);
    } else {
        for (int k = 0; k < m; ++k)
            column.template operator()<Place::any, false>(k, all_springs + e.coefficient_class[k] * class_size);
    }

    const std::ptrdiff_t past = std::ptrdiff_t(m) * 3 * W;
    if constexpr (shear) store3(hand_down + past, W, falling);
    if constexpr (own) {
        Vector3<V> past_last = to_next;
        if constexpr (features.shear) {
            const Vector3<V> before = load3<V>(received + past, W);
            past_last = (shear ? before - rising : before) + past_last;
        }
        // What is handed on past the last vector belongs to the first ones, a lane further.
        const auto sum = [&](int k) { return fixed ? kept[k] : load3<V>(forces + k * 3 * W, W); };
        store3(forces, W, sum(0) + shifted_lanes(past_last));
        if constexpr (along_2) store3(forces + 3 * W, W, sum(1) + shifted_lanes(to_next_2));
        else if constexpr (fixed > 0) store3(forces + 3 * W, W, kept[1]);
    }
}

}  // namespace
}  // namespace clothsim
