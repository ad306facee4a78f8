// Limits of this machine: arithmetic, memory, and messages between two cores. For the bench.
#pragma once

#include "kernels/kernel_table.hpp"

namespace clothsim {

// Multiply-adds of all threads together [flop/s], a multiply-add being two; the best of several windows.
template <class Real>
double multiply_add_peak(const KernelTable& kernels, int threads);

struct Bandwidth {
    double update, triad;  // B/s as read and written by the code
};

// All threads together, each over arrays of its own that fill `bytes` in all; the best of several windows.
template <class Real>
Bandwidth memory_bandwidth(const KernelTable& kernels, int threads, std::int64_t bytes);

// A message to another thread and back through two flags [s]: the best of several windows.
double core_round_trip();

}  // namespace clothsim
