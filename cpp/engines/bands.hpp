// Threads side by side on bands of rows, without barriers.
//
// A thread goes through its band sweep after sweep. Row by row it evaluates accelerations at one version of
// the state. From them it makes the next version of the row, while the row is in cache. A row needs two rows
// on either side, so two neighbouring bands need two rows of each other. Bands of even number go up, the
// others down. At a border, both bands start their sweeps (`near`) or both end them (`far`). The next version
// at the near border is signalled at once, a whole sweep before the neighbour needs it. So threads rarely
// wait for the transfer between processors.
//
// A thread can be no more than one version ahead of its neighbours. So a version may be made in any array
// that the version before it is not in.
#pragma once

#include <atomic>
#include <memory>
#include <optional>
#include <utility>

#include "engines/state_engine.hpp"
#include "memory/row_band.hpp"
#include "memory/threads.hpp"

namespace clothsim {

// The newest version of the state of which a band has made the two rows at its borders. Versions are counted
// anew in each parallel region.
struct alignas(64) Progress {
    std::atomic<int> near{0};
    alignas(64) std::atomic<int> far{0};
};

template <class Real>
struct Band : RowBand {
    bool first = true;
    FieldScratch<Real>* scratch = nullptr;
    Progress* own = nullptr;
    Barrier* team = nullptr;
    // Of the neighbours at the two borders; null where the cloth ends.
    const Progress *near = nullptr, *far = nullptr;
    int version = 0;  // that the next sweep reads

    void barrier() const { team->wait(); }

    // `work(begin, end)` for the rows, at most `several` at a time; it returns of how many the next version
    // is made.
    template <class Work>
    void each_rows(int several, Work work) {
        const int n = size(), waiting = far ? n - 2 : n;
        for (int i = 0, made = 0; i < n;) {
            if (i == waiting) wait_for(far->far, version);
            // The neighbour is signalled as soon as two are made, which may take three.
            const int most = near && made < 2 ? std::min(several, 3) : several;
            const int end = std::min(i + most, i < waiting ? waiting : n);
            const int made_before = std::exchange(made, work(i, end));
            if (near && made_before < 2 && made >= 2) signal(own->near, version + 1);
            i = end;
        }
        ++version;
        if (far) signal(own->far, version);
    }
};

// The threads' bands of a cloth.
template <class Real>
class Bands {
public:
    // `work(band)` by at most `threads` threads.
    template <class Work>
    void run(int rows, int threads, Work work) {
        const auto begin = [&](int team) {
            while (int(scratch_.size()) < team) scratch_.push_back(std::make_unique<FieldScratch<Real>>());
            progress_ = std::make_unique<Progress[]>(std::size_t(team));
            barrier_.emplace(team);
        };
        in_team(RowBand::team(rows, threads), begin, [&](int t, int team) {
            Band<Real> band{RowBand::of(rows, t, team)};
            band.first = t == 0;
            band.scratch = scratch_[std::size_t(t)].get();
            band.own = &progress_[std::size_t(t)];
            band.team = &*barrier_;
            const Progress* const above = t > 0 ? &progress_[std::size_t(t - 1)] : nullptr;
            const Progress* const below = t + 1 < team ? &progress_[std::size_t(t + 1)] : nullptr;
            band.near = band.upwards ? below : above;
            band.far = band.upwards ? above : below;
            work(band);
        });
    }

private:
    std::vector<std::unique_ptr<FieldScratch<Real>>> scratch_;
    std::unique_ptr<Progress[]> progress_;
    std::optional<Barrier> barrier_;
};

}  // namespace clothsim
