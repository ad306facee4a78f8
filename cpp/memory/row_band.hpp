// A cloth's rows among threads, and how they ask for memory ahead.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "memory/heuristics.hpp"

namespace clothsim {

// Rows [begin, end) of a cloth in the order in which a thread goes through them.
struct RowBand {
    int begin = 0;
    int end = 0;
    bool upwards = false;

    // Returns one of `count` bands of a cloth; those of even number go up.
    static RowBand of(int rows, int number, int count) {
        const auto border = [&](int n) { return int(std::int64_t(rows) * n / count); };
        return {border(number), border(number + 1), count > 1 && number % 2 == 0};
    }
    // Returns how many of these threads have work enough.
    static int team(int rows, int threads) {
        return std::clamp(rows / heuristics::rows_per_thread, 1, threads);
    }
    int size() const { return end - begin; }
    // Returns the cloth's row number of row i of the band. i may be negative, for rows before the
    // first, or lie behind the last.
    int row(int i) const { return upwards ? end - 1 - i : begin + i; }
    // Returns the cloth's rows [first, second) that are the band's rows [from, to).
    std::pair<int, int> rows(int from, int to) const {
        if (upwards) return {end - to, end - from};
        return {begin + from, begin + to};
    }
};

// The first prefetches a line before it is read, into the second-level cache, as requests to the
// first would delay other loads. The second prefetches a line before it is written: a line that
// another processor has read would delay the store. g++ takes a function with nothing but the
// builtin for a function without effect, and drops it.
inline void prefetch_to_read(const void* p) {
#if defined(__x86_64__)
    asm volatile("prefetcht1 %0" : : "m"(*static_cast<const char*>(p)));
#else
    __builtin_prefetch(p, 0, 2);
#endif
}
inline void prefetch_to_write(const void* p) {
#if defined(__x86_64__)
    asm volatile("prefetchw %0" : : "m"(*static_cast<const char*>(p)));
#else
    __builtin_prefetch(p, 1);
#endif
}

// Calls `ask(line)` for the cache lines of `count` elements.
template <class Real, class Ask>
void for_each_line(const Real* first, std::ptrdiff_t count, const Ask& ask) {
    constexpr int line = 64 / int(sizeof(Real));
    for (std::ptrdiff_t i = 0; i < count; i += line) ask(first + i);
}

}  // namespace clothsim
