#include "memory/row_copies.hpp"

#if defined(__SSE2__)
#include <emmintrin.h>
#endif
#include <algorithm>
#include <cstdint>
#include <cstring>

namespace clothsim {

void copy_past_caches(const void* from, void* to, std::size_t bytes) {
#if defined(__SSE2__)
    constexpr std::size_t size = sizeof(__m128i);
    const char* next = static_cast<const char*>(from);
    char* place = static_cast<char*>(to);
    const auto copy = [&](std::size_t count) {
        std::memcpy(place, next, count);
        next += count, place += count, bytes -= count;
    };
    copy(std::min(bytes, -reinterpret_cast<std::uintptr_t>(place) % size));
    for (; bytes >= size; next += size, place += size, bytes -= size)
        _mm_stream_si128(reinterpret_cast<__m128i*>(place),
                         _mm_loadu_si128(reinterpret_cast<const __m128i*>(next)));
    copy(bytes);
    _mm_sfence();
#else
    std::memcpy(to, from, bytes);
#endif
}

}  // namespace clothsim
