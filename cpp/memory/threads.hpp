// Teams of threads. Each thread that calls the core has workers of its own, which wait for its next call.
#pragma once

#include <atomic>
#include <functional>
#include <thread>

namespace clothsim {

inline constexpr int most_threads = 256;

// How many threads a team of this thread has, at most `wanted`. Workers that it lacks are started; the system
// may refuse some.
int granted_threads(int wanted);

// A child has none of its parent's workers: it starts its own.
void install_fork_handler();

inline void pause_briefly() {
#if defined(__x86_64__)
    __builtin_ia32_pause();
#elif defined(__aarch64__)
    asm volatile("yield");
#endif
}

// Spins for 5 to 20 us, then lets others have the processor.
template <class Ready>
void wait_until(Ready ready) {
    constexpr int spins = 500;
    for (int turn = 0; !ready(); ++turn) {
        if (turn < spins) pause_briefly();
        else std::this_thread::yield();
    }
}
inline void wait_for(const std::atomic<int>& reached, int wanted) {
    wait_until([&] { return reached.load(std::memory_order_acquire) >= wanted; });
}
inline void signal(std::atomic<int>& reached, int now) { reached.store(now, std::memory_order_release); }

// Where all threads of a team wait for the last of them.
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

// `work(thread)` by each of `team` granted threads, of which this one is 0. An exception of one is thrown
// when all have ended.
void run_team(int team, const std::function<void(int)>& work);

// `work(thread, team)` by at most `wanted` threads, after `begin(team)`.
template <class Begin, class Work>
void in_team(int wanted, Begin begin, Work work) {
    const int team = wanted > 1 ? granted_threads(wanted) : 1;
    begin(team);
    if (team == 1) return work(0, 1);
    run_team(team, [&](int thread) { work(thread, team); });
}
template <class Work>
void in_team(int wanted, Work work) {
    in_team(wanted, [](int) {}, work);
}

}  // namespace clothsim
