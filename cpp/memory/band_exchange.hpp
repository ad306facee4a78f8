// Halo exchange: threads side by side on bands of rows, without barriers.
//
// A thread goes through its band sweep after sweep. Row by row it evaluates accelerations at one
// version of the state. From them it makes the next version of the row, while the row is in cache.
// A row needs two rows on either side, so two neighbouring bands need two rows of each other. Bands
// of even number go up, the others down. At a border, both bands start their sweeps (`near`) or
// both end them (`far`):
//
//     band 0   ^  far end: edge of the cloth
//              |  starts here
//     ------- border -------  each makes its first two rows at the beginning of a sweep: the other
//              |  starts here      needs them a sweep later
//     band 1   v
//     ------- border -------  each makes its last two rows at the end of a sweep: the other needs
//     band 2   ^                  them at the end of the next
//
// The next version at the near border is signalled at once, a whole sweep before the neighbour
// needs it. So threads rarely wait for the transfer between processors.
//
// A band finishes a sweep only with its neighbour's rows of the version before. So it is no more
// than one version ahead of its neighbours. A version may be made in any array that does not hold
// the version before it. An engine that overwrites its rows copies those at a border for the
// neighbour (engines/edge_engine.cpp).
#pragma once

#include <memory>
#include <vector>

#include "memory/row_band.hpp"
#include "memory/threads.hpp"

namespace clothsim {

struct NeighbouringBand : RowBand {
    // The newest version of which a band has made the two rows at a border. Versions are counted
    // anew in each parallel region.
    struct alignas(64) Newest {
        std::atomic<int> version{0};
        bool reached(int number) const { return version.load(std::memory_order_relaxed) >= number; }
    };
    Newest at_near, at_far;
    // The neighbours where sweeps begin, and where they end; null where the cloth ends.
    NeighbouringBand *near = nullptr, *far = nullptr;

    void begin_region() {
        for (Newest* newest : {&at_near, &at_far})
            newest->version.store(0, std::memory_order_relaxed);
    }
    void signal_near(int version) { signal(at_near.version, version); }
    void signal_far(int version) { signal(at_far.version, version); }
    void wait_near(int version) const { wait_until(near->at_near.version, version); }
    void wait_far(int version) const { wait_until(far->at_far.version, version); }
};

// The bands of a team.
template <class Band>
std::vector<std::unique_ptr<Band>> bands_of(int rows, int team) {
    std::vector<std::unique_ptr<Band>> bands(static_cast<std::size_t>(team));
    for (int t = 0; t < team; ++t) {
        auto& band = bands[std::size_t(t)] = std::make_unique<Band>();
        static_cast<RowBand&>(*band) = RowBand::of(rows, t, team);
        if (t == 0) continue;
        auto& above = bands[std::size_t(t - 1)];
        (band->upwards ? band->far : band->near) = above.get();
        (above->upwards ? above->near : above->far) = band.get();
    }
    return bands;
}

}  // namespace clothsim
