// The edge kernel: every spring once, for speed.
//
// Layout ("lane-transposed"). With m vectors of W lanes a row, vector k, lane l holds column
// l m + k:
//
//     lane          0      1      2             the right-hand neighbour of a whole vector is the
//     vector 0    0      m     2m     ...       next vector, an aligned load without a shuffle;
//     vector 1    1     m+1   2m+1    ...       only behind the last vector stands vector 0 again,
//     ...                                       one lane further.
//
// A row is stored vector by vector, all components of vector 0, then all of vector 1: one stream of
// memory. The compensation is another, behind it.
//
// A sweep goes from row to row. A row adds the force of each of its springs to its own points and
// passes the opposite force on. Within the row it stays in registers. `received` holds forces for
// the next row, `received_2` for the row after it. Forces past the row's end belong to its first
// vectors, a lane further, and reach them last. A row's forces are complete at its end. Its
// Runge-Kutta stage is finished vector by vector while the next row's springs are summed, between
// operations that wait for each other. The row's old stage state is not needed any more: the new
// state replaces it.
//
// Sweeps may start anywhere and go up or down: the force on a point is summed as
//
//     within the row + ((vertical + 2nd vertical) + (diagonal + other diagonal) of the rows before
//                      -  the same of the rows behind)
//
// (forces past the row's end likewise, in a sum of their own). That gives the same bits either way,
// and `edge_halo` repeats the forces of the two rows before a band. So do any number of threads.
//
// Two loops do so. This one is compiled in versions for sets of families and stages, for cloths
// with structural and shear springs. The other, edge_general.hpp, serves all other cloths, rows at
// the borders, and instruction sets without versions.
//
// All springs of a row, in one pass over its vectors.
//
// Legs are the springs that start in a vector of mass points P. Their other ends lie in the vectors
// beside and below it:
//
//     row r      P ----side---- N ....side_2.... N2       N: the next vector, N2: the one after it
//                |  \        /
//               down  falling        rising leads from N down to the vector below P
//                |      \  /
//     row r+1    B       BN          BN: below N
//                |
//              down_2
//                |
//     row r+2    B2
//
// A leg adds its force to P and passes the opposite force on:
//
//     along the row   `to_next`, `to_next_2`: in registers, to the vectors one and two further
//     one row down    `straight` + `diagonal`: to `sent_down`, which the next row reads as
//                     `received`
//     two rows down   to `received_2`, which the next row adds to what it sends down
//
// For each vector the pass takes turns (Pipeline). A turn begins a leg, takes the root of an
// earlier leg, and ends a still earlier leg as a force. A sum is formed in the turn in which the
// last of its forces is known (Turns::after). After the last vector, what was passed beyond the
// row's end goes to its first vectors, a lane further.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <utility>

#include "kernels/edge/edge_stage.hpp"
#include "kernels/kernel_table.hpp"

namespace clothsim {
namespace {

// Where a vector stands in its row: from how many columns on springs lead past the last vector, or
// are missing in some lanes.
enum class Place { inner, second_last, last, any };

// A spring takes some sixty cycles from its first operation to the last, and each operation waits
// for the one before. So the springs of a vector form a pipeline. In each turn another spring
// begins. The spring that began `to_root` turns before takes its root, and the spring that began
// `to_force` turns before becomes a force. In one of the turns the row before is finished. The bits
// are the same for any pipeline; these were the fastest of some hundred.
struct Pipeline {
    std::array<Leg, leg_count> legs;
    int to_root, to_force, finishing_turn;
};
template <class Real>
#if defined(__AVX512F__)
inline constexpr Pipeline pipeline{{down, rising, side, down_2, falling, side_2}, 1, 2, 2};
#else
// An operation takes half the time, so more of them fit between two that wait for each other.
// Double needs most, as its springs wait for exact roots and divisions.
inline constexpr Pipeline pipeline =
    sizeof(Real) == 4 ? Pipeline{{falling, side_2, side, down_2, down, rising}, 2, 4, 1}
                      : Pipeline{{rising, down, side, down_2, side_2, falling}, 2, 5, 5};
#endif

// The pipeline without what a scene or a row lacks.
template <class Real, Legs present>
struct Turns {
    static constexpr Pipeline all = pipeline<Real>;
    static constexpr int legs = std::popcount(present);
    static constexpr int count = legs + all.to_force;
    static constexpr std::array<Leg, leg_count> order = [] {
        std::array<Leg, leg_count> order{};
        int next = 0;
        for (const Leg leg : all.legs)
            if (present >> leg & 1) order[std::size_t(next++)] = leg;
        return order;
    }();
    static constexpr int first_of_point = order[0] == rising ? 1 : 0;
    static constexpr int finishing = std::min(all.finishing_turn, count - 1);
    // Returns the turn in which the last of these becomes a force; the first turn if there are
    // none.
    static constexpr int turn_of_force(Legs wanted) {
        int turn = 0;
        for (int i = 0; i < legs; ++i)
            if (wanted >> order[std::size_t(i)] & 1) turn = i + all.to_force;
        return turn;
    }
};

// Features beside structural and shear springs, for which the loop over rows is compiled in
// versions.
struct EdgeSet {
    bool bend, damped;
};

// Sums all springs that start in a row with two more behind it. `fixed` is the number of vectors of
// a row, 0 if it is not known here.
template <class Arch, class Real, EdgeSet set, Stage stage, int fixed>
class RowPass {
    using V = Lanes<Real, Arch>;
    static constexpr int W = int(V::size);
    static constexpr bool damped = set.damped;
    static constexpr Legs diagonals = 1u << rising | 1u << falling,
                          downs = 1u << down | Legs(set.bend) << down_2,
                          sides = 1u << side | Legs(set.bend) << side_2;
    using Order = Turns<Real, diagonals | downs | sides>;

