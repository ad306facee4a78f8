#include "memory/threads.hpp"

#include <algorithm>
#include <exception>
#include <stdexcept>
#include <string>
#include <thread>

#ifdef _OPENMP
#include <omp.h>
#endif

#include "memory/subnormals.hpp"

namespace clothsim {

#ifdef _OPENMP

int processors() { return omp_get_num_procs(); }

int available_threads() { return std::min(processors(), omp_get_max_threads()); }

int granted_threads(int most) {
    return omp_in_parallel() ? 1 : std::min(most, omp_get_thread_limit());
}

void run_team(int team, const std::function<void(int)>& work) {
    if (team == 1) return work(0);
    std::exception_ptr failure;
    const int dynamic = omp_get_dynamic();
    omp_set_dynamic(0);
#pragma omp parallel num_threads(team)
    try {
        // Bands would wait for ever for one that no thread has.
        if (const int size = omp_get_num_threads(); size < team)
            throw std::runtime_error("OpenMP gave " + std::to_string(size) + " of " +
                                     std::to_string(team) + " threads; threads=1 needs no other");
        const FlushSubnormals flushed;
        work(omp_get_thread_num());
    } catch (...) {
#pragma omp critical(clothsim_failure)
        failure = std::current_exception();
    }
    omp_set_dynamic(dynamic);
    if (failure) std::rethrow_exception(failure);
}

void pause_threads() { omp_pause_resource_all(omp_pause_soft); }

#else

int processors() { return std::max(1, int(std::thread::hardware_concurrency())); }
int available_threads() { return processors(); }
int granted_threads(int) { return 1; }
void run_team(int, const std::function<void(int)>& work) { work(0); }
void pause_threads() {}

#endif

void sleep_until(const std::atomic<int>& counter, int value) {
    while (!has_reached(counter, value)) std::this_thread::sleep_for(heuristics::sleep_of_waiting);
}

}  // namespace clothsim
