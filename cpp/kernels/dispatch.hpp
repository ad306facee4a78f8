// Which instruction sets were built, which of them this processor has, and which one is used.
#pragma once

#include <string>
#include <vector>

#include "kernels/contact/face_kernels.hpp"
#include "kernels/kernel_table.hpp"
#include "kernels/state_row_kernels.hpp"

namespace clothsim {

// Best first.
const std::vector<const KernelTable*>& built_instruction_sets();
std::vector<const KernelTable*> supported_instruction_sets();

// `name` empty: the environment variable CLOTHSIM_ISA, else the best supported one. Throws
// std::invalid_argument for a name that is not built or not supported.
const KernelTable& choose_instruction_set(const std::string& name);

// The kernels that move a state in and out.
const StateRowKernels& state_row_kernels(InstructionSet set);

// The kernels of contact of faces.
const FaceKernels& face_kernels(InstructionSet set);

// Environment variables that may choose other kernels for the next engine.
std::string kernel_environment();

// Where the edge kernel's rows of two vectors keep the forces for the next row (edge_two_vectors.hpp). The
// environment variable CLOTHSIM_FORWARD says "registers" or "memory"; the default is faster on this
// processor. The bits are the same. Throws std::invalid_argument for another word.
bool forwards_in_registers();

}  // namespace clothsim
