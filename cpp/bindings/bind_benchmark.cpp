#include "benchmark/limits.hpp"
#include "bindings/bindings.hpp"
#include "kernels/dispatch.hpp"

namespace clothsim {
namespace {

double peak(const std::string& precision, int threads) {
    const KernelTable& kernels = choose_instruction_set("");
    py::gil_scoped_release release;
    return precision == "single" ? multiply_add_peak<float>(kernels, threads)
                                 : multiply_add_peak<double>(kernels, threads);
}

py::dict bandwidth(int threads, std::int64_t bytes) {
    Bandwidth measured{};
    {
        const KernelTable& kernels = choose_instruction_set("");
        py::gil_scoped_release release;
        measured = memory_bandwidth<double>(kernels, threads, bytes);
    }
    py::dict result;
    result["update"] = measured.update;
    result["triad"] = measured.triad;
    return result;
}

double round_trip() {
    py::gil_scoped_release release;
    return core_round_trip();
}

}  // namespace

void bind_benchmark(py::module_& m) {
    m.def("multiply_add_peak", &peak, py::arg("precision"), py::arg("threads"));
    m.def("memory_bandwidth", &bandwidth, py::arg("threads"), py::arg("bytes"));
    m.def("core_round_trip", &round_trip);
}

}  // namespace clothsim
