// The module, and how it was built.
#include <atomic>
#include <Eigen/Core>
#include <string>
#include <xsimd/config/xsimd_config.hpp>

#include "bindings/bindings.hpp"
#include "driver/energy_watch.hpp"
#include "driver/simulation.hpp"
#include "kernels/kernel_table.hpp"
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
    facts["version"] = CLOTHSIM_VERSION;
    facts["compiler"] = CLOTHSIM_COMPILER;
    facts["build_type"] = CLOTHSIM_BUILD_TYPE;
    facts["flags"] = CLOTHSIM_FLAGS;
    facts["kernel_flags"] = flags;
    facts["instruction_sets_built"] = built;
    facts["instruction_sets_supported"] = supported;
    facts["eigen"] = version(EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION);
    facts["xsimd"] = version(XSIMD_VERSION_MAJOR, XSIMD_VERSION_MINOR, XSIMD_VERSION_PATCH);
    return facts;
}

}  // namespace

int granted(int threads) {
    const int given = granted_threads(threads);
    static std::atomic<bool> warned{false};
    if (given < threads && !warned.exchange(true)) {
        const std::string text = "threads: this process can start " + std::to_string(given) +
            " of " + std::to_string(threads) +
            " threads, and goes on with these; results are the same. The limit is the "
            "user's (ulimit -u), the container's (pids), or that of memory; threads=1 needs no "
            "further "
            "thread";
        if (PyErr_WarnEx(PyExc_RuntimeWarning, text.c_str(), 1) != 0) throw py::error_already_set();
    }
    return given;
}

void bind_build(py::module_& m) {
    m.def("build_facts", &build_facts);
    m.def("choose_instruction_set", [] { return std::string(choose_instruction_set().name); });
    m.def("granted_threads", &granted, "threads"_a);
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
    m.attr("extents_that_are_far") = extents_that_are_far;
}

}  // namespace clothsim

// Simulations lock themselves against use by two threads; the rest keeps no state that calls
// change.
PYBIND11_MODULE(_core, m, py::mod_gil_not_used()) {
    m.doc() = "The compiled core of clothsim. Private: the public names are those of the package.";
    if (const auto os = py::module_::import("os"); py::hasattr(os, "register_at_fork"))
        os.attr("register_at_fork")("after_in_child"_a =
                                        py::cpp_function(&clothsim::forget_workers));
    clothsim::bind_build(m);
    clothsim::bind_model(m);
    clothsim::bind_picture(m);
    clothsim::bind_simulation(m);
    clothsim::bind_diagnostics(m);
    clothsim::bind_reference(m);
}
