// Plain work over an array, in a part for each thread.
#pragma once

#include <cstddef>

#include "memory/threads.hpp"

namespace clothsim {

// `work(begin, end, part)` for `parts` parts of [0, count) of about equal size.
template <class Work>
void in_parts(std::ptrdiff_t count, int parts, Work work) {
    in_team(parts, [&](int thread, int team) {
        for (int s = thread; s < parts; s += team) work(count * s / parts, count * (s + 1) / parts, s);
    });
}

}  // namespace clothsim
