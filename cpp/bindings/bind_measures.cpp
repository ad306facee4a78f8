// Measures of a state, and the reference.
#include <algorithm>
#include <array>
#include <optional>

#include "bindings/bindings.hpp"
#include "bindings/unlocked.hpp"
#include "measure/diagnostics.hpp"
#include "memory/plan.hpp"
#include "memory/threads.hpp"
#include "reference/reference.hpp"

namespace clothsim {

void bind_measures(py::module_& m) {
    m.def("energy", [](const Plan& plan, const Array<double>& x, const Array<double>& v, double t) {
        const Energy e = energy(plan, view(x), view(v), t);
        return py::make_tuple(e.kinetic, e.elastic, e.gravity, e.force, e.contact);
    });
    // It returns minus the derivatives of contact by x and by v, of shape (points, 3, 3) each.
    m.def("contact_derivatives",
          [](const Plan& plan, const Array<double>& x, const Array<double>& v, double t) {
              const py::ssize_t points = plan.cloth.points();
              std::array<Array<double>, 2> all;
              for (auto& blocks : all) {
                  blocks = Array<double>({points, py::ssize_t(3), py::ssize_t(3)});
                  std::fill_n(blocks.mutable_data(), 9 * points, 0.0);
              }
              const PointsView velocities = view(v);
              const PointsView places = view(x);
              each_contact(plan, t, each_free_of(plan.cloth, places),
                           [&](std::size_t, const PenaltyContact& contact, int i, const auto&) {
                               const auto d = contact.derivatives(Vec3(places.row(i)),
                                                                  Vec3(velocities.row(i)));
                               for (int k = 0; k < 9; ++k) {
                                   all[0].mutable_data()[9 * i + k] += d.by_x.data()[k];
                                   all[1].mutable_data()[9 * i + k] += d.by_v.data()[k];
                               }
                           });
              return py::make_tuple(all[0], all[1]);
          });
    m.def("contact_depths", [](const Plan& plan, const Array<double>& x, double t) {
        std::vector<std::pair<double, int>> all;
        for (const Depth& d : contact_depths(plan, t, each_free_of(plan.cloth, view(x))))
            all.emplace_back(d.depth, d.point);
        return all;
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

// Return how far it came [s], and states of shape (times, rows, columns, 3).
py::tuple extrapolate(const Plan& plan, const Array<double>& x, const Array<double>& v,
                      const std::vector<double>& times, int columns, double tolerance,
                      int threads) {
    std::vector<double> xs(x.data(), x.data() + x.size()), vs(v.data(), v.data() + v.size());
    const std::size_t size = xs.size();
    threads = granted_threads(threads);
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
