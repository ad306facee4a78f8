#include "memory/threads.hpp"

#include <algorithm>
#include <exception>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#if defined(__linux__)
#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>
#endif

#include "memory/subnormals.hpp"

namespace clothsim {
namespace {

struct Job {
    const std::function<void(int)>& work;
    std::mutex mutex{};
    std::exception_ptr failure{};

    void run(int thread) {
        try {
            work(thread);
        } catch (...) {
            const std::lock_guard<std::mutex> lock(mutex);
            failure = std::current_exception();
        }
    }
};

struct Worker {
    Job* job = nullptr;  // null: the end
    alignas(64) std::atomic<int> begun{0};  // jobs
    alignas(64) std::atomic<int> ended{0};

    void begin(Job* next) {
        job = next;
        signal(begun, begun.load(std::memory_order_relaxed) + 1);
    }
};

void serve(const std::shared_ptr<Worker>& self, int thread) {
    const FlushSubnormals flushed;
    // Some 50 us: what the next call or block of a series takes. Half: sleeps between them; twice:
    // no faster.
    constexpr int spins = 2000;
    for (unsigned jobs = 1;; ++jobs) {
        wait_for(self->begun, int(jobs), spins);
        Job* const job = self->job;
        if (!job) return;
        job->run(thread);
        signal(self->ended, int(jobs));
    }
}

// They are detached and share their Worker, so that nothing waits for them where a process ends.
struct Workers {
    std::vector<std::shared_ptr<Worker>> all;
    ~Workers() {
        for (const auto& worker : all) worker->begin(nullptr);
    }
};
thread_local Workers workers;

}  // namespace

void sleep_at(const std::atomic<int>& counter, int now) {
    sleepers.fetch_add(1);
#if defined(__linux__)
    syscall(SYS_futex, &counter, FUTEX_WAIT_PRIVATE, now, nullptr, nullptr, 0);
#else
    counter.wait(now);
#endif
    sleepers.fetch_sub(1);
}

void wake(const std::atomic<int>& counter) {
#if defined(__linux__)
    syscall(SYS_futex, &counter, FUTEX_WAKE_PRIVATE, most_threads, nullptr, nullptr, 0);
#else
    const_cast<std::atomic<int>&>(counter).notify_all();
#endif
}

int granted_threads(int wanted) {
    auto& all = workers.all;
    try {
        while (int(all.size()) + 1 < wanted) {
            all.reserve(most_threads);
            const auto worker = std::make_shared<Worker>();
            std::thread(serve, worker, int(all.size()) + 1).detach();
            all.push_back(worker);
        }
    } catch (const std::exception&) {  // no further thread, or no memory for one
    }
    return std::min(wanted, int(all.size()) + 1);
}

void run_team(int team, const std::function<void(int)>& work) {
    if (team == 1) return work(0);
    Job job{work};
    for (int i = 0; i < team - 1; ++i) workers.all[std::size_t(i)]->begin(&job);
    job.run(0);
    for (int i = 0; i < team - 1; ++i) {
        const Worker& worker = *workers.all[std::size_t(i)];
        wait_for(worker.ended, worker.begun.load(std::memory_order_relaxed));
    }
    if (job.failure) std::rethrow_exception(job.failure);
}

void forget_workers() { workers.all.clear(); }

}  // namespace clothsim
