// Whether numbers are finite, as fast as they can be read.
#pragma once

#include <cstddef>

namespace clothsim {

// Blocks of `size` elements, `stride` from one to the next; a block is a multiple of `bytes_of_blocks`.
struct Blocks {
    std::ptrdiff_t count, size, stride;
};
inline constexpr int bytes_of_blocks = 32;  // a vector of AVX2

template <class Real>
bool all_finite(const Real* p, const Blocks& blocks);

}  // namespace clothsim
