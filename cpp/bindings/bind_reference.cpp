#include "bindings/bindings.hpp"
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

}  // namespace

void bind_reference(py::module_& m) {
    m.def("reference_step", &advance<reference::step>);
    m.def("reference_step_as_printed", &advance<reference::step_as_printed>);
}

}  // namespace clothsim