    const EdgeArguments<Real>& e_;
    const Real* __restrict received_;
    Real* __restrict sent_down_;
    Real* const __restrict received_2_;
    Real* const __restrict force_;
    const Real* const here_;
    const Real* const below_;
    const Real* const below_2_;
    const PendingRow<Real>& pending_;
    const Reach<V, fixed>& reach_;
    const Real* ahead_;  // a row of which a part is fetched meanwhile, or null
    const std::ptrdiff_t stride_;
    const int m_;
    const SpringConstants<V> constants_{};

    // Forces that pass from vector to vector within the row.
    Vector3<V> to_next_ = none();
    Vector3<V> to_next_2_ = none();
    Vector3<V> fell_ = none(), rose_ = none();  // the diagonal forces of the vector before
    // Forces to which the row's end adds, where `fixed` keeps them in registers.
    Vector3<V> kept_[2];

    // A vector of mass points on its way through the turns.
    struct Column {
        int k;
        std::ptrdiff_t at, next, next_2;  // places of the vector and of the two behind it
        std::ptrdiff_t vector;  // place of its forces
        PointLanes<V> point;
        Spring<V> springs[leg_count];
        Vector3<V> f[leg_count];  // forces
        // `within` is the force of the row on the vector; for the first vector, the received force.
        Vector3<V> straight = none(), diagonal, pair, behind, before, within;
    };

    static CLOTHSIM_INLINE Vector3<V> none() { return {V(Real(0)), V(Real(0)), V(Real(0))}; }
    static CLOTHSIM_INLINE PointLanes<V> points(const Real* p) {
        if constexpr (damped) return {load3<V>(p, W), load3<V>(p + 3 * W, W)};
        else return {load3<V>(p, W), {}};
    }
    // Returns how many vectors follow in the row, as far as is known.
    static constexpr int following(Place place) {
        if (place == Place::inner) return 2;
        return place == Place::second_last ? 1 : 0;
    }
    // Returns the place of vector k. Behind the last vector stands the first, a lane on.
    CLOTHSIM_INLINE std::ptrdiff_t place_of(int k) const {
        return k < m_ ? k * stride_ : (k - m_) * stride_ + 1;
    }
    // Returns the place of the vector so many behind vector k, which is at `at`.
    template <Place place, int count>
    CLOTHSIM_INLINE std::ptrdiff_t place_behind(int k, std::ptrdiff_t at) const {
        constexpr int past = count - following(place);  // the first vector is one past the last
        if constexpr (past <= 0) return at + count * stride_;
        else if constexpr (place == Place::any) return place_of(k + count);
        else return (past - 1) * stride_ + 1;
    }

    template <Leg leg>
    CLOTHSIM_INLINE void begin(Column& c, bool first_of_point) {
        const Real* const row = leg == side || leg == side_2 ? here_
            : leg == down_2                                  ? below_2_
                                                             : below_;
        const std::ptrdiff_t end = leg == falling || leg == side ? c.next
            : leg == side_2                                      ? c.next_2
                                                                 : c.at;
        if (first_of_point) c.point = points(here_ + c.at);
        if constexpr (leg == rising)
            c.springs[leg] = stretch<damped>(points(here_ + c.next), row + end, constants_);
        else c.springs[leg] = stretch<damped>(c.point, row + end, constants_);
    }

