// The instruction sets for which the kernels are compiled.
#pragma once

namespace clothsim {

enum class InstructionSet { sse2,
                            avx2,
                            avx512 };

}  // namespace clothsim
