// How the threads of a team share the members of a batch.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

namespace clothsim {

// Least mass points of a member for a thread of a team. Such a team is taken to be three quarters as many
// times faster as it has threads.
inline constexpr std::int64_t least_points_per_thread = 512;

// Work for member i by a team of so many threads.
using MemberWork = std::function<void(std::size_t i, int threads)>;

// `work` for these members, of so many mass points each.
void each_member_of(const std::vector<std::size_t>& members, std::int64_t points, int threads,
                    const MemberWork& work);

}  // namespace clothsim
