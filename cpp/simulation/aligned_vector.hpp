// Memory for SIMD: aligned to a cache line; large arrays to pages that few entries of the processor's address table cover.
#pragma once

#include <cstddef>
#include <new>
#include <vector>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace clothsim {

template <class T>
struct AlignedAllocator {
    using value_type = T;
    AlignedAllocator() = default;
    template <class U>
    AlignedAllocator(const AlignedAllocator<U>&) {}
    T* allocate(std::size_t n) {
        T* const p = static_cast<T*>(::operator new(n * sizeof(T), alignment(n)));
#if defined(__linux__)
        if (n * sizeof(T) >= large) madvise(p, n * sizeof(T), MADV_HUGEPAGE);  // a hint: its failure costs time only
#endif
        return p;
    }
    void deallocate(T* p, std::size_t n) { ::operator delete(p, alignment(n)); }

    static constexpr std::size_t huge_page = std::size_t(1) << 21, large = 2 * huge_page;
    static std::align_val_t alignment(std::size_t n) { return std::align_val_t(n * sizeof(T) >= large ? huge_page : 64); }
    friend bool operator==(const AlignedAllocator&, const AlignedAllocator&) { return true; }
};

template <class T>
using AlignedVector = std::vector<T, AlignedAllocator<T>>;

inline std::ptrdiff_t round_up(std::ptrdiff_t n, std::ptrdiff_t multiple) {
    return (n + multiple - 1) / multiple * multiple;
}

}  // namespace clothsim
