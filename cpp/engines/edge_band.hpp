// A band of rows of the edge engine (edge_engine.cpp): its place in memory and its neighbours. A thread works
// on a band.
//
// The versions of the halo exchange (memory/band_exchange.hpp) are the stages of the steps. A stage
// overwrites its rows in place, so each band copies the two rows at a border for its neighbour:
//
//     make rows --> hand: copy into the neighbour's HaloSlot --> signal the stage
//                                                                   |
//     neighbour: wait for the stage, sum springs
#pragma once

#include <limits>

#include "engines/edge_engine.hpp"
#include "memory/band_exchange.hpp"

namespace clothsim {

// Halo rows received from the neighbouring band, one slot per stage of a step. A slot holds the row at the
// border and, for bend springs, the row behind it. Without damping only positions are exchanged. Two slots
// would be correct too.
template <class Real>
struct HaloSlot {
    static constexpr int slots = 4;
    AlignedVector<Real> rows;
    int vectors = 0, row_count = 0;
    std::ptrdiff_t state_stride = 0, work_stride = 0, row_size = 0, seen = 0;

    void prepare(const TransposedLayout& layout, const Features& features) {
        vectors = layout.vectors;
        row_count = features.family[bend] ? 2 : 1;
        seen = (features.spring_damping ? 6 : 3) * layout.lanes;
        state_stride = layout.stride;
        work_stride = WorkRecord::count * layout.lanes;
        row_size = vectors * work_stride;  // the larger one
        rows.assign(slots * 2 * row_size + layout.lanes, Real(0));
    }
    Real* row(std::int64_t stage, int which) { return rows.data() + (stage % slots * 2 + which) * row_size; }
    // From vector to vector of the rows that the stage reads. The first stage of a step reads states.
    std::ptrdiff_t stride(std::int64_t stage) const { return stage % 4 == 0 ? state_stride : work_stride; }
    void put(std::int64_t stage, const Real* border, const Real* second) {
        for (int which = 0; which < row_count; ++which)
            for (int k = 0; k < vectors; ++k) {
                const std::ptrdiff_t at = k * stride(stage);
                std::copy_n((which == 0 ? border : second) + at, seen, row(stage, which) + at);
            }
    }
};

// Work memory of a thread: rings of rows, and the rows that each of four stages passes on. All strips of a
// thread use it, so it stays in cache.
template <class Real>
struct Workspace {
    AlignedVector<Real> rows, scratch;
};

template <class Real>
struct EdgeEngine<Real>::Band : NeighbouringBand {
    EdgeEngine* engine;
    int strip;
    HaloSlot<Real> from_near, from_far;
    std::shared_ptr<Workspace<Real>> workspace;
    std::vector<EdgeRowPointers<Real>>
        rows;  // in the order of the sweep, and the two of the neighbour behind them
    int lag, several;  // rows between two stages, and of one at a time; all rows: stage by stage
    EdgeArguments<Real> stages[4];
    double stages_dt = std::numeric_limits<double>::quiet_NaN();  // that of `stages`
    std::int64_t step = 0;  // to which the state belongs
    Clock clock;  // of the call
    // The number of a step's stage, counted over all steps.
    std::int64_t number_of(int stage) const { return 4 * step + stage; }
    bool finite = true;  // the rows inspected in this call

    std::ptrdiff_t work_stride() const { return WorkRecord::count * engine->layout_.lanes; }
    const Real* source(Stage stage, int row) const {
        return stage == Stage::first ? rows[std::size_t(row)].state : rows[std::size_t(row)].work;
    }
    // Let the rows behind the last be those of the neighbour at a stage.
    void fetch_beyond_far(std::int64_t number) {
        for (int i = 0; i < 2; ++i) {
            EdgeRowPointers<Real>& beyond = rows[std::size_t(size() + i)];
            beyond.state = beyond.work = from_far.row(number, i);
        }
    }
    // Versions are the stages of a call's steps, from 1 on.
    int version(std::int64_t number) const { return int(number - 4 * engine->step_) + 1; }
    Band& neighbour(NeighbouringBand* at) const { return *static_cast<Band*>(at); }
    // Copies the two finished rows at a border to the neighbour, which reads them in stage `number`.
    void hand_near(std::int64_t number) {
        const Stage next = Stage(number % 4);
        neighbour(near).from_near.put(number, source(next, 0), source(next, 1));
        signal_near(version(number));
    }
    void hand_far(std::int64_t number) {
        const Stage next = Stage(number % 4);
        const int last = size() - 1;
        neighbour(far).from_far.put(number, source(next, last), source(next, last - 1));
        signal_far(version(number));
    }

    void begin_call() {
        step = engine->step_;
        finite = true;
        begin_region();
    }
    void give_border(int r, std::int64_t step) {
        if (r + 1 < size()) engine->halos_.claim(strip, row(r + 1), step);
        engine->halos_.give(strip, row(r), rows[std::size_t(r)].state, step);
    }
    void exchange_halos() {
        for (int r = 0; engine->layout_.strips > 1 && r < size(); ++r) give_border(r, step);
    }
    void take_border(int r) {
        if (r < 0 || r >= size()) return;
        if (r + 1 < size()) engine->halos_.fetch(strip, row(r + 1), step);
        engine->halos_.take(strip, row(r), rows[std::size_t(r)].state, step);
    }
    // The state with which a step begins, to the neighbours: with its halo, so the strips beside this one
    // have to be there.
    void send_start() {
        const int n = size();
        const std::int64_t number = 4 * step;
        for (const int row : {0, 1, n - 2, n - 1}) take_border(row);
        if (near) hand_near(number);
        if (far) hand_far(number);
    }

    // Whether rows [begin, end) are finite, while they are in cache.
    void inspect(int begin, int end) {
        const TransposedLayout& layout = engine->layout_;
        const Real* const first = rows[std::size_t(upwards ? end - 1 : begin)].state;
        finite &= engine->kernels().all_finite(
            first, Blocks{end - begin, layout.vectors * layout.stride, layout.row_size()});
    }
};

}  // namespace clothsim
