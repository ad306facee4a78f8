// Scenes, measures of a state, and the reference.
#include <pybind11/eigen.h>
#include <algorithm>
#include <map>
#include <optional>

#include "bindings/bindings.hpp"
#include "bindings/unlocked.hpp"
#include "contact/offset.hpp"
#include "contact/triangle.hpp"
#include "engines/engine.hpp"
#include "integrators/methods.hpp"
#include "measure/diagnostics.hpp"
#include "measure/mode_bounds.hpp"
#include "memory/plan.hpp"
#include "model/thread_grid.hpp"
#include "reference/extrapolation.hpp"
#include "reference/reference.hpp"

namespace clothsim {
namespace {

PointsView view(const Array<double>& a) { return {a.data(), a.size() / 3, 3}; }

using FamilyValues = std::map<std::string, double>;

Cloth make_cloth(int rows, int columns, double row_spacing, double column_spacing,
                 const FamilyValues& stiffness, const FamilyValues& spring_damping, double drag,
                 const Array<double>& mass, bool uniform_mass, const Array<bool>& pinned) {
    Cloth cloth;
    cloth.rows = rows;
    cloth.columns = columns;
    cloth.row_spacing = row_spacing;
    cloth.column_spacing = column_spacing;
    for (int f = 0; f < family_count; ++f) {
        const auto found = stiffness.find(family_names[f]);
        cloth.present[f] = found != stiffness.end();
        if (!cloth.present[f]) continue;
        cloth.stiffness[f] = found->second;
        const auto damping = spring_damping.find(family_names[f]);
        cloth.spring_damping[f] = damping == spring_damping.end() ? 0 : damping->second;
    }
    cloth.drag = drag;
    cloth.uniform_mass = uniform_mass;
    if (mass.size() != cloth.points() || pinned.size() != cloth.points())
        throw std::invalid_argument("mass and pinned hold one value per mass point");
    cloth.mass = {mass.data(), std::size_t(mass.size())};
    cloth.pinned = {pinned.data(), std::size_t(pinned.size())};
    return cloth;
}

Sphere make_sphere(const Vec3& center, double radius, double contact_radius, const std::string& response,
                   bool as_printed, double restitution, double friction, const Motion& motion, bool faces,
                   bool cells, double push_out_speed) {
    const auto name = std::find(response_names.begin(), response_names.end(), response);
    if (name == response_names.end()) throw std::invalid_argument("no response has the name " + response);
    return {.center = center,
            .radius = radius,
            .contact_radius = contact_radius,
            .restitution = restitution,
            .friction = friction,
            .response = Response(name - response_names.begin()),
            .as_printed = as_printed,
            .faces = faces,
            .cells = cells,
            .push_out_speed = push_out_speed,
            .motion = motion};
}

using PinValues = std::vector<std::tuple<int, Vec3, int>>;

std::vector<DrivenPin> pins_of(const PinValues& values) {
    std::vector<DrivenPin> pins;
    for (const auto& [point, start, motion] : values) pins.push_back({point, start, motion});
    return pins;
}

Plan make_plan(const Cloth& cloth, const Vec3& gravity, std::vector<Sphere> spheres,
               const std::optional<Array<double>>& force, std::vector<Motion> pin_motions,
               const PinValues& driven_pins, const std::string& precision, const std::string& kernel,
               bool strict, const std::string& instruction_set, const std::string& integrator) {
    Plan plan;
    plan.cloth = cloth;
    plan.gravity = gravity;
    plan.spheres = std::move(spheres);
    if (force) plan.force = view(*force);
    plan.pin_motions = std::move(pin_motions);
    plan.driven_pins = pins_of(driven_pins);
    plan.precision = precision == "single" ? Precision::single : Precision::double_;
    plan.kernel = kernel == "gather" ? Kernel::gather : Kernel::edge;
    plan.strict = strict;
    plan.kernels = &choose_instruction_set(instruction_set);
    plan.integrator = integrator;
    return plan;
}

// Centre and velocity of every sphere at every time, shape (times, spheres, 6): what another backend than the
// core's own needs for its collision passes.
Array<double> sphere_states(const Plan& plan, const std::vector<double>& times) {
    Array<double> states({py::ssize_t(times.size()), py::ssize_t(plan.spheres.size()), py::ssize_t(6)});
    double* next = states.mutable_data();
    for (const double t : times)
        for (const Sphere& sphere : plan.spheres)
            for (const Vec3& part : {sphere.center_at(t), sphere.velocity_at(t)})
                next = std::copy_n(part.data(), 3, next);
    return states;
}

// Vectors times a number, added to a vector, in a step of an explicit method.
std::ptrdiff_t updates(const ExplicitMethod& method) {
    const auto terms = [](const std::vector<double>& row) {
        return std::ptrdiff_t(row.size()) - std::count(row.begin(), row.end(), 0.0);
    };
    const auto of = [&](const Weights& w) { return (w.drift != 0) + terms(w.x) + terms(w.v); };
    std::ptrdiff_t sum = of(method.result);
    for (const Weights& weights : method.stage) sum += of(weights);
    return sum;
}

std::ptrdiff_t updates(const Splitting& method) {
    const auto terms = [](const std::vector<double>& parts) {
        return std::ptrdiff_t(parts.size()) - std::count(parts.begin(), parts.end(), 0.0);
    };
    return terms(method.drifts) + terms(method.kicks);
}

py::tuple rows_of(const ExplicitMethod& method) {
    py::list rows;
    for (const Weights& w : method.stage) rows.append(py::make_tuple(w.drift, w.x, w.v));
    rows.append(py::make_tuple(method.result.drift, method.result.x, method.result.v));
    return py::tuple(rows);
}

// Families and coefficients of all methods, for Python's theory of stability and its count of operations.
py::dict methods() {
    py::dict all;
    for (const Method& method : all_methods()) {
        py::dict facts;
        facts["family"] = method_family_names[std::size_t(method.family)];
        facts["in_kernels"] = method.in_kernels;
        facts["adaptive"] = method.runge_kutta && !method.runge_kutta->errors.empty();
        std::size_t stages = 1;
        py::object once = py::none();
        if (const ExplicitMethod* const rk = method.runge_kutta) {
            stages = std::size_t(rk->stages);
            facts["order"] = rk->order;
            facts["tableau"] = rk->a;
            once = py::int_(updates(*rk));
        } else if (const Splitting* const parts = method.splitting) {
            stages = parts->kicks.size() - parts->first_same_as_last();
            facts["splitting"] = py::make_tuple(parts->drifts, parts->kicks);
            once = py::int_(updates(*parts));
        }
        facts["stages"] = stages;
        facts["stages_damped"] = method.damped ? std::size_t(method.damped->stages) : stages;
        if (method.damped) facts["damped"] = rows_of(*method.damped);
        facts["updates"] = py::make_tuple(once, method.damped ? py::int_(updates(*method.damped)) : once);
        all[py::str(std::string(method.name))] = facts;
    }
    return all;
}

template <class Real>
int lanes(const Plan& plan) {
    return kernels_of<Real>(*plan.kernels).lanes;
}

}  // namespace

void bind_model(py::module_& m) {
    py::class_<Cloth>(m, "Cloth")
        .def(py::init(&make_cloth), py::kw_only(), "rows"_a, "columns"_a, "row_spacing"_a, "column_spacing"_a,
             "stiffness"_a, "spring_damping"_a, "drag"_a, "mass"_a, "uniform_mass"_a, "pinned"_a)
        .def_property_readonly("mode_bounds", [](const Cloth& cloth) {
            const ModeBounds bounds = mode_bounds(cloth);
            return std::make_pair(bounds.stiffness, bounds.damping);
        });
    py::class_<Motion>(m, "Motion")
        .def(py::init<>())
        .def_static(
            "linear",
            [](const Vec3& velocity) { return Motion{.kind = Motion::Kind::linear, .velocity = velocity}; })
        .def_static(
            "reciprocate",
            [](const Vec3& direction, double distance, double period, double deceleration, double phase) {
                return Motion{.kind = Motion::Kind::reciprocate,
                              .direction = direction,
                              .distance = distance,
                              .period = period,
                              .deceleration = deceleration,
                              .phase = phase};
            })
        .def_static("keyframes", [](std::vector<double> times, std::vector<Vec3> centers, bool relative) {
            return Motion{.kind = Motion::Kind::keyframes,
                          .times = std::move(times),
                          .centers = std::move(centers),
                          .relative = relative};
        });
    py::class_<Sphere>(m, "Sphere")
        .def(py::init(&make_sphere), py::kw_only(), "center"_a, "radius"_a, "contact_radius"_a, "response"_a,
             "as_printed"_a, "restitution"_a, "friction"_a, "motion"_a, "faces"_a = false, "cells"_a = false,
             "push_out_speed"_a = 1.0)
        .def("center_at", &Sphere::center_at)
        .def("velocity_at", &Sphere::velocity_at);
    py::class_<Plan>(m, "Plan")
        .def(py::init(&make_plan), py::kw_only(), "cloth"_a, "gravity"_a, "spheres"_a, "force"_a,
             "pin_motions"_a, "driven_pins"_a, "precision"_a, "kernel"_a, "strict"_a, "instruction_set"_a,
             "integrator"_a)
        .def_readonly("cloth", &Plan::cloth)
        .def("sphere_states", &sphere_states)
        .def("runaway_speed",
             [](const Plan& p, double dt, double stable_dt) { return runaway_speed(p.cloth, dt, stable_dt); })
        .def_property_readonly("instruction_set", [](const Plan& p) { return std::string(p.kernels->name); })
        .def_property_readonly("lanes", [](const Plan& p) {
            return p.precision == Precision::single ? lanes<float>(p) : lanes<double>(p);
        });
    m.def("edge_offset", &edge_offset);
    m.def("methods", &methods);
    m.def("add_splitting",
          [](const std::string& name, const std::vector<double>& drifts, const std::vector<double>& kicks) {
              add_splitting(name, {drifts, kicks});
          });
}

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
    m.def("triangle_touches",
          [](const Array<double>& p0, const Array<double>& p1, double reach, double tolerance) {
              const py::ssize_t count = p0.size() / 9;
              py::array_t<double> times(count);
              double* const out = times.mutable_data();
              const auto corners = [](const double* p) { return Corners{Vec3(p), Vec3(p + 3), Vec3(p + 6)}; };
              for (py::ssize_t i = 0; i < count; ++i) {
                  const TriangleTouch t = triangle_touch(corners(p0.data() + 9 * i),
                                                         corners(p1.data() + 9 * i), reach, tolerance);
                  out[i] = t.hit ? t.time : std::numeric_limits<double>::quiet_NaN();
              }
              return times;
          });
    m.def("penetration",
          [](int rows, int columns, const Array<double>& x, const Vec3& center, double radius) {
              const Penetration p = penetration(rows, columns, view(x), center, radius);
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
