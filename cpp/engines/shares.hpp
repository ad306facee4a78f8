// Plain work over an array, shared among threads.
#pragma once

#include <cstddef>

namespace clothsim {

// `work(begin, end, share)` of each of `shares` about equal shares of [0, count). It must not throw.
template <class Work>
void in_shares(std::ptrdiff_t count, int shares, Work work) {
    if (shares == 1) return work(0, count, 0);  // a region of one thread costs as much as a small cloth's copy
#pragma omp parallel for num_threads(shares) schedule(static, 1)
    for (int s = 0; s < shares; ++s) work(count * s / shares, count * (s + 1) / shares, s);
}

}  // namespace clothsim
