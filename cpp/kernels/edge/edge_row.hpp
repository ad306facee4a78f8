// The edge kernel: all springs of a row.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <utility>

#include "kernels/edge/edge_update.hpp"
#include "kernels/kernel_table.hpp"

namespace clothsim {
namespace {

// Where a vector stands among those of its row: how many of its springs along the row lead past the last
// vector.
enum class Place { inner, second_last, last, any };

// A spring takes some sixty cycles from its first operation to the last, and each operation waits for the one
// before. So the springs of a vector form a pipeline. In each turn another spring begins. The spring that
// began `to_root` turns before takes its root, and the spring that began `to_force` turns before becomes a
// force. In one of the turns the row before is finished, in a later turn where shear springs are missing. The
// bits are the same for any pipeline; these were the fastest of some hundred.
struct Pipeline {
    std::array<Leg, leg_count> legs;
    int to_root, to_force, finishing_turn, finishing_turn_of_few;
};
template <class Real>
#if defined(__AVX512F__)
inline constexpr Pipeline pipeline{{down, rising, side, down_2, falling, side_2}, 1, 2, 2, 4};
#else
// An operation takes half the time, so more of them fit between two that wait for each other. Double needs
// most, as its springs wait for exact roots and divisions.
inline constexpr Pipeline pipeline =
    sizeof(Real) == 4 ? Pipeline{{falling, side_2, side, down_2, down, rising}, 2, 4, 1, 1}
                      : Pipeline{{rising, down, side, down_2, side_2, falling}, 2, 5, 5, 5};
#endif

// The pipeline without what a scene or a row lacks.
template <class Real, Legs present>
struct Turns {
    static constexpr Pipeline all = pipeline<Real>;
    static constexpr int legs = std::popcount(present), count = legs + all.to_force;
    static constexpr std::array<Leg, leg_count> order = [] {
        std::array<Leg, leg_count> order{};
        int next = 0;
        for (const Leg leg : all.legs)
            if (present >> leg & 1) order[std::size_t(next++)] = leg;
        return order;
    }();
    static constexpr int first_of_point = order[0] == rising ? 1 : 0;
    static constexpr bool shear = present >> falling & 1;
    static constexpr int finishing =
        std::min(shear ? all.finishing_turn : all.finishing_turn_of_few, count - 1);
    // The turn in which the last of these becomes a force; the first turn if there are none.
    static constexpr int after(Legs wanted) {
        int turn = 0;
        for (int i = 0; i < legs; ++i)
            if (wanted >> order[std::size_t(i)] & 1) turn = i + all.to_force;
        return turn;
    }
};

// A set of families with structural springs, for which the loop over rows is compiled in versions.
struct EdgeSet {
    bool shear, bend, damped;
};

// A row with two rows behind it, the last two rows of a cloth, and a row before a band. Of the last only
// springs to rows below count.
enum class Row {
    inner,
    second_last,
    last,
    halo,
};

// All springs that start in a row. `fixed` is the number of vectors of a row, 0 if it is not known here.
// `along`: springs from column to column are those of a whole row (all), or where `reach` has them (some).
// `ahead`: a row of which a share is fetched meanwhile.
template <class Arch, class Real, EdgeSet set, Stage stage, int fixed, Springs along, Row which = Row::inner>
CLOTHSIM_INLINE void edge_row(const EdgeArguments<Real>& e, const EdgeSources<Real>& source,
                              const Real* __restrict received, Real* __restrict sent_down,
                              const PendingRow<Real>& pending, const Reach<Lanes<Real, Arch>, fixed>& reach,
                              const Real* ahead = nullptr) {
    using V = Lanes<Real, Arch>;
    constexpr int W = int(V::size);
    constexpr bool own = which != Row::halo, has_below = which != Row::last,
                   has_below_2 = has_below && which != Row::second_last;
    constexpr bool damped = set.damped, shear = set.shear && has_below, bend_down = set.bend && has_below_2;
    constexpr bool bend_aside = set.bend && own;
    constexpr auto only = [](Leg leg, bool there) { return Legs(there) << leg; };
    constexpr Legs diagonals = only(rising, shear) | only(falling, shear),
                   downs = only(down, has_below) | only(down_2, bend_down);
    constexpr Legs sides = only(side, own) | only(side_2, bend_aside);
    using Order = Turns<Real, diagonals | downs | sides>;
    const std::ptrdiff_t stride = source_stride<V>(stage == any_stage ? e.stage : stage);
    const int m = fixed ? fixed : e.vectors;
    const Real* const here = source.here;
    const Real* const below = source.below;
    const Real* const below_2 = source.below_2;
    Real* const __restrict received_2 = e.received_2;
    Real* const __restrict forces = e.force;
    const auto points = [&](const Real* p) __attribute__((always_inline)) -> Points<V> {
        if constexpr (damped) return {load3<V>(p, W), load3<V>(p + 3 * W, W)};
        else return {load3<V>(p, W), {}};
    };
    // Behind the last vector stands the first, a lane on.
    const auto place_of = [&](int k) __attribute__((always_inline)) {
        return k < m ? k * stride : (k - m) * stride + 1;
    };

    const Vector3<V> none{V(Real(0)), V(Real(0)), V(Real(0))};
    Vector3<V> to_next = none, to_next_2 = none;  // handed on within the row
    Vector3<V> fell = none, rose = none;          // the diagonal forces of the vector before
    Vector3<V> kept[2];  // forces to which the row's end adds, where `fixed` keeps them in registers
    const SpringConstants<V> constants{};

    // `first`: the row's first vector, which is handed nothing.
    const auto column = [&]<Place place, bool first>(int k) __attribute__((always_inline)) {
        const std::ptrdiff_t at = k * stride;
        constexpr int follow = place == Place::inner ? 2
            : place == Place::second_last            ? 1
                                                     : 0;  // vectors, as far as is known
        const std::ptrdiff_t next = follow > 0 ? at + stride : place == Place::last ? 1 : place_of(k + 1);
        const std::ptrdiff_t next_2 = follow > 1 ? at + 2 * stride
            : place == Place::second_last        ? 1
            : place == Place::last               ? stride + 1
                                                 : place_of(k + 2);
        const std::ptrdiff_t vector = std::ptrdiff_t(k) * 3 * W;
        constexpr int kind_size = EdgeCoefficientIndex::count * W;
        if constexpr (!fixed && which == Row::inner)
            if (ahead) fetch<V>(e, ahead, k);

        Points<V> point;
        Spring<V> springs[leg_count];
        Vector3<V> f[leg_count];  // forces
        // `within` is the force of the row on the vector; for the first vector, the received force.
        Vector3<V> straight = none, diagonal, pair, behind, before, within;
        const auto take_turn = [&]<int turn>() __attribute__((always_inline)) {
            constexpr int of_root = turn - Order::all.to_root, of_force = turn - Order::all.to_force;
            if constexpr (turn < Order::legs) {
                constexpr Leg leg = Order::order[turn];
                const Real* const row = leg == side || leg == side_2 ? here : leg == down_2 ? below_2 : below;
                const std::ptrdiff_t other_end = leg == falling || leg == side ? next
                    : leg == side_2                                            ? next_2
                                                                               : at;
                if constexpr (leg == rising) {
                    springs[leg] = stretch<damped>(points(here + next), row + other_end, constants);
                } else {
                    if constexpr (turn == Order::first_of_point) point = points(here + at);
                    springs[leg] = stretch<damped>(point, row + other_end, constants);
                }
            }
            // Finishing any stage is a call, before which what is in registers would be stored.
            if constexpr (own && turn == (stage == any_stage ? 0 : Order::finishing))
                if (__builtin_expect(pending.there, 1)) finish<V, Real, stage, fixed>(e, pending, k);
            if constexpr (of_root >= 0 && of_root < Order::legs)
                root(springs[Order::order[of_root]], constants);
            if constexpr (of_force >= 0) {
                constexpr Leg leg = Order::order[of_force];
                constexpr SpringKind kind = kind_of_leg[leg];
                constexpr int columns = spring_kinds[kind].column;
                // The force between padding and padding is 0.
                constexpr bool all = columns == 0 || (columns <= follow && along == Springs::all);
                SomeLanes<V> lanes;
                if constexpr (!all) lanes = reach(k, columns);
                f[leg] = force<damped, all ? Springs::all : Springs::some>(
                    springs[leg], e.coefficients + kind * kind_size, lanes);
            }

            constexpr auto complete = [](Legs legs) { return turn == Order::after(legs); };
            if constexpr (has_below && complete(only(down, true))) {
                if constexpr (set.bend) straight = load3<V>(received_2 + vector, W);
                straight = set.bend ? f[down] + straight : f[down];
            }
            if constexpr (shear && complete(only(rising, true)))
                diagonal = first ? f[rising] : fell + f[rising];
            if constexpr (has_below && complete(only(rising, shear) | only(down, true)))
                store3(sent_down + vector, W, shear ? straight + diagonal : straight);
            if constexpr (shear && complete(diagonals)) {
                pair = first ? f[falling] : rose + f[falling];
                fell = f[falling];
                rose = f[rising];
            }
            if constexpr (bend_down && complete(downs)) store3(received_2 + vector, W, f[down_2]);
            if constexpr (own && has_below && complete(downs))
                behind = bend_down ? f[down] + f[down_2] : f[down];
            if constexpr (own && complete(downs | diagonals)) {
                before = load3<V>(received + vector, W);
                if constexpr (shear) behind = behind + pair;
                if constexpr (has_below) before = before - behind;
            }
            if constexpr (own && complete(only(side, true))) {
                within = first ? f[side] : to_next - f[side];
                to_next = bend_aside && !first ? to_next_2 + f[side] : f[side];
            }
            if constexpr (bend_aside && complete(sides)) {
                within = first ? within + f[side_2] : within - f[side_2];
                to_next_2 = f[side_2];
            }
        };
        [&]<int... turn>(std::integer_sequence<int, turn...>) __attribute__((always_inline)) {
            (take_turn.template operator()<turn>(), ...);
        }(std::make_integer_sequence<int, Order::count>{});
        if constexpr (own) {
            const Vector3<V> sum = first ? before - within : within + before;
            if (fixed && k < 2) kept[k] = sum;
            else store3(forces + vector, W, sum);
        }
    };
    if constexpr (fixed > 0) {
        each<fixed - 2>(CLOTHSIM_EACH(k) { column.template operator()<Place::inner, k == 0>(k); });
        column.template operator()<Place::second_last, fixed == 2>(fixed - 2);
        column.template operator()<Place::last, false>(fixed - 1);
    } else {
        // Where masks cost something, rows that need them at every vector are rare: one copy of the code is
        // enough.
        int k = 0;
        if constexpr (which == Row::inner && (along == Springs::all || masks_in_registers))
            for (; k < m - 2; ++k) column.template operator()<Place::inner, false>(k);
        if constexpr (along == Springs::all) {
            column.template operator()<Place::second_last, false>(k++);
            column.template operator()<Place::last, false>(k++);
        } else {
            for (; k < m; ++k) column.template operator()<Place::any, false>(k);
        }
    }

    const std::ptrdiff_t past = std::ptrdiff_t(m) * 3 * W;
    if constexpr (shear) store3(sent_down + past, W, fell);
    if constexpr (!own) return;
    Vector3<V> past_last = to_next;
    if constexpr (set.shear) {
        const Vector3<V> before = load3<V>(received + past, W);
        past_last = (shear ? before - rose : before) + past_last;
    }
    // Forces past the last vector belong to the first vectors, a lane further.
    const auto sum = [&](int k) { return fixed ? kept[k] : load3<V>(forces + k * 3 * W, W); };
    store3(forces, W, sum(0) + shifted_lanes(past_last));
    if constexpr (bend_aside) store3(forces + 3 * W, W, sum(1) + shifted_lanes(to_next_2));
    else if constexpr (fixed > 0) store3(forces + 3 * W, W, kept[1]);
}

}  // namespace
}  // namespace clothsim
