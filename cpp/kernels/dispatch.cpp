#include "kernels/kernel_table.hpp"

#include <cstdlib>
#include <stdexcept>
#include <xsimd/config/xsimd_cpuid.hpp>

namespace clothsim {
namespace {

bool processor_has(InstructionSet set) {
    const auto processor = xsimd::available_architectures();
    switch (set) {
        case InstructionSet::portable: break;  // built alone, for every processor
        case InstructionSet::sse2: return processor.sse2;
        case InstructionSet::avx2: return processor.fma3_avx2;
        case InstructionSet::avx512:
            return processor.avx512f && processor.avx512cd && processor.avx512dq &&
                processor.avx512bw;
    }
    return true;
}

}  // namespace

const std::vector<const KernelTable*>& built_instruction_sets() {
#if defined(CLOTHSIM_PORTABLE)
    static const std::vector<const KernelTable*> built{
        &KernelTableOf<InstructionSet::portable>::table};
#else
    static const std::vector<const KernelTable*> built{
        &KernelTableOf<InstructionSet::avx512>::table, &KernelTableOf<InstructionSet::avx2>::table,
        &KernelTableOf<InstructionSet::sse2>::table};
#endif
    return built;
}

std::vector<const KernelTable*> supported_instruction_sets() {
    std::vector<const KernelTable*> supported;
    for (const KernelTable* table : built_instruction_sets())
        if (processor_has(table->set)) supported.push_back(table);
    return supported;
}

const KernelTable& choose_instruction_set() {
    const std::string wanted = kernel_environment();
    const auto supported = supported_instruction_sets();
    if (wanted.empty()) return *supported.front();
    std::string accepted;
    for (const KernelTable* table : supported) {
        if (table->name == wanted) return *table;
        accepted += (accepted.empty() ? "" : ", ") + std::string(table->name);
    }
    throw std::invalid_argument("CLOTHSIM_ISA is '" + wanted +
                                "'; this processor runs, of those built: " + accepted);
}

std::string kernel_environment() {
    const char* const value = std::getenv("CLOTHSIM_ISA");
    return value ? value : "";
}

}  // namespace clothsim
