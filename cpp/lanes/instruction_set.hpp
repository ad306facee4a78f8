#pragma once

namespace clothsim {

// `portable` is built alone, on processors that are not x86-64: xsimd's NEON on AArch64, else plain
// loops over 16 bytes.
enum class InstructionSet { portable, sse2, avx2, avx512 };

}  // namespace clothsim
