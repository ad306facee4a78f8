// Memory for SIMD: aligned to a cache line, and in large pages where there is much of it. A sweep
// through a large cloth touches more pages at a time than the processor's table of pages holds.
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
        const std::size_t bytes = n * sizeof(T);
        void* const p = ::operator new(bytes, alignment(bytes));
#if defined(__linux__)
        if (bytes >= large_page)
            madvise(p, bytes / large_page * large_page, MADV_HUGEPAGE);  // may be refused
#endif
        return static_cast<T*>(p);
    }
    void deallocate(T* p, std::size_t n) { ::operator delete(p, alignment(n * sizeof(T))); }
    friend bool operator==(const AlignedAllocator&, const AlignedAllocator&) { return true; }

private:
    static constexpr std::size_t large_page = 2 * 1024 * 1024;  // bytes, on x86-64 Linux
    static std::align_val_t alignment(std::size_t bytes) {
        return std::align_val_t(bytes < large_page ? 64 : large_page);
    }
};

template <class T>
using AlignedVector = std::vector<T, AlignedAllocator<T>>;

inline std::ptrdiff_t round_up(std::ptrdiff_t n, std::ptrdiff_t multiple) {
    return (n + multiple - 1) / multiple * multiple;
}

}  // namespace clothsim
