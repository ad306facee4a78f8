// The edge kernel: every spring once, for speed.
//
// Layout ("row-lifted"). With m vectors of W lanes a row, vector k, lane l holds column l m + k:
//
//     lane          0      1      2             the right-hand neighbour of a whole vector is the next
//     vector 0    0      m     2m     ...       vector, an aligned load without a shuffle; only behind
//     vector 1    1     m+1   2m+1    ...       the last vector stands vector 0 again, one lane further.
//     ...
//
// A row is stored vector by vector, all components of vector 0, then all of vector 1: one stream of memory. What
// compensation keeps is another, behind it.
//
// A sweep goes from row to row. A row adds the force of each of its springs to its own points and hands the
// opposite force on: within the row in registers, to the next row in `received`, to the row after it in
// `received_2`; what passes the row's end belongs to its first vectors, a lane further, and reaches them last.
// A row's forces are complete at its end; its Runge-Kutta stage is finished vector by vector while the next row's
// springs are summed, between operations that wait for each other (or sooner, edge_two_vectors.hpp). Nothing
// needs the row's old stage state any more: the new one replaces it.
//
// Sweeps may start anywhere and go up or down: the force on a point is summed as
//
//     within the row + ((vertical + 2nd vertical) + (diagonal + other diagonal) of the rows before
//                      -  the same of the rows behind)
//
// (what passes the row's end likewise, in a sum of its own)
// which gives the same bits either way, and `edge_halo` repeats what the two rows before a band hand on. So
// do any number of threads.
#pragma once

#include <utility>

#include "kernels/edge_row.hpp"
#include "kernels/edge_two_vectors.hpp"
#include "kernels/kernel_table.hpp"