    template <Leg leg, Place place>
    CLOTHSIM_INLINE void end(Column& c) {
        constexpr SpringKind kind = kind_of_leg[leg];
        constexpr int columns = spring_kinds[kind].column;
        // The force between padding and padding is 0.
        constexpr bool all = columns <= following(place);
        SomeLanes<V> lanes;
        if constexpr (!all) lanes = reach_(c.k, columns);
        c.f[leg] = force<damped, all ? SpringChoice::all : SpringChoice::some>(
            c.springs[leg], e_.coefficients + kind * (EdgeCoefficientIndex::count * W), lanes);
    }

    // Adds up sums for the rows below that a turn completes.
    template <int turn, bool first>
    CLOTHSIM_INLINE void send_down(Column& c) {
        constexpr auto complete = [](Legs legs) { return turn == Order::turn_of_force(legs); };
        if constexpr (complete(1u << down)) {
            c.straight = c.f[down];
            if constexpr (set.bend) c.straight = c.straight + load3<V>(received_2_ + c.vector, W);
        }
        if constexpr (complete(1u << rising))
            c.diagonal = first ? c.f[rising] : fell_ + c.f[rising];
        if constexpr (complete(1u << rising | 1u << down))
            store3(sent_down_ + c.vector, W, c.straight + c.diagonal);
        if constexpr (complete(diagonals)) {
            c.pair = first ? c.f[falling] : rose_ + c.f[falling];
            fell_ = c.f[falling];
            rose_ = c.f[rising];
        }
        if constexpr (set.bend && complete(downs)) store3(received_2_ + c.vector, W, c.f[down_2]);
    }

    // Adds up sums for the points of the row that a turn completes.
    template <int turn, bool first>
    CLOTHSIM_INLINE void sum_own(Column& c) {
        constexpr auto complete = [](Legs legs) { return turn == Order::turn_of_force(legs); };
        if constexpr (complete(downs)) c.behind = set.bend ? c.f[down] + c.f[down_2] : c.f[down];
        if constexpr (complete(downs | diagonals))
            c.before = load3<V>(received_ + c.vector, W) - (c.behind + c.pair);
        if constexpr (complete(1u << side)) {
            c.within = first ? c.f[side] : to_next_ - c.f[side];
            to_next_ = set.bend && !first ? to_next_2_ + c.f[side] : c.f[side];
        }
        if constexpr (set.bend && complete(sides)) {
            c.within = first ? c.within + c.f[side_2] : c.within - c.f[side_2];
            to_next_2_ = c.f[side_2];
        }
    }

    template <int turn, Place place, bool first>
    CLOTHSIM_INLINE void take_turn(Column& c) {
        constexpr int of_root = turn - Order::all.to_root;
        constexpr int of_force = turn - Order::all.to_force;
        if constexpr (turn < Order::legs)
            begin<Order::order[turn]>(c, turn == Order::first_of_point);
        if constexpr (turn == Order::finishing)
            if (__builtin_expect(pending_.exists, 1))
                finish_vector<V, Real, stage, fixed>(e_, pending_, c.k);
        if constexpr (of_root >= 0 && of_root < Order::legs)
            root(c.springs[Order::order[of_root]], constants_);
        if constexpr (of_force >= 0) end<Order::order[of_force], place>(c);
        send_down<turn, first>(c);
        sum_own<turn, first>(c);
    }

    // `first`: the vector is the row's first, to which nothing is passed.
    template <Place place, bool first>
    CLOTHSIM_INLINE void column(int k) {
        if constexpr (!fixed)
            if (ahead_) fetch<V>(e_, ahead_, k);
        Column c;
        c.k = k;
        c.at = k * stride_;
        c.next = place_behind<place, 1>(k, c.at);
        c.next_2 = place_behind<place, 2>(k, c.at);
        c.vector = std::ptrdiff_t(k) * 3 * W;
        [&]<int... turn>(std::integer_sequence<int, turn...>) __attribute__((always_inline)) {
            (take_turn<turn, place, first>(c), ...);
        }(std::make_integer_sequence<int, Order::count>{});
        const Vector3<V> sum = first ? c.before - c.within : c.within + c.before;
        if (fixed && k < 2) kept_[k] = sum;
        else store3(force_ + c.vector, W, sum);
    }

    CLOTHSIM_INLINE void all_columns() {
        if constexpr (fixed > 0) {
            each<fixed - 2>(CLOTHSIM_EACH(k) { column<Place::inner, k == 0>(k); });
            column<Place::second_last, fixed == 2>(fixed - 2);
            column<Place::last, false>(fixed - 1);
        } else {
            int k = 0;
            for (; k < e_.whole_vectors; ++k) column<Place::inner, false>(k);
            for (; k < m_; ++k) column<Place::any, false>(k);
        }
    }

