// Which instruction sets were built, which of them this processor has, and which one is used.
#pragma once

#include <string>
#include <vector>

#include "kernels/kernel_table.hpp"

namespace clothsim {

// Best first.
const std::vector<const KernelTable*>& built_instruction_sets();
std::vector<const KernelTable*> supported_instruction_sets();

// `name` empty: the environment variable CLOTHSIM_ISA, else the best supported one. Throws
// std::invalid_argument for a name that is not built or not supported.
const KernelTable& choose_instruction_set(const std::string& name);

// The environment variable that chooses the kernels of the next engine.
std::string kernel_environment();

}  // namespace clothsim
