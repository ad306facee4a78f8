#include "driver/members.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <exception>
#include <thread>

#include "memory/threads.hpp"

namespace clothsim {
namespace {

// How many of `count` members are stepped by one thread each. The others are too few for all threads. The
// whole team steps them one after the other where that is faster.
std::int64_t alone(std::int64_t count, std::int64_t points, int threads) {
    if (count == 1) return 0;
    const std::int64_t left = count % threads;
    return 4 * left <= 3 * threads && points >= least_points_per_thread * threads ? count - left : count;
}

// By the thread that may ask, while others of its team still step members.
void ask_until_done(Poll& poll, const std::atomic<std::ptrdiff_t>& left) {
    using std::chrono::microseconds, std::chrono::steady_clock;
    // Spins at first, as the end of a team does. Half or twice of either changes no time of a batch.
    constexpr microseconds spinning{200}, sleep{100};
    const auto start = steady_clock::now();
    while (left.load(std::memory_order_relaxed) > 0) {
        if (steady_clock::now() - start < spinning) {
            pause_briefly();
        } else {
            poll.stopped();
            std::this_thread::sleep_for(sleep);
        }
    }
}

}  // namespace

void each_member_of(const std::vector<std::size_t>& members, std::int64_t points, int threads,
                    const MemberWork& work, Poll* poll) {
    const auto do_work = [&](std::size_t i, int team) {
        if (poll && members.size() > 1) poll->check();
        work(i, team);
    };
    const auto each_alone = members.begin() + alone(std::int64_t(members.size()), points, threads);
    if (each_alone != members.begin()) {
        const int team = int(std::min<std::int64_t>(threads, each_alone - members.begin()));
        std::exception_ptr failure;  // none may leave the region
        std::atomic<std::ptrdiff_t> left{each_alone - members.begin()};
#pragma omp parallel num_threads(team_for(team)) if (team > 1)
        {
#pragma omp for schedule(dynamic) nowait
            for (auto i = members.begin(); i < each_alone; ++i) {
                try {
                    do_work(*i, 1);
                } catch (...) {
#pragma omp critical(clothsim_member_failure)
                    failure = std::current_exception();
                }
                left.fetch_sub(1, std::memory_order_relaxed);
            }
            if (poll && poll->is_asker()) ask_until_done(*poll, left);
        }
        if (failure) std::rethrow_exception(failure);
    }
    for (auto i = each_alone; i != members.end(); ++i) do_work(*i, threads);
}

}  // namespace clothsim
