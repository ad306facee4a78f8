#include "bindings/bindings.hpp"
#include "reference/extrapolation.hpp"
#include "reference/reference.hpp"

namespace clothsim {
namespace {

template <auto step>
py::tuple advance(const Plan& plan, const Array<double>& x, const Array<double>& v, double dt, std::int64_t steps,
                  double t) {
    Points position = PointsView(x.data(), plan.cloth.points(), 3);
    Points velocity = PointsView(v.data(), plan.cloth.points(), 3);
    {
        py::gil_scoped_release release;
        step(plan, position, velocity, dt, steps, t);
    }
    const auto array = [&](const Points& p) {
        return py::array_t<double>({py::ssize_t(plan.cloth.rows), py::ssize_t(plan.cloth.columns), py::ssize_t(3)},
                                   p.data());
    };
    return py::make_tuple(array(position), array(velocity));
}

bool signal_pending() {
    py::gil_scoped_acquire gil;
    return PyErr_CheckSignals() != 0;
}

// The springs come as the columns of Cloth.spring_table: the core's own table of neighbours is not asked.
py::dict extrapolate(const Array<std::int64_t>& i, const Array<std::int64_t>& j, const Array<double>& rest_length,
                     const Array<double>& stiffness, const Array<double>& damping, const Array<double>& mass,
                     const Array<bool>& pinned, const std::array<double, 3>& gravity, double point_damping,
                     const Array<double>& x, const Array<double>& v, const std::vector<double>& times, int columns,
                     double tolerance, int threads) {
    reference::System system;
    for (py::ssize_t k = 0; k < i.size(); ++k)
        system.springs.push_back({int(i.at(k)), int(j.at(k)), rest_length.at(k), stiffness.at(k), damping.at(k)});
    system.mass.assign(mass.data(), mass.data() + mass.size());
    system.pinned.assign(pinned.data(), pinned.data() + pinned.size());
    system.gravity = gravity;
    system.point_damping = point_damping;
    std::vector<double> xs(x.data(), x.data() + x.size()), vs(v.data(), v.data() + v.size());
    const std::size_t size = xs.size();
    reference::Extrapolation done;
    {
        py::gil_scoped_release release;
        done = reference::extrapolate(system, times, {columns, tolerance, threads}, xs, vs, signal_pending);
    }
    if (done.end == reference::ExtrapolationEnd::interrupted) throw py::error_already_set();
    py::dict result;
    result["reached"] = done.end == reference::ExtrapolationEnd::reached;
    result["time"] = done.time;
    result["steps"] = done.steps;
    result["rejected"] = done.rejected;
    result["force_evaluations"] = done.force_evaluations;
    const auto array = [&](const std::vector<double>& values) {  // without the initial state
        return py::array_t<double>(py::ssize_t(values.size() - size), values.data() + size);
    };
    result["x"] = array(xs);
    result["v"] = array(vs);
    return result;
}

}  // namespace

void bind_reference(py::module_& m) {
    m.def("reference_step", &advance<reference::step>);
    m.def("reference_step_as_printed", &advance<reference::step_as_printed>);
    m.def("extrapolate", &extrapolate, py::kw_only(), py::arg("i"), py::arg("j"), py::arg("rest_length"),
          py::arg("stiffness"), py::arg("damping"), py::arg("mass"), py::arg("pinned"), py::arg("gravity"),
          py::arg("point_damping"), py::arg("x"), py::arg("v"), py::arg("times"), py::arg("columns"),
          py::arg("tolerance"), py::arg("threads"));
}

}  // namespace clothsim
