// Scenes and methods.
#include <algorithm>
#include <map>
#include <optional>

#include "bindings/bindings.hpp"
#include "contact/continuous.hpp"
#include "driver/energy_watch.hpp"
#include "integrators/methods.hpp"
#include "measure/diagnostics.hpp"
#include "memory/plan.hpp"

namespace clothsim {
namespace {

constexpr int contact_values = 23;  // of `contact_table`

using FamilyValues = std::map<std::string, double>;
using PinValues = std::vector<std::tuple<int, Vec3, int>>;

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
    const auto copy = [](const auto& values) {
        using T = std::decay_t<decltype(*values.data())>;
        const std::shared_ptr<T[]> copied(new T[std::size_t(values.size())]);
        std::copy_n(values.data(), values.size(), copied.get());
        return copied;
    };
    cloth.mass = copy(mass);
    cloth.pinned = copy(pinned);
    return cloth;
}

// `pieces`: the members of a MotionPiece one after the other, piece by piece.
Motion make_motion(const Array<double>& pieces, double period, double phase, bool relative) {
    Motion motion{.period = period, .phase = phase, .relative = relative};
    motion.pieces.resize(std::size_t(pieces.nbytes()) / sizeof(MotionPiece));
    std::copy_n(pieces.data(), pieces.size(), reinterpret_cast<double*>(motion.pieces.data()));
    return motion;
}

// Displacement and velocity at every time, shape (times, 6).
Array<double> motion_states(const Motion& motion, const Array<double>& times) {
    Array<double> states({times.size(), py::ssize_t(6)});
    double* next = states.mutable_data();
    for (py::ssize_t k = 0; k < times.size(); ++k) {
        const MotionState state = motion.at(times.data()[k]);
        for (const Vec3& part : {state.displacement, state.velocity})
            next = std::copy_n(part.data(), 3, next);
    }
    return states;
}

Sphere make_sphere(const Vec3& center, double radius, double offset, const std::string& response,
                   bool as_printed, double restitution, double friction, const Motion& motion,
                   bool cells, double push_out_speed, const Vec3& normal, double spread) {
    const auto name = std::find(response_names.begin(), response_names.end(), response);
    if (name == response_names.end())
        throw std::invalid_argument("no response has the name " + response);
    return {.center = center,
            .radius = radius,
            .offset = offset,
            .restitution = restitution,
            .friction = friction,
            .response = Response(name - response_names.begin()),
            .as_printed = as_printed,
            .cells = cells,
            .push_out_speed = push_out_speed,
            .motion = motion,
            .normal = normal,
            .spread = spread};
}

Plan make_plan(const Cloth& cloth, const Vec3& gravity, std::vector<Sphere> spheres,
               const std::optional<Array<double>>& force, std::vector<Motion> pin_motions,
               const PinValues& driven_pins, const std::string& precision,
               const std::string& kernel, const std::string& integrator) {
    Plan plan;
    plan.cloth = cloth;
    plan.gravity = gravity;
    plan.spheres = std::move(spheres);
    if (force) plan.force = view(*force);
    plan.pin_motions = std::move(pin_motions);
    for (const auto& [point, start, motion] : driven_pins)
        plan.driven_pins.push_back({point, start, motion});
    plan.precision = precision == "single" ? Precision::single : Precision::double_;
    plan.kernel = kernel == "gather" ? Kernel::gather : Kernel::edge;
    plan.kernels = &choose_instruction_set();
    plan.integrator = integrator;
    return plan;
}

// Every sphere at every time, shape (times, spheres, values), as the shader takes it
// (gpu/shaders/contact.wgsl) but for the rounded part of its place. `origin`: of the positions.
Array<double> contact_table(const Plan& plan, const std::vector<double>& times, const Vec3& origin,
                            double dt, bool single) {
    const double rounding = single ? 0x1p-23 : 0x1p-52,
                 of_cells = single ? cell_rounding<float> : cell_rounding<double>;
    std::vector<double> values;
    for (std::size_t i = 0; i < times.size(); ++i)
        for (Sphere sphere : plan.spheres) {
            sphere.origin = origin;
            const bool path = sphere.response == Response::continuous;
            const double t0 = path && i > 0 ? times[i - 1] : times[i];
            SweptSphere s =
                swept(sphere, plan.cloth, t0, times[i], dt, path ? rounding : 0, single);
            if (!path) Eigen::Map<Vec3>(s.velocity) = sphere.velocity_at(times[i]);
            for (const auto* vector : {&s.end, &s.velocity, &s.normal})
                values.insert(values.end(), std::begin(*vector), std::end(*vector));
            values.insert(values.end(),
                          {s.curvature, s.least, s.innermost, s.band, s.tolerance, s.most_of_cells,
                           s.restitution, s.friction, s.push, s.dt, s.near_level, s.near_curvature,
                           s.curvature * of_cells, 1 + ContactBand::excess});
        }
    const py::ssize_t rows = py::ssize_t(times.size()), spheres = py::ssize_t(plan.spheres.size());
    Array<double> table({rows, spheres, py::ssize_t(contact_values)});
    std::copy(values.begin(), values.end(), table.mutable_data());
    return table;
}

py::tuple rows_of(const ExplicitMethod& method) {
    py::list rows;
    for (const Weights& w : method.stage) rows.append(py::make_tuple(w.drift, w.x, w.v));
    rows.append(py::make_tuple(method.result.drift, method.result.x, method.result.v));
    return py::tuple(rows);
}

// Families and coefficients of all methods, for Python's theory of stability.
py::dict methods() {
    py::dict all;
    for (const Method& method : all_methods()) {
        py::dict facts;
        facts["family"] = method.runge_kutta ? "runge_kutta"
            : method.splitting               ? "splitting"
                                             : "implicit";
        facts["in_kernels"] = method.in_kernels;
        facts["adaptive"] = method.runge_kutta && !method.runge_kutta->errors.empty();
        std::size_t stages = 1;
        if (const ExplicitMethod* const rk = method.runge_kutta) {
            stages = std::size_t(rk->stages);
            facts["order"] = rk->order;
            facts["tableau"] = rk->a;
        } else if (const Splitting* const parts = method.splitting) {
            stages = parts->kicks.size() - parts->first_same_as_last();
            facts["splitting"] = py::make_tuple(parts->drifts, parts->kicks);
        }
        facts["stages"] = stages;
        facts["stages_damped"] = method.damped ? std::size_t(method.damped->stages) : stages;
        if (method.damped) facts["damped"] = rows_of(*method.damped);
        all[py::str(std::string(method.name))] = facts;
    }
    return all;
}

}  // namespace

