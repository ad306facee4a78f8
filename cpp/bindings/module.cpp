// The module, and how it was built.
#include <Eigen/Core>
#include <string>
#include <xsimd/config/xsimd_config.hpp>

#include "bindings/bindings.hpp"
#include "bindings/version.hpp"
#include "kernels/kernel_table.hpp"
#include "memory/heuristics.hpp"
#include "memory/threads.hpp"

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
    for (const KernelTable* table : supported_instruction_sets())
        supported.append(std::string(table->name));
    py::dict facts;
    facts["version"] = package_version;
    facts["compiler"] = CLOTHSIM_COMPILER;
    facts["build_type"] = CLOTHSIM_BUILD_TYPE;
    facts["flags"] = CLOTHSIM_FLAGS;
    facts["kernel_flags"] = flags;
    facts["instruction_sets_built"] = built;
    facts["instruction_sets_supported"] = supported;
    facts["eigen"] = version(EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION);
    facts["xsimd"] = version(XSIMD_VERSION_MAJOR, XSIMD_VERSION_MINOR, XSIMD_VERSION_PATCH);
#ifdef _OPENMP
    facts["openmp"] = CLOTHSIM_OPENMP;
#else
    facts["openmp"] = py::none();
#endif
    return facts;
}

}  // namespace

void bind_build(py::module_& m) {
    m.def("build_facts", &build_facts);
    m.def("choose_instruction_set", [] { return std::string(choose_instruction_set().name); });
    m.def("processors", &processors);
    m.def("available_threads", &available_threads);
    m.def("granted_threads", &granted_threads, "threads"_a);
    m.attr("most_threads") = most_threads;
    // Constants of the core that Python needs too.
    py::list kinds;
    for (const Neighbour& n : spring_kinds)
        kinds.append(py::make_tuple(family_names[n.family], n.row, n.column));
    m.attr("spring_kinds") = py::tuple(kinds);
    py::list ends;
    for (const MirroredNeighbour& n : neighbours)
        ends.append(py::make_tuple(n.row, n.column, family_names[n.family], int(n.kind)));
    m.attr("neighbours") = py::tuple(ends);
    m.attr("heuristics") =
        py::dict("points_of_team"_a = heuristics::points_of_team,
                 "points_per_thread_of_step"_a = heuristics::points_per_thread_of_step,
                 "points_per_thread_of_response"_a = heuristics::points_per_thread_of_response,
                 "rows_per_thread"_a = heuristics::rows_per_thread,
                 "bytes_in_shared_cache"_a = heuristics::bytes_in_shared_cache,
                 "steps_of_block"_a = heuristics::steps_of_block,
                 "steps_of_short_block"_a = heuristics::steps_of_short_block,
                 "negligible_step"_a = heuristics::negligible_step,
                 "negligible_depth"_a = heuristics::negligible_depth,
                 "extents_that_are_far"_a = heuristics::extents_that_are_far);
}

}  // namespace clothsim

// Simulations lock themselves against use by two threads; the rest keeps no state that calls
// change.
PYBIND11_MODULE(_core, m, py::mod_gil_not_used()) {
    m.doc() = "The compiled core of clothsim. Private: the public names are those of the package.";
    if (const auto os = py::module_::import("os"); py::hasattr(os, "register_at_fork"))
        os.attr("register_at_fork")("before"_a = py::cpp_function(&clothsim::pause_threads));
    clothsim::bind_build(m);
    clothsim::bind_model(m);
    clothsim::bind_picture(m);
    clothsim::bind_simulation(m);
    clothsim::bind_measures(m);
    clothsim::bind_reference(m);
}
