#include "kernels/dispatch.hpp"

#include <cstdlib>
#include <stdexcept>

namespace clothsim {

extern const KernelTable kernels_avx512, kernels_avx2, kernels_sse2;

const std::vector<const KernelTable*>& built_instruction_sets() {
    static const std::vector<const KernelTable*> built{&kernels_avx512, &kernels_avx2, &kernels_sse2};
    return built;
}

std::vector<const KernelTable*> supported_instruction_sets() {
    std::vector<const KernelTable*> supported;
    for (const KernelTable* table : built_instruction_sets())
        if (table->supported()) supported.push_back(table);
    return supported;
}

const KernelTable& choose_instruction_set(const std::string& name) {
    const char* environment = std::getenv("CLOTHSIM_ISA");
    const std::string wanted = !name.empty() ? name : environment ? environment : "";
    const auto supported = supported_instruction_sets();
    if (wanted.empty()) return *supported.front();
    std::string accepted;
    for (const KernelTable* table : supported) {
        if (table->name == wanted) return *table;
        accepted += (accepted.empty() ? "" : ", ") + std::string(table->name);
    }
    throw std::invalid_argument((name.empty() ? "CLOTHSIM_ISA" : "instruction_set") + (" is '" + wanted) +
                                "'; this processor runs, of those built: " + accepted);
}

}  // namespace clothsim
