// How much of a cloth stays near a processor.
#pragma once

#include <algorithm>
#include <cstddef>

#if __has_include(<unistd.h>)
#include <unistd.h>
#endif

namespace clothsim {

inline constexpr std::ptrdiff_t megabyte = 1024 * 1024;

// Bytes of a processor's second-level cache: 1 MiB where the system does not report it. It is at
// most 2 MiB, since some processors share a larger cache.
inline std::ptrdiff_t second_level_cache() {
    static const std::ptrdiff_t bytes = [] {
        std::ptrdiff_t reported = 0;
#if defined(_SC_LEVEL2_CACHE_SIZE)
        reported = sysconf(_SC_LEVEL2_CACHE_SIZE);
#endif
        return reported > 0 ? std::clamp(reported, megabyte / 4, 2 * megabyte) : megabyte;
    }();
    return bytes;
}

// Working set of a strip of a wide cloth: two thirds of the second-level cache. Where that is below
// 1 MiB, strips are as wide as for 1 MiB. Using the third-level cache too costs less than the
// columns that narrow strips compute twice.
inline std::ptrdiff_t bytes_under_way() { return std::max(second_level_cache(), megabyte) / 3 * 2; }

// Largest working set of a sweep: a band's state and work are swept stage by stage, and rows need
// not be fetched ahead.
inline std::ptrdiff_t bytes_kept_in_cache() { return second_level_cache() / 4 * 3; }

// More than this comes from memory each time it is gone over.
inline constexpr std::ptrdiff_t bytes_in_shared_cache = 4 * megabyte;

}  // namespace clothsim
