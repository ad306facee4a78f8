// Functions that the compiler vectorises: one version for every instruction set, chosen when the library is
// loaded; none of them fuses or reorders. They must be in an anonymous namespace: of one that a header has
// declared without the attribute, clang 14 compiles the first version alone, for every processor, and of one
// declared with it other files call none.
#pragma once

#if defined(__x86_64__) && defined(__linux__)
#define CLOTHSIM_VERSIONS __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define CLOTHSIM_VERSIONS
#endif
