// Threads: how many are accepted and chosen, on which processors a team works, and how its threads wait for
// each other.
#pragma once

#include <omp.h>

#include <array>
#include <atomic>
#include <cstdint>

namespace clothsim {

// libgomp ends the process for counts it cannot serve, so requests are bounded before they reach it.
inline constexpr int most_threads = 256;

// Processors this process may run on.
int available_threads();

// How many of `wanted` threads a team of this thread can have. OpenMP's runtime ends the process where it
// cannot start a thread. So before a team that is larger than the last, as many threads are started and
// ended.
int granted_threads(int wanted);
// As granted_threads, for a parallel region that follows at once. OpenMP keeps the threads of the newest
// team, and ends those that it has left over.
int team_for(int wanted);

// Lets a forked child use OpenMP although its parent has: the team is parked before the fork.
void install_fork_handler();

// The processors of a team. Linux may wake a thread on the processor of the thread that wakes it, where the
// other processors seem to be taken. A virtual machine's processors seem taken when they have slept too. The
// two threads would then wait for each other, for milliseconds.
class Processors {
public:
    Processors() { take(); }  // by the thread that calls the others
    // By each of the others: away from a processor that another one has taken, if there is one left to which
    // it may go.
    void resolve();

private:
    // Takes the one this thread is on; whether it was free.
    bool take();

    static constexpr int most = 1024, bits = 64;
    std::array<std::atomic<std::uint64_t>, most / bits> taken_{};
};

inline void pause_briefly() {
#if defined(__x86_64__)
    __builtin_ia32_pause();
#elif defined(__aarch64__)
    asm volatile("yield");
#endif
}

// Nanoseconds that threads have slept in `wait_long`: many show that other processes have the processors.
inline std::atomic<std::int64_t> slept{0};

// Spins for a while longer, then sleeps until `wanted` is reached.
void wait_long(const std::atomic<int>& reached, int wanted);

// Neighbours respond within microseconds, unless another process has their processor.
inline void wait_for(const std::atomic<int>& reached, int wanted) {
    constexpr int spins = 500;  // 5 to 20 us
    for (int turn = 0; reached.load(std::memory_order_acquire) < wanted; ++turn) {
        if (turn == spins) return wait_long(reached, wanted);
        pause_briefly();
    }
}
inline void signal(std::atomic<int>& reached, int now) { reached.store(now, std::memory_order_release); }

// Where all threads of a team wait for the last of them. OpenMP's lets them sleep too soon.
class Barrier {
public:
    explicit Barrier(int team) : team_(team) {}
    void wait() {
        if (team_ == 1) return;
        const int before = opened_.load(std::memory_order_relaxed);  // the last one is still to come
        if (arrived_.fetch_add(1, std::memory_order_acq_rel) + 1 < team_)
            return wait_for(opened_, before + 1);
        arrived_.store(0, std::memory_order_relaxed);
        signal(opened_, before + 1);
    }

private:
    int team_;
    alignas(64) std::atomic<int> arrived_{0};
    alignas(64) std::atomic<int> opened_{0};
};

// `work(thread, team)` by a team of threads. `begin(team)` comes first: once, or twice if fewer threads are
// given than asked for, since one that is not there would be waited for.
template <class Begin, class Work>
void in_team(int team, Begin begin, Work work) {
    begin(team);
    if (team == 1) return work(0, 1);
    Processors processors;
#pragma omp parallel num_threads(team_for(team))
    {
        const int given = omp_get_num_threads(), thread = omp_get_thread_num();
        if (thread > 0) processors.resolve();
        if (given != team) {
#pragma omp single
            begin(given);
        }
        work(thread, given);
    }
}

}  // namespace clothsim
