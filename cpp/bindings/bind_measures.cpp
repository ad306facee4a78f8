// Measures of a state, and the reference.
#include <optional>

#include "bindings/bindings.hpp"
#include "bindings/unlocked.hpp"
#include "bindings/views.hpp"
#include "measure/diagnostics.hpp"
#include "memory/plan.hpp"
#include "model/thread_grid.hpp"
#include "reference/extrapolation.hpp"
#include "reference/reference.hpp"

namespace clothsim {
namespace {

py::array_t<ThreadId> thread_ids(int rows, int columns) {
    const ThreadGrid grid{columns, rows};
    py::array_t<ThreadId> ids({py::ssize_t(rows), py::ssize_t(columns)});
    auto out = ids.mutable_unchecked<2>();
    for (int y = 0; y < rows; ++y)
        for (int x = 0; x < columns; ++x) out(y, x) = thread_id(grid, x, y);
    return ids;
}

}  // namespace

void bind_diagnostics(py::module_& m) {
    PYBIND11_NUMPY_DTYPE(ThreadId, group_x, group_y, thread_x, thread_y, dispatch_x, dispatch_y, index);
    m.attr("group_size") = group_size;
    m.def("thread_ids", &thread_ids);
    m.def("triangles", &triangles);
    m.def("energy",
          [](const Cloth& cloth, const Vec3& gravity, const std::optional<Array<double>>& force,
             const Array<double>& x, const Array<double>& v) {
              Scene scene;
              scene.cloth = cloth;
              scene.gravity = gravity;
              if (force) scene.force = view(*force);
              const Energy e = energy(scene, view(x), view(v));
              return py::make_tuple(e.kinetic, e.elastic, e.gravity, e.force);
          });
    m.def("largest_stretch",
          [](const Cloth& cloth, const Array<double>& x) { return largest_stretch(cloth, view(x)); });
    m.def("penetration", [](int rows, int columns, const Array<double>& x, const Sphere& sphere, double t) {
        const Penetration p = penetration(rows, columns, view(x), sphere, t);
        return py::make_tuple(p.points, p.triangles);
    });
}

namespace {

template <auto step>
py::tuple advance(const Plan& plan, const Array<double>& x, const Array<double>& v, double dt,
                  std::int64_t steps, double t) {
    Points position = PointsView(x.data(), plan.cloth.points(), 3);
    Points velocity = PointsView(v.data(), plan.cloth.points(), 3);
    {
        const Unlocked unlocked;
        step(plan, position, velocity, dt, steps, t);
    }
    const auto array = [&](const Points& p) {
        return py::array_t<double>(
            {py::ssize_t(plan.cloth.rows), py::ssize_t(plan.cloth.columns), py::ssize_t(3)}, p.data());
    };
    return py::make_tuple(array(position), array(velocity));
}

// The springs come as the columns of Cloth.spring_table: the core's own table of neighbours is not asked.
py::dict extrapolate(const Array<std::int64_t>& i, const Array<std::int64_t>& j,
                     const Array<double>& rest_length, const Array<double>& stiffness,
                     const Array<double>& damping, const Array<double>& mass, const Array<bool>& pinned,
                     const std::array<double, 3>& gravity, double drag, const Array<double>& force,
                     std::vector<Motion> pin_motions, const PinValues& driven_pins, const Array<double>& x,
                     const Array<double>& v, const std::vector<double>& times, int columns, double tolerance,
                     int threads) {
    reference::System system;
    for (py::ssize_t k = 0; k < i.size(); ++k)
        system.springs.push_back(
            {int(i.at(k)), int(j.at(k)), rest_length.at(k), stiffness.at(k), damping.at(k)});
    system.mass.assign(mass.data(), mass.data() + mass.size());
    system.pinned.assign(pinned.data(), pinned.data() + pinned.size());
    system.gravity = gravity;
    system.drag = drag;
    system.force.assign(force.data(), force.data() + force.size());
    system.pin_motions = std::move(pin_motions);
    system.driven_pins = pins_of(driven_pins);
    std::vector<double> xs(x.data(), x.data() + x.size()), vs(v.data(), v.data() + v.size());
    const std::size_t size = xs.size();
    threads = granted(threads);
    reference::Extrapolation done;
    {
        Unlocked unlocked;
        done = reference::extrapolate(system, times, {columns, tolerance, threads}, xs, vs,
                                      [&] { return unlocked.signal_pending(); });
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
    m.def("extrapolate", &extrapolate, py::kw_only(), "i"_a, "j"_a, "rest_length"_a, "stiffness"_a,
          "damping"_a, "mass"_a, "pinned"_a, "gravity"_a, "drag"_a, "force"_a, "pin_motions"_a,
          "driven_pins"_a, "x"_a, "v"_a, "times"_a, "columns"_a, "tolerance"_a, "threads"_a);
}

}  // namespace clothsim
