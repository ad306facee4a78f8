// The edge kernel: every spring once, for speed.
//
// Layout ("lane-transposed"). With m vectors of W lanes a row, vector k, lane l holds column l m + k:
//
//     lane          0      1      2             the right-hand neighbour of a whole vector is the next
//     vector 0    0      m     2m     ...       vector, an aligned load without a shuffle; only behind
//     vector 1    1     m+1   2m+1    ...       the last vector stands vector 0 again, one lane further.
//     ...
//
// A row is stored vector by vector, all components of vector 0, then all of vector 1: one stream of memory.
// The compensation is another, behind it.
//
// A sweep goes from row to row. A row adds the force of each of its springs to its own points and passes
// the opposite force on. Within the row it stays in registers. `received` holds forces for the next row,
// `received_2` for the row after it. Forces past the row's end belong to its first vectors, a lane
// further, and reach them last. A row's forces are complete at its end. Its Runge-Kutta stage is finished
// vector by vector while the next row's springs are summed, between operations that wait for each other.
// The row's old stage state is not needed any more: the new state replaces it.
//
// Sweeps may start anywhere and go up or down: the force on a point is summed as
//
//     within the row + ((vertical + 2nd vertical) + (diagonal + other diagonal) of the rows before
//                      -  the same of the rows behind)
//
// (forces past the row's end likewise, in a sum of their own). That gives the same bits either way, and
// `edge_halo` repeats the forces of the two rows before a band. So do any number of threads.
//
// Two loops do so. One is compiled in versions for sets of families and stages: edge_row.hpp serves the rows
// of cloths with structural and shear springs. The other, edge_general.hpp, serves all other cloths, rows at
// the borders, and instruction sets without versions.
#pragma once

#include <utility>

#include "kernels/edge/edge_row.hpp"
#include "kernels/kernel_table.hpp"

namespace clothsim {
namespace {

// Rows [begin, end) in one stage, with one number of vectors; 0: that of `e`.
template <class Arch, class Real, EdgeSet set, Stage stage, int fixed, Springs along>
__attribute__((noinline)) void edge_rows_of(EdgeArguments<Real>& e, int begin, int end) {
    const bool of_state = source_is_state(stage == any_stage ? e.stage : stage);
    const auto source = [&](int row) -> const Real* {
        return of_state ? e.rows[row].state : e.rows[row].work;
    };
    const Reach<Lanes<Real, Arch>, fixed> reach(e.reach);
    Real* received = e.received[0];
    Real* sent_down = e.received[1];
    const int first_finished = e.pending < 0 ? begin : e.pending;
    for (int row = begin; row < end; ++row) {
        const EdgeSources<Real> sources{source(row), source(row + 1), source(row + 2)};
        edge_row<Arch, Real, set, stage, fixed, along>(e, sources, received, sent_down, pending_row(e), reach,
                                                       row_ahead(e, row));
        std::swap(received, sent_down);
        e.pending = row;
        e.pending_source = sources.here;
    }
    e.received[0] = received;
    e.received[1] = sent_down;
    end_rows<Lanes<Real, Arch>>(e, first_finished, end - 1);
}

// Rows of the paper's 32 columns are written out vector by vector where four vectors hold them. With mask
// registers so are rows that end with padding.
template <class Arch, class Real>
inline constexpr int vectors_written_out =
    32 / int(Lanes<Real, Arch>::size) <= 4 ? 32 / int(Lanes<Real, Arch>::size) : 0;

template <class Arch, class Real, EdgeSet set, Stage stage>
CLOTHSIM_INLINE void edge_rows_in(EdgeArguments<Real>& e, int begin, int end) {
    constexpr int fixed = vectors_written_out<Arch, Real>;
    if constexpr (fixed > 0 && stage != Stage::evaluate)
        if (e.ahead == 0 && e.vectors == fixed && (e.complete || masks_in_registers)) {
            // With mask registers, to ask which lanes have a spring costs nothing.
            return edge_rows_of<Arch, Real, set, stage, fixed,
                                masks_in_registers ? Springs::some : Springs::all>(e, begin, end);
        }
    if constexpr (!masks_in_registers && stage != Stage::evaluate)
        if (e.complete) return edge_rows_of<Arch, Real, set, stage, 0, Springs::all>(e, begin, end);
    // Where masks cost something, rows with padding and bare evaluations are rare: one copy of the code
    // serves every stage.
    edge_rows_of<Arch, Real, set, masks_in_registers ? stage : any_stage, 0, Springs::some>(e, begin, end);
}

// One stage of rows [begin, end), of which all have two more behind them in `e.rows`. Code that knows its
// stage takes nine tenths of the time of code that asks.
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

// A single row in any stage. Few of them run one after the other, so code for each stage would not be in the
// cache.
template <class Arch, class Real, EdgeSet set, Row which>
CLOTHSIM_INLINE void edge_row_alone(EdgeArguments<Real>& e, const EdgeSources<Real>& source) {
    const Reach<Lanes<Real, Arch>, 0> reach(e.reach);
    const PendingRow<Real> pending = which == Row::halo ? PendingRow<Real>{} : pending_row(e);
    edge_row<Arch, Real, set, any_stage, 0, Springs::some, which>(e, source, e.received[0], e.received[1],
                                                                  pending, reach);
    std::swap(e.received[0], e.received[1]);
}

// One of the last two rows of a cloth.
template <class Arch, class Real, EdgeSet set>
void edge_last_row(EdgeArguments<Real>& e, int row, const EdgeSources<Real>& source) {
    if (source.below) edge_row_alone<Arch, Real, set, Row::second_last>(e, source);
    else edge_row_alone<Arch, Real, set, Row::last>(e, source);
    row_is_pending<Lanes<Real, Arch>>(e, row, source);
}

// Forces of the two rows before a band on its first two.
template <class Arch, class Real, EdgeSet set>
void edge_halo(EdgeArguments<Real>& e, const EdgeSources<Real>& before_2, const EdgeSources<Real>& before) {
    if constexpr (set.bend) send_down_2<Lanes<Real, Arch>, Real, set.damped>(e, before_2);
    edge_row_alone<Arch, Real, set, Row::halo>(e, before);
}

}  // namespace
}  // namespace clothsim
