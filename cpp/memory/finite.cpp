#include "memory/finite.hpp"

#include <cstdint>

#include "memory/versions.hpp"

namespace clothsim {
namespace {

// Without the sign a number that is not finite has an exponent of ones; one more carries into the sign.
template <class Bits, int mantissa, class Real>
inline __attribute__((always_inline)) bool finite(const Real* p, const Blocks& blocks) {
    typedef Bits Vector __attribute__((vector_size(bytes_of_blocks)));
    typedef Bits Unaligned __attribute__((vector_size(bytes_of_blocks), aligned(sizeof(Real)), may_alias));
    constexpr Bits sign = Bits(1) << (8 * sizeof(Bits) - 1), one = Bits(1) << mantissa;
    constexpr int lanes = bytes_of_blocks / int(sizeof(Real));
    Vector overflow{};
    for (std::ptrdiff_t b = 0; b < blocks.count; ++b)
        for (std::ptrdiff_t i = 0; i < blocks.size; i += lanes)
            overflow |= (*reinterpret_cast<const Unaligned*>(p + b * blocks.stride + i) & ~sign) + one;
    Bits any = 0;
    for (int l = 0; l < lanes; ++l) any |= overflow[l];
    return (any & sign) == 0;
}

CLOTHSIM_VERSIONS bool versions(const float* p, const Blocks& blocks) {
    return finite<std::uint32_t, 23>(p, blocks);
}
CLOTHSIM_VERSIONS bool versions(const double* p, const Blocks& blocks) {
    return finite<std::uint64_t, 52>(p, blocks);
}

}  // namespace

template <class Real>
bool all_finite(const Real* p, const Blocks& blocks) {
    return versions(p, blocks);
}
template bool all_finite(const float*, const Blocks&);
template bool all_finite(const double*, const Blocks&);

}  // namespace clothsim
