// Functions that the compiler vectorises: one version for every instruction set, chosen when the
// library is loaded. None of them fuses or reorders. They must be in an anonymous namespace. If a
// header declares one without the attribute, clang 14 compiles the first version alone, for every
// processor. If a header declares one with it, other files call none.
#pragma once

#if defined(__x86_64__) && defined(__linux__)
#define CLOTHSIM_VERSIONS __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define CLOTHSIM_VERSIONS
#endif
