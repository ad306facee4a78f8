// Functions that the compiler vectorises: one version for every instruction set, chosen when the library is loaded.
#pragma once

#if defined(__x86_64__) && defined(__linux__)
#define CLOTHSIM_VERSIONS __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define CLOTHSIM_VERSIONS
#endif
