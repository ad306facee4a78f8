// Plain work over an array, in a part for each thread.
#pragma once

#include <cstddef>

#include "memory/threads.hpp"

namespace clothsim {

// `work(begin, end, part)` for `parts` parts of [0, count) of about equal size. It must not throw.
template <class Work>
void in_parts(std::ptrdiff_t count, int parts, Work work) {
    if (parts == 1) return work(0, count, 0);  // a region of one thread costs as much as a small cloth's copy
#pragma omp parallel for num_threads(team_for(parts)) schedule(static, 1)
    for (int s = 0; s < parts; ++s) work(count * s / parts, count * (s + 1) / parts, s);
}

}  // namespace clothsim
