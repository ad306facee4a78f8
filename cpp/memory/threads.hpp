// Teams of threads. Each thread that calls the core has workers of its own, which wait for its next
// call.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>

namespace clothsim {

inline constexpr int most_threads = 256;

// How many threads a team of this thread has, at most `wanted`. Workers that it lacks are started;
// the system may refuse some.
int granted_threads(int wanted);

// In the child of a fork, which has none of its parent's workers.
void forget_workers();

// Until another thread changes a counter from `now` and wakes its sleepers, or by chance earlier.
// Not by std::atomic::wait: that of libstdc++ yields first.
void sleep_at(const std::atomic<int>& counter, int now);
void wake(const std::atomic<int>& counter);
inline std::atomic<int> sleepers{0};

inline void pause_briefly() {
#if defined(__x86_64__)
    __builtin_ia32_pause();
#elif defined(__aarch64__)
    asm volatile("yield");
#endif
}

// Waits for a counter, which may wrap around: spins, 500 times take 5 to 20 us, then sleeps. (A
// yield would give a busy neighbour its whole time slice, at each halo.)
inline void wait_for(const std::atomic<int>& reached, int wanted, int spins = 500) {
    const auto there = [&](int now) { return int(unsigned(wanted) - unsigned(now)) <= 0; };
    for (int turn = 0; turn < spins; ++turn, pause_briefly())
        if (there(reached.load(std::memory_order_acquire))) return;
    for (int now; !there(now = reached.load(std::memory_order_acquire));) sleep_at(reached, now);
}
inline void signal(std::atomic<int>& reached, int now) {
    reached.store(now);  // before it is asked who sleeps
    if (sleepers.load() > 0) wake(reached);
}

// Where all threads of a team wait for the last of them.
class Barrier {
public:
    explicit Barrier(int team) : team_(team) {}
    void wait() {
        if (team_ == 1) return;
        // The last one is still to come.
        const int before = opened_.load(std::memory_order_relaxed);
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

// `work(thread)` by each of `team` granted threads, of which this one is 0. An exception of one is
// thrown when all have ended.
void run_team(int team, const std::function<void(int)>& work);

// `work(thread, team)` by at most `wanted` threads.
template <class Work>
void in_team(int wanted, Work work) {
    const int team = granted_threads(wanted);
    run_team(team, [&](int thread) { work(thread, team); });
}

// `work(begin, end)` for parts of [0, count) of about equal size, by at most `wanted` threads.
template <class Work>
void in_parts(std::ptrdiff_t count, int wanted, Work work) {
    in_team(wanted, [&](int thread, int team) {
        work(count * thread / team, count * (thread + 1) / team);
    });
}

}  // namespace clothsim
