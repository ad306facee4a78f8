// OpenMP at its edges: how many threads are accepted, how many are chosen, and forked children.
#pragma once

namespace clothsim {

// libgomp ends the process for counts it cannot serve, so requests are bounded before they reach it.
inline constexpr int most_threads = 256;

// Processors this process may run on.
int available_threads();

// Lets a forked child use OpenMP although its parent has: the team is parked before the fork.
void install_fork_handler();

}  // namespace clothsim
