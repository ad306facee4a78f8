#include "memory/threads.hpp"

#include <pthread.h>
#include <sched.h>

namespace clothsim {

int available_threads() { return omp_get_num_procs(); }

void install_fork_handler() {
    // Without this the child inherits a team whose threads do not exist there and waits for them for ever.
    pthread_atfork([] { omp_pause_resource_all(omp_pause_soft); }, nullptr, nullptr);
}

#if defined(__linux__)

bool Processors::take() {
    const int here = sched_getcpu();
    if (here < 0 || here >= most) return true;
    const std::uint64_t bit = std::uint64_t(1) << here % bits;
    return !(taken_[std::size_t(here / bits)].fetch_or(bit, std::memory_order_relaxed) & bit);
}

void Processors::resolve() {
    static_assert(CPU_SETSIZE == most);
    if (take()) return;
    cpu_set_t allowed;
    if (sched_getaffinity(0, sizeof allowed, &allowed) != 0) return;
    cpu_set_t free = allowed;
    for (int cpu = 0; cpu < most; ++cpu)
        if (CPU_ISSET(cpu, &free) &&
            taken_[std::size_t(cpu / bits)].load(std::memory_order_relaxed) >> cpu % bits & 1)
            CPU_CLR(cpu, &free);
    // It moves at once; where it may be moved later is as before.
    if (CPU_COUNT(&free) == 0 || sched_setaffinity(0, sizeof free, &free) != 0) return;
    sched_setaffinity(0, sizeof allowed, &allowed);
    take();
}

#else

bool Processors::take() { return true; }
void Processors::resolve() {}

#endif

}  // namespace clothsim
