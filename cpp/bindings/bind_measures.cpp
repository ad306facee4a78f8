// Measures of a state, and the reference.
#include <optional>

#include "bindings/bindings.hpp"
#include "bindings/unlocked.hpp"
#include "measure/diagnostics.hpp"
#include "memory/plan.hpp"
#include "reference/reference.hpp"

namespace clothsim {

namespace {

py::array_t<ThreadId> thread_ids(int rows, int columns) {
    py::array_t<ThreadId> ids({py::ssize_t(rows), py::ssize_t(columns)});
    auto out = ids.mutable_unchecked<2>();
    for (int y = 0; y < rows; ++y)
        for (int x = 0; x < columns; ++x) out(y, x) = thread_id({columns, rows}, x, y);
    return ids;
}

}  // namespace

void bind_diagnostics(py::module_& m) {
    PYBIND11_NUMPY_DTYPE(ThreadId, group_x, group_y, thread_x, thread_y, dispatch_x, dispatch_y,
                         index);
    m.attr("group_size") = group_size;
    m.def("thread_ids", &thread_ids);
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
    m.def("largest_stretch", [](const Cloth& cloth, const Array<double>& x) {
        return largest_stretch(cloth, view(x));
    });
    m.def("penetration",
          [](int rows, int columns, const Array<double>& x, const Sphere& sphere, double t) {
              const Penetration p = penetration(rows, columns, view(x), sphere, t);
              return py::make_tuple(p.points, p.triangles);
          });
}

namespace {

py::tuple reference_step(const Plan& plan, const Array<double>& x, const Array<double>& v,
                         double dt, std::int64_t steps, double t, bool as_printed) {
    Points position = PointsView(x.data(), plan.cloth.points(), 3);
    Points velocity = PointsView(v.data(), plan.cloth.points(), 3);
    bool done = false;
    {
        Unlocked unlocked;
        done = reference::step(plan, position, velocity, dt, steps, t, as_printed,
                               [&] { return unlocked.signal_pending(); });
    }
    if (!done) throw py::error_already_set();
    const auto array = [&](const Points& p) {
        return py::array_t<double>(
            {py::ssize_t(plan.cloth.rows), py::ssize_t(plan.cloth.columns), py::ssize_t(3)},
            p.data());
    };
    return py::make_tuple(array(position), array(velocity));
}

// How far it came [s], and states of shape (times, rows, columns, 3).
py::tuple extrapolate(const Plan& plan, const Array<double>& x, const Array<double>& v,
                      const std::vector<double>& times, int columns, double tolerance,
                      int threads) {
    std::vector<double> xs(x.data(), x.data() + x.size()), vs(v.data(), v.data() + v.size());
    const std::size_t size = xs.size();
    threads = granted(threads);
    reference::Extrapolation done;
    {
        Unlocked unlocked;
        done = reference::extrapolate(plan, times, {columns, tolerance, threads}, xs, vs,
                                      [&] { return unlocked.signal_pending(); });
    }
    if (done.interrupted) throw py::error_already_set();
    const auto array = [&](const std::vector<double>& values) {  // without the initial state
        return py::array_t<double>({py::ssize_t(times.size()), py::ssize_t(plan.cloth.rows),
                                    py::ssize_t(plan.cloth.columns), py::ssize_t(3)},
                                   values.data() + size);
    };
    if (done.time < times.back()) return py::make_tuple(done.time, py::none(), py::none());
    return py::make_tuple(done.time, array(xs), array(vs));
}

}  // namespace

void bind_reference(py::module_& m) {
    m.def("reference_step", &reference_step);
    m.def("extrapolate", &extrapolate, "plan"_a, "x"_a, "v"_a, "times"_a, "columns"_a,
          "tolerance"_a, "threads"_a);
}

}  // namespace clothsim
