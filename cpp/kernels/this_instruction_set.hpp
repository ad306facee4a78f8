// The instruction set for which a file is compiled.
#pragma once

#include "kernels/instruction_set.hpp"
#include "kernels/lanes.hpp"

namespace clothsim {
namespace {

#if defined(CLOTHSIM_PORTABLE)
#if XSIMD_WITH_NEON64
using ThisArch = xsimd::neon64;
#else
using ThisArch = xsimd::emulated<128>;
#endif
inline constexpr InstructionSet this_instruction_set = InstructionSet::portable;
#elif defined(__AVX512F__)
using ThisArch = xsimd::avx512bw;
inline constexpr InstructionSet this_instruction_set = InstructionSet::avx512;
#elif defined(__AVX2__)
using ThisArch = xsimd::fma3<xsimd::avx2>;
inline constexpr InstructionSet this_instruction_set = InstructionSet::avx2;
#else
using ThisArch = xsimd::sse2;
inline constexpr InstructionSet this_instruction_set = InstructionSet::sse2;
#endif

}  // namespace
}  // namespace clothsim