    // Forces past the last vector belong to the first vectors, a lane further.
    CLOTHSIM_INLINE void pass_beyond_end() {
        const std::ptrdiff_t past = std::ptrdiff_t(m_) * 3 * W;
        store3(sent_down_ + past, W, fell_);
        const Vector3<V> past_last = (load3<V>(received_ + past, W) - rose_) + to_next_;
        const auto sum = [&](int k) { return fixed ? kept_[k] : load3<V>(force_ + k * 3 * W, W); };
        store3(force_, W, sum(0) + shifted_lanes(past_last));
        if constexpr (set.bend) store3(force_ + 3 * W, W, sum(1) + shifted_lanes(to_next_2_));
        else if constexpr (fixed > 0) store3(force_ + 3 * W, W, kept_[1]);
    }

public:
    CLOTHSIM_INLINE RowPass(const EdgeArguments<Real>& e, const EdgeSources<Real>& source,
                            const Real* received, Real* sent_down, const PendingRow<Real>& pending,
                            const Reach<V, fixed>& reach, const Real* ahead)
        : e_(e),
          received_(received),
          sent_down_(sent_down),
          received_2_(e.received_2),
          force_(e.force),
          here_(source.here),
          below_(source.below),
          below_2_(source.below_2),
          pending_(pending),
          reach_(reach),
          ahead_(ahead),
          stride_(source_stride<V>(stage)),
          m_(fixed ? fixed : e.vectors) {}
    CLOTHSIM_INLINE void run() {
        all_columns();
        pass_beyond_end();
    }
};

// Takes rows [begin, end) through one stage, with one number of vectors; 0: that of `e`.
template <class Arch, class Real, EdgeSet set, Stage stage, int fixed>
__attribute__((noinline)) void edge_rows_of(EdgeArguments<Real>& e, int begin, int end) {
    const auto source = [&](int row) -> const Real* {
        return source_is_state(stage) ? e.rows[row].state : e.rows[row].work;
    };
    const Reach<Lanes<Real, Arch>, fixed> reach(e.reach);
    Real* received = e.received[0];
    Real* sent_down = e.received[1];
    for (int row = begin; row < end; ++row) {
        const EdgeSources<Real> sources{source(row), source(row + 1), source(row + 2)};
        RowPass<Arch, Real, set, stage, fixed>(e, sources, received, sent_down, pending_row(e),
                                               reach, row_ahead(e, row))
            .run();
        std::swap(received, sent_down);
        e.pending = row;
        e.pending_source = sources.here;
        if (e.forces) e.forces(e);
    }
    e.received[0] = received;
    e.received[1] = sent_down;
}

// Damped rows of the paper's 32 columns are written out vector by vector where four vectors hold
// them: 8 to 20 % of their time. Without damping it was 5 to 12 %, and no ready scene has so many
// columns.
template <class Arch, class Real, EdgeSet set>
inline constexpr int vectors_written_out =
    set.damped && 32 / int(Lanes<Real, Arch>::size) <= 4 ? 32 / int(Lanes<Real, Arch>::size) : 0;

template <class Arch, class Real, EdgeSet set, Stage stage>
CLOTHSIM_INLINE void edge_rows_in(EdgeArguments<Real>& e, int begin, int end) {
    constexpr int fixed = vectors_written_out<Arch, Real, set>;
    if constexpr (fixed > 0 && stage != Stage::evaluate)
        if (e.ahead == 0 && e.vectors == fixed && e.whole_vectors == fixed - 2)
            return edge_rows_of<Arch, Real, set, stage, fixed>(e, begin, end);
    edge_rows_of<Arch, Real, set, stage, 0>(e, begin, end);
}

// Takes rows [begin, end), of which all have two more behind them in `e.rows`, through one stage.
// Code that knows its stage takes nine tenths of the time of code that asks.
template <class Arch, class Real, EdgeSet set>
void edge_rows(EdgeArguments<Real>& e, int begin, int end) {
    switch (e.stage) {
        case Stage::first: return edge_rows_in<Arch, Real, set, Stage::first>(e, begin, end);
        case Stage::second: return edge_rows_in<Arch, Real, set, Stage::second>(e, begin, end);
        case Stage::third: return edge_rows_in<Arch, Real, set, Stage::third>(e, begin, end);
        case Stage::fourth: return edge_rows_in<Arch, Real, set, Stage::fourth>(e, begin, end);
        case Stage::evaluate: return edge_rows_in<Arch, Real, set, Stage::evaluate>(e, begin, end);
    }
}

}  // namespace
}  // namespace clothsim
