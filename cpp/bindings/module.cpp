#include "bindings/bindings.hpp"
#include "simulation/threads.hpp"

PYBIND11_MODULE(_core, m) {
    m.doc() = "The compiled core of clothsim. Private: the public names are those of the package.";
    clothsim::install_fork_handler();
    clothsim::bind_benchmark(m);
    clothsim::bind_build(m);
    clothsim::bind_model(m);
    clothsim::bind_simulation(m);
    clothsim::bind_diagnostics(m);
    clothsim::bind_reference(m);
}
