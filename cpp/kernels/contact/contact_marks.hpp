// Marks that the kernel of continuous contact leaves at a vector (ContactArguments::open).
#pragma once

#include <cstdint>

namespace clothsim {

// The vector still has to go to `before`; the kernel has responded to one of its points.
inline constexpr std::uint8_t vector_unresolved = 1, vector_responded = 2;

}  // namespace clothsim
