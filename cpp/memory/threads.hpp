// Teams of threads, which are OpenMP's. A build without OpenMP has one thread.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>

#include "memory/heuristics.hpp"

namespace clothsim {

inline constexpr int most_threads = 256;

// The first counts the processors of this process; the second how many of them OMP_NUM_THREADS
// leaves.
int processors();
int available_threads();

// Returns how many threads a team has, at most `most`: OMP_THREAD_LIMIT is kept, and a team
// starts none.
int granted_threads(int most);

// Ends the idle threads before a fork, whose child would wait for threads that it does not have.
void pause_threads();

inline void pause_briefly() {
#if defined(__x86_64__)
    __builtin_ia32_pause();
#elif defined(__aarch64__)
    asm volatile("yield");
#endif
}

// Counters may wrap around.
inline bool has_reached(const std::atomic<int>& counter, int value) {
    return int(unsigned(value) - unsigned(counter.load(std::memory_order_acquire))) <= 0;
}
// Sleeps until a counter is there.
void sleep_until(const std::atomic<int>& counter, int value);
// Looks often before it sleeps.
inline void wait_until(const std::atomic<int>& counter, int value) {
    for (int look = 0; look < heuristics::looks_before_sleep; ++look, pause_briefly())
        if (has_reached(counter, value)) return;
    sleep_until(counter, value);
}
inline void signal(std::atomic<int>& counter, int value) {
    counter.store(value, std::memory_order_release);
}

// All threads of a team wait here for the last of them.
class Barrier {
public:
    explicit Barrier(int team) : team_(team) {}
    void wait() {
        if (team_ == 1) return;
        // The last one is still to come.
        const int previous = opened_.load(std::memory_order_relaxed);
        if (arrived_.fetch_add(1, std::memory_order_acq_rel) + 1 < team_)
            return wait_until(opened_, previous + 1);
        arrived_.store(0, std::memory_order_relaxed);
        signal(opened_, previous + 1);
    }

private:
    int team_;
    alignas(64) std::atomic<int> arrived_{0};
    alignas(64) std::atomic<int> opened_{0};
};

// Calls `work(thread)` on each of `team` granted threads, of which this one is 0. An exception on
// any of them is thrown again when all have ended.
void run_team(int team, const std::function<void(int)>& work);

// Calls `work(thread, team)` on at most `most` threads.
template <class Work>
void run_in_team(int most, Work work) {
    const int team = granted_threads(most);
    run_team(team, [&](int thread) { work(thread, team); });
}

// Calls `work(begin, end)` for parts of [0, count) of about equal size, on at most `most`
// threads.
template <class Work>
void run_in_parts(std::ptrdiff_t count, int most, Work work) {
    run_in_team(most, [&](int thread, int team) {
        work(count * thread / team, count * (thread + 1) / team);
    });
}

}  // namespace clothsim
