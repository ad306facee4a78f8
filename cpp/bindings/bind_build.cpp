#include <Eigen/Core>
#include <xsimd/config/xsimd_config.hpp>

#include "bindings/bindings.hpp"
#include "kernels/dispatch.hpp"
#include "simulation/threads.hpp"

namespace clothsim {
namespace {

std::string version(int major, int minor, int patch) {
    return std::to_string(major) + "." + std::to_string(minor) + "." + std::to_string(patch);
}

py::dict build_facts() {
    py::dict flags;
    py::list built, supported;
    for (const KernelTable* table : built_instruction_sets()) {
        built.append(std::string(table->name));
        flags[py::str(std::string(table->name))] = std::string(table->flags);
    }
    for (const KernelTable* table : supported_instruction_sets()) supported.append(std::string(table->name));
    py::dict facts;
    facts["version"] = CLOTHSIM_VERSION;
    facts["compiler"] = CLOTHSIM_COMPILER;
    facts["build_type"] = CLOTHSIM_BUILD_TYPE;
    facts["flags"] = CLOTHSIM_FLAGS;
    facts["kernel_flags"] = flags;
    facts["instruction_sets_built"] = built;
    facts["instruction_sets_supported"] = supported;
    facts["eigen"] = version(EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION);
    facts["xsimd"] = version(XSIMD_VERSION_MAJOR, XSIMD_VERSION_MINOR, XSIMD_VERSION_PATCH);
    facts["openmp"] = _OPENMP;
    return facts;
}

}  // namespace

void bind_build(py::module_& m) {
    m.def("build_facts", &build_facts);
    m.def("choose_instruction_set",
          [](const std::string& name) { return std::string(choose_instruction_set(name).name); });
    m.def("available_threads", &available_threads);
    m.attr("most_threads") = most_threads;
}

}  // namespace clothsim