void bind_model(py::module_& m) {
    py::class_<Cloth>(m, "Cloth")
        .def(py::init(&make_cloth), py::kw_only(), "rows"_a, "columns"_a, "row_spacing"_a,
             "column_spacing"_a, "stiffness"_a, "spring_damping"_a, "drag"_a, "mass"_a,
             "uniform_mass"_a, "pinned"_a)
        .def_property_readonly("mode_bounds", [](const Cloth& cloth) {
            const ModeBounds bounds = mode_bounds(cloth);
            return std::make_pair(bounds.stiffness, bounds.damping);
        });
    py::class_<Motion>(m, "Motion")
        .def(py::init<>())
        .def(py::init(&make_motion), "pieces"_a, "period"_a, "phase"_a, "relative"_a)
        .def("states", &motion_states);
    py::class_<Sphere>(m, "Sphere")
        .def(py::init(&make_sphere), py::kw_only(), "center"_a, "radius"_a, "offset"_a,
             "response"_a, "as_printed"_a, "restitution"_a, "friction"_a, "motion"_a, "cells"_a,
             "push_out_speed"_a, "normal"_a, "spread"_a = 1.0)
        .def_readonly("normal", &Sphere::normal)
        .def_readonly("spread", &Sphere::spread)
        .def("center_at", &Sphere::center_at)
        .def("velocity_at", &Sphere::velocity_at);
    py::class_<Plan>(m, "Plan")
        .def(py::init(&make_plan), py::kw_only(), "cloth"_a, "gravity"_a, "spheres"_a, "force"_a,
             "pin_motions"_a, "driven_pins"_a, "precision"_a, "kernel"_a, "integrator"_a)
        .def("contact_table", &contact_table)
        .def("runaway_speed",
             [](const Plan& p, double dt, double stable_dt) {
                 return runaway_speed(p.cloth, dt, stable_dt);
             })
        .def_property_readonly("instruction_set",
                               [](const Plan& p) { return std::string(p.kernels->name); });
    m.def("edge_offset", &edge_offset);
    m.def("methods", &methods);
}

}  // namespace clothsim
