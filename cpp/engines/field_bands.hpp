// The threads' bands of an engine that evaluates accelerations for the integrators of cpp/integrators. Bands
// read each other's rows where they lie (memory/band_exchange.hpp).
#pragma once

#include <utility>

#include "kernels/edge/edge_arguments.hpp"
#include "memory/aligned_vector.hpp"
#include "memory/band_exchange.hpp"

namespace clothsim {

template <class Real>
struct FieldBand : NeighbouringBand {
    Barrier* team = nullptr;
    int version = 0;  // that the next sweep reads
    // Data of the engine's sweep.
    EdgeArguments<Real> edge{};
    std::vector<EdgeRowPointers<Real>> pointers;
    AlignedVector<Real> values;
    GatherArguments<Real> gather{};

    bool first() const { return begin == 0; }
    void barrier() const { team->wait(); }

    // `work(begin, end)` for the rows, at most `several` at a time; it returns of how many the next version
    // is made.
    template <class Work>
    void each_rows(int several, Work work) {
        const int n = size(), waiting = far ? n - 2 : n;
        for (int i = 0, made = 0; i < n;) {
            if (i == waiting) wait_far(version);
            // The neighbour is signalled as soon as two are made, which may take three.
            const int most = near && made < 2 ? std::min(several, 3) : several;
            const int end = std::min(i + most, i < waiting ? waiting : n);
            const int made_before = std::exchange(made, work(i, end));
            if (near && made_before < 2 && made >= 2) signal_near(version + 1);
            i = end;
        }
        ++version;
        if (far) signal_far(version);
    }
};

template <class Real>
class FieldBands {
public:
    // `work(band)` by at most `threads` threads.
    template <class Work>
    void run(int rows, int threads, Work work) {
        const int team = granted_threads(RowBand::team(rows, threads));
        if (int(bands_.size()) != team) bands_ = bands_of<FieldBand<Real>>(rows, team);
        Barrier barrier(team);
        for (auto& band : bands_) {
            band->begin_region();
            band->version = 0;
            band->team = &barrier;
        }
        run_team(team, [&](int t) { work(*bands_[std::size_t(t)]); });
    }

private:
    std::vector<std::unique_ptr<FieldBand<Real>>> bands_;
};

}  // namespace clothsim