namespace clothsim {
namespace {

// Rows [begin, end) in one stage, with one number of vectors; any_stage and 0: those of `e`.
template <class Arch, class Real, int index, Stage stage, int fixed, Springs along>
__attribute__((noinline)) void edge_rows_of(EdgeArguments<Real>& e, int begin, int end) {
    const bool of_state = source_is_state(stage == any_stage ? e.stage : stage);
    const auto source = [&](int row) -> const Real* { return of_state ? e.rows[row].state : e.rows[row].work; };
    const auto ahead = [&](int row) { return e.ahead > 0 && row + e.ahead < e.row_count ? e.rows[row + e.ahead].state : nullptr; };
    const Reach<Lanes<Real, Arch>, fixed> reach(e.reach);
    Real* received = e.received[0];
    Real* hand_down = e.received[1];
    const int first_finished = e.pending < 0 ? begin : e.pending;
    for (int row = begin; row < end; ++row) {
        const EdgeSources<Real> sources{source(row), source(row + 1), source(row + 2)};
        edge_row<Arch, Real, index, stage, fixed, along, true, true, true>(e, sources, received, hand_down, pending_row(e), reach,
                                                                           ahead(row));
        std::swap(received, hand_down);
        e.pending = row;
        e.pending_source = sources.here;
    }
    e.received[0] = received;
    e.received[1] = hand_down;
    end_rows<Lanes<Real, Arch>>(e, first_finished, end - 1);
}

// A cloth without structural springs is worth less time to compile: what gains most, the paper's rows written out, which know
// their stage where only that family is missing, and one loop for all others, which asks for the stage.
template <int index>
constexpr bool in_versions = Features::from_index(index).structural;

// Short rows are written out vector by vector, with mask registers those that end with padding too: of 32 points as in the
// paper's cloth and, in lanes of which four vectors hold them, of up to 64.
template <class Arch, class Real, int index>
constexpr bool is_written_out(int vectors) {
    const int points = vectors * int(Lanes<Real, Arch>::size);
    return 32 <= points && points <= (in_versions<index> ? 64 : 32) && vectors <= 4;
}

template <class Real>
bool may_be_written_out(const EdgeArguments<Real>& e) {
    return e.damped_alike && (e.complete || masks_in_registers);
}

// With mask registers, to ask which lanes have a spring costs nothing.
inline constexpr Springs along_written_out = masks_in_registers ? Springs::some : Springs::all;

// A single row. They are few: of those that are not written out, what serves any vector is all that is compiled. The four
// vectors of AVX2 are not: a third of the time to compile it, while a row that runs by itself is not in the cache of
// instructions, so that the shorter code is as fast.
template <class Arch, class Real, int index, class Run>
void run_row(const EdgeArguments<Real>& e, const Run& run) {
    constexpr int fixed = 32 / int(Lanes<Real, Arch>::size);
    if constexpr (masks_in_registers && is_written_out<Arch, Real, index>(fixed))
        if (e.vectors == fixed && may_be_written_out(e)) return run.template operator()<fixed, along_written_out>();
    run.template operator()<0, Springs::by_coefficient>();
}

// The forces on one of the last two rows of a cloth, and the end of the stage of the row before.
template <class Arch, class Real, int index>
void edge_last_row(EdgeArguments<Real>& e, int row, const EdgeSources<Real>& source) {
    const auto run = [&]<int fixed, Springs along>() {
        const auto row_with = [&]<bool has_below>() {
            const Reach<Lanes<Real, Arch>, fixed> reach(e.reach);
            edge_row<Arch, Real, index, any_stage, fixed, along, true, has_below, false>(e, source, e.received[0], e.received[1],
                                                                                         pending_row(e), reach);
        };
        if (source.below) row_with.template operator()<true>();
        else row_with.template operator()<false>();
    };
    run_row<Arch, Real, index>(e, run);
    std::swap(e.received[0], e.received[1]);
    if (e.pending >= 0) end_rows<Lanes<Real, Arch>>(e, e.pending, e.pending + 1);
    e.pending = row;
    e.pending_source = source.here;
}

// One stage of rows [begin, end), of which all have two more behind them in `e.rows`. Code that knows its stage takes nine
// tenths of the time of code that asks.
template <class Arch, class Real, int index>
void edge_rows(EdgeArguments<Real>& e, int begin, int end) {
    constexpr Features features = Features::from_index(index);
    const auto run_written_out = [&]<Stage stage, int fixed>() __attribute__((always_inline)) {
        if constexpr (in_versions<index> && fixed == 2 && features.shear && !features.bend)
            if (e.hand_on_in_registers) return edge_rows_of_two<Arch, Real, index, stage>(e, begin, end);
        edge_rows_of<Arch, Real, index, stage, fixed, along_written_out>(e, begin, end);
    };
    const auto run = [&]<Stage stage>() __attribute__((always_inline)) {
        if (e.ahead == 0 && may_be_written_out(e)) {
            if constexpr (is_written_out<Arch, Real, index>(2))
                if (e.vectors == 2) return run_written_out.template operator()<stage, 2>();
            if constexpr (is_written_out<Arch, Real, index>(3))
                if (e.vectors == 3) return run_written_out.template operator()<stage, 3>();
            if constexpr (is_written_out<Arch, Real, index>(4))
                if (e.vectors == 4) return run_written_out.template operator()<stage, 4>();
        }
        if constexpr (in_versions<index>)
            if (e.complete) return edge_rows_of<Arch, Real, index, stage, 0, Springs::all>(e, begin, end);
        edge_rows_of<Arch, Real, index, stage, 0, Springs::some>(e, begin, end);
    };
    if constexpr (features.spring_damping)
        if (!e.damped_alike) return edge_rows_of<Arch, Real, index, any_stage, 0, Springs::by_coefficient>(e, begin, end);
    const auto with_stage = [&](const auto& run) __attribute__((always_inline)) {
        switch (e.stage) {
            case Stage::first: return run.template operator()<Stage::first>();
            case Stage::second: return run.template operator()<Stage::second>();
            case Stage::third: return run.template operator()<Stage::third>();
            case Stage::fourth: return run.template operator()<Stage::fourth>();
            case Stage::evaluate: return run.template operator()<Stage::evaluate>();
        }
    };
    if constexpr (in_versions<index>) {
        with_stage(run);
    } else {
        if constexpr (masks_in_registers && features.shear && features.bend) {
            constexpr int fixed = 32 / int(Lanes<Real, Arch>::size);
            if (e.ahead == 0 && may_be_written_out(e) && e.vectors == fixed)
                return with_stage([&]<Stage stage>() __attribute__((always_inline)) { run_written_out.template operator()<stage, fixed>(); });
        }
        run.template operator()<any_stage>();
    }
}

// What the two rows before a band hand on to its first two.
template <class Arch, class Real, int index>
void edge_halo(EdgeArguments<Real>& e, const EdgeSources<Real>& before_2, const EdgeSources<Real>& before) {
    using V = Lanes<Real, Arch>;
    constexpr Features features = Features::from_index(index);
    constexpr int W = int(V::size);
    if constexpr (features.bend) {
        constexpr bool damped = features.spring_damping;
        const std::ptrdiff_t stride = source_stride<V>(e.stage);
        const SpringConstants<V> constants{};
        for (int k = 0; k < e.vectors; ++k) {
            const Real* const p = before_2.here + k * stride;
            Points<V> points{load3<V>(p, W), {}};
            if constexpr (damped) points.v = load3<V>(p + 3 * W, W);
            Spring<V> spring = stretch<damped>(points, before_2.below_2 + k * stride, constants);
            root(spring, constants);
            const auto hand = [&]<Springs springs>(int which) {
                const Real* const c = e.coefficients + (which * spring_kind_count + to_below_2) * (EdgeCoefficientIndex::count * W);
                store3(e.received_2 + k * 3 * W, W, force<damped, springs>(spring, c));
            };
            if (e.damped_alike) hand.template operator()<Springs::all>(0);
            else hand.template operator()<Springs::by_coefficient>(e.coefficient_class[k]);
        }
    }
    const auto run = [&]<int fixed, Springs along>() {
        const Reach<Lanes<Real, Arch>, fixed> reach(e.reach);
        edge_row<Arch, Real, index, any_stage, fixed, along, false, true, true>(e, before, e.received[0], e.received[1], {}, reach);
    };
    run_row<Arch, Real, index>(e, run);
    std::swap(e.received[0], e.received[1]);
}

}  // namespace
}  // namespace clothsim
