// How much of a cloth stays near a processor.
#pragma once

#include <algorithm>
#include <cstddef>

#if __has_include(<unistd.h>)
#include <unistd.h>
#endif

#include "memory/heuristics.hpp"

namespace clothsim {

// Returns the bytes of a processor's second-level cache.
inline std::ptrdiff_t second_level_cache() {
    using namespace heuristics;
    static const std::ptrdiff_t bytes = [] {
        std::ptrdiff_t reported = 0;
#if defined(_SC_LEVEL2_CACHE_SIZE)
        reported = sysconf(_SC_LEVEL2_CACHE_SIZE);
#endif
        return reported > 0 ? std::clamp(reported, least_cache, most_cache) : default_cache;
    }();
    return bytes;
}

// Returns the bytes of the working set of a strip of a wide cloth.
inline std::ptrdiff_t bytes_under_way() {
    return std::max(second_level_cache(), heuristics::default_cache) / 3 *
        heuristics::thirds_of_cache_for_strip;
}

// Returns the bytes of the largest working set of a band whose state and work are swept stage by
// stage.
inline std::ptrdiff_t bytes_kept_in_cache() {
    return second_level_cache() / 4 * heuristics::quarters_of_cache_for_sweep;
}

}  // namespace clothsim
