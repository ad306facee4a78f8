#include "driver/members.hpp"

#include <algorithm>
#include <atomic>

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

}  // namespace

void each_member_of(const std::vector<std::size_t>& members, std::int64_t points, int threads,
                    const MemberWork& work) {
    const auto each_alone = members.begin() + alone(std::int64_t(members.size()), points, threads);
    if (each_alone != members.begin()) {
        const int team = int(std::min<std::int64_t>(threads, each_alone - members.begin()));
        std::atomic<std::ptrdiff_t> next{0};
        const auto deal = [&](int, int) {
            for (std::ptrdiff_t i; (i = next++) < each_alone - members.begin();) work(members[i], 1);
        };
        in_team(team, deal);
    }
    for (auto i = each_alone; i != members.end(); ++i) work(*i, threads);
}

}  // namespace clothsim
