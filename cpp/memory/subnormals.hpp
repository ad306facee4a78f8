// Subnormal numbers, which take processors 100 cycles or more, as zero.
#pragma once

#if defined(__x86_64__)
#include <xmmintrin.h>
#elif defined(__aarch64__)
#include <cstdint>
#endif

namespace clothsim {

// While this object lives, its thread reads and writes subnormal numbers as zero.
class FlushSubnormals {
public:
#if defined(__x86_64__)
    FlushSubnormals() : before_(_mm_getcsr()) { _mm_setcsr(before_ | results | operands); }
    ~FlushSubnormals() { _mm_setcsr(before_); }
#elif defined(__aarch64__)
    FlushSubnormals() {
        asm volatile("mrs %0, fpcr" : "=r"(before_));
        asm volatile("msr fpcr, %0" : : "r"(before_ | both));
    }
    ~FlushSubnormals() { asm volatile("msr fpcr, %0" : : "r"(before_)); }
#else
    FlushSubnormals() {}
#endif
    FlushSubnormals(const FlushSubnormals&) = delete;
    FlushSubnormals& operator=(const FlushSubnormals&) = delete;

private:
#if defined(__x86_64__)
    static constexpr unsigned results = 0x8000;  // FTZ
    static constexpr unsigned operands = 0x40;   // DAZ
    unsigned before_;
#elif defined(__aarch64__)
    static constexpr std::uint64_t both = std::uint64_t(1) << 24;  // FZ
    std::uint64_t before_;
#endif
};

}  // namespace clothsim
