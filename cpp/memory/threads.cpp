#include "memory/threads.hpp"

#include <algorithm>
#include <exception>
#include <memory>
#include <mutex>
#include <vector>

#if !defined(_WIN32)
#include <pthread.h>
#endif

#include "memory/subnormals.hpp"

namespace clothsim {
namespace {

struct Job {
    const std::function<void(int)>& work;
    std::atomic<int> done{0};
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
    alignas(64) std::atomic<unsigned> begun{0};  // jobs

    void begin(Job* next) {
        job = next;
        begun.fetch_add(1, std::memory_order_release);
        begun.notify_one();
    }
};

void serve(const std::shared_ptr<Worker>& self, int thread) {
    const FlushSubnormals flushed;
    // Some 50 us: what the next call or block of a series takes. Half: sleeps between them; twice: no faster.
    constexpr int spins = 2000;
    for (unsigned jobs = 0;; ++jobs) {
        for (int turn = 0; turn < spins && self->begun.load(std::memory_order_acquire) == jobs; ++turn)
            pause_briefly();
        self->begun.wait(jobs, std::memory_order_acquire);
        Job* const job = self->job;
        if (!job) return;
        job->run(thread);
        job->done.fetch_add(1, std::memory_order_release);
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
    Job job{work};
    for (int thread = 1; thread < team; ++thread) workers.all[std::size_t(thread - 1)]->begin(&job);
    job.run(0);
    wait_until([&] { return job.done.load(std::memory_order_acquire) == team - 1; });
    if (job.failure) std::rethrow_exception(job.failure);
}

void install_fork_handler() {
#if !defined(_WIN32)
    pthread_atfork(nullptr, nullptr, [] { workers.all.clear(); });
#endif
}

}  // namespace clothsim
