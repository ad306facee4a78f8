// Scenes and methods.
#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <optional>

#include "bindings/bindings.hpp"
#include "bindings/unlocked.hpp"
#include "driver/energy_watch.hpp"
#include "engines/coefficients.hpp"
#include "forces/function.hpp"
#include "forces/penalty.hpp"
#include "forces/table.hpp"
#include "integrators/methods.hpp"
#include "measure/diagnostics.hpp"
#include "memory/plan.hpp"
#include "responses/paper.hpp"

namespace clothsim {
namespace {

constexpr std::size_t contact_values = 28;  // of an obstacle in `contact_table`

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
        const auto entry = stiffness.find(family_names[f]);
        cloth.present[f] = entry != stiffness.end();
        if (!cloth.present[f]) continue;
        cloth.stiffness[f] = entry->second;
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

// `pieces` has the members of a MotionPiece one after the other, piece by piece.
Motion make_motion(const Array<double>& pieces, double period, double phase, bool relative) {
    Motion motion{.period = period, .phase = phase, .relative = relative};
    motion.pieces.resize(std::size_t(pieces.nbytes()) / sizeof(MotionPiece));
    std::copy_n(pieces.data(), pieces.size(), reinterpret_cast<double*>(motion.pieces.data()));
    return motion;
}

// Return displacement and velocity at every time, shape (times, 6).
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
                   const Vec3& normal, double thickness, double stiffness, double dissipation,
                   double slip_speed, double speed) {
    const auto name = std::find(response_names.begin(), response_names.end(), response);
    if (name == response_names.end())
        throw std::invalid_argument("no response has the name " + response);
    return {.center = center,
            .radius = radius,
            .offset = offset,
            .restitution = restitution,
            .friction = friction,
            .response = Response(name - response_names.begin()),
            .thickness = thickness,
            .stiffness = stiffness,
            .dissipation = dissipation,
            .slip_speed = slip_speed,
            .speed = speed,
            .as_printed = as_printed,
            .motion = motion,
            .normal = normal};
}

Plan make_plan(const Cloth& cloth, const Vec3& gravity, std::vector<Sphere> spheres,
               const std::optional<Array<double>>& force, std::vector<Motion> pin_motions,
               const PinValues& driven_pins, std::vector<std::shared_ptr<const Force>> forces,
               const std::string& precision, const std::string& kernel,
               const std::string& integrator) {
    Plan plan;
    plan.forces = std::move(forces);
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

// The last copy may go where the lock of the interpreter is not held.
std::shared_ptr<py::object> kept_object(py::object object) {
    return {new py::object(std::move(object)), [](py::object* last) {
                const py::gil_scoped_acquire lock;
                delete last;
            }};
}

// `function(t, x, v)` returns a C-contiguous float64 array of the shape of x.
FunctionForce::Function python_function(py::object function, const Cloth& cloth) {
    const std::shared_ptr<py::object> owner_of_function = kept_object(std::move(function));
    const std::array<py::ssize_t, 3> shape{cloth.rows, cloth.columns, 3};
    return [owner_of_function, shape](double t, const double* x, const double* v, double* f,
                                      std::int64_t points) {
        const Unlocked::Locked lock;
        const auto array = [&](const double* values) {
            py::array_t<double> copy(shape, values);
            copy.attr("flags").attr("writeable") = false;
            return copy;
        };
        const auto force = (*owner_of_function)(t, array(x), array(v)).cast<Array<double>>();
        std::copy_n(force.data(), 3 * points, f);
    };
}

// `address` is that of a function void(double t, const double* x, const double* v, double* f,
// int64_t points), with `data` as a last argument where there is some.
FunctionForce::Function c_function(std::uintptr_t address, std::optional<std::uintptr_t> data) {
    if (data)
        return [address, data = *data](double t, const double* x, const double* v, double* f,
                                       std::int64_t points) {
            using Function =
                void(double, const double*, const double*, double*, std::int64_t, void*);
            reinterpret_cast<Function*>(address)(t, x, v, f, points, reinterpret_cast<void*>(data));
        };
    using Function = void(double, const double*, const double*, double*, std::int64_t);
    return reinterpret_cast<Function*>(address);
}

Plan with_force(Plan plan, FunctionForce::Function function, bool forces_need_caller) {
    plan.forces.push_back(std::make_shared<FunctionForce>(std::move(function), forces_need_caller));
    return plan;
}

// Return the blocks of Force::each_damping: mass points, of shape (n, 2), and blocks, of shape
// (n, 3, 3).
py::tuple damping_blocks(const Force& force, const Cloth& cloth, const Array<double>& x,
                         const Array<double>& v, double t) {
    std::vector<std::int64_t> points;
    std::vector<double> blocks;
    force.each_damping(cloth, {StageTime::at_rest(t), x.data(), v.data()},
                       [&](int i, int j, const Eigen::Matrix3d& block) {
                           points.insert(points.end(), {i, j});
                           blocks.insert(blocks.end(), block.data(), block.data() + 9);
                       });
    const py::ssize_t count = py::ssize_t(points.size()) / 2;
    return py::make_tuple(
        py::array_t<std::int64_t>({count, py::ssize_t(2)}, points.data()),
        py::array_t<double>({count, py::ssize_t(3), py::ssize_t(3)}, blocks.data()));
}

// Append a penalty obstacle in the step from t on, as gpu/shaders/penalty.wgsl takes it.
void append_penalty_values(std::vector<double>& values, const Sphere& s, double t, double dt,
                           const Vec3& origin, double unit) {
    const auto append = [&](const Vec3& v) { values.insert(values.end(), v.begin(), v.end()); };
    for (const double part : {0.0, 0.5, 1.0}) {
        const StageTime time = StageTime::of_stage(t, dt, part);
        append(s.surface_at(time, origin).place);
        append(s.velocity_at(time));
    }
    append(s.normal);
    values.insert(values.end(),
                  {1 / s.radius, s.reach(), unit * s.stiffness / (s.thickness * s.thickness),
                   s.dissipation, s.friction, s.slip_speed * s.slip_speed, 2 * s.thickness});
}

// Append an obstacle with a response of the paper after the step that ends at the time t, as
// gpu/shaders/contact.wgsl takes it but for the rounded part of its place.
void append_response_values(std::vector<double>& values, const Sphere& sphere, const Cloth& cloth,
                            double t, double dt, const Vec3& origin, bool single) {
    const Contact contact(sphere, t, dt, origin);
    const NearLevel near(contact, cloth, single ? 0x1p-23 : 0x1p-52);
    const Surface& surface = contact.surface;
    for (const Vec3& vector : {surface.place, contact.velocity, surface.normal})
        values.insert(values.end(), vector.begin(), vector.end());
    values.insert(values.end(),
                  {surface.curvature, contact.top, sphere.restitution, sphere.friction, near.level,
                   near.curvature});
}

// Return every obstacle at every time, shape (times, obstacles, values). Positions are relative to
// `origin`; `normals` are those of the surface points of penalty obstacles.
Array<double> contact_table(const Plan& plan, const std::vector<double>& times, const Vec3& origin,
                            const std::vector<Vec3>& normals, double dt, bool single) {
    std::vector<double> values;
    for (std::size_t i = 0; i < times.size(); ++i)
        for (std::size_t k = 0; k < plan.spheres.size(); ++k) {
            Sphere sphere = plan.spheres[k];
            if (sphere.penalty()) {
                sphere.normal = normals[k];
                append_penalty_values(values, sphere, times[i], dt, origin,
                                      coefficient_scale(plan));
            } else {
                append_response_values(values, sphere, plan.cloth, times[i], dt, origin, single);
            }
            values.resize((i * plan.spheres.size() + k + 1) * contact_values);
        }
    Array<double> table({times.size(), plan.spheres.size(), contact_values});
    std::copy(values.begin(), values.end(), table.mutable_data());
    return table;
}

// Return the normals of the obstacles, those of penalty spheres towards a place, as StateEngine
// does.
std::vector<Vec3> normals_towards(const Plan& plan, const Vec3& place, const Vec3& origin,
                                  double t) {
    std::vector<Vec3> normals;
    for (const Sphere& sphere : plan.spheres)
        normals.push_back(sphere.penalty() ? normal_towards(sphere, place, t, origin)
                                           : sphere.normal);
    return normals;
}

py::tuple rows_of_tableau(const ExplicitMethod& method) {
    py::list rows;
    for (const Weights& w : method.stage) rows.append(py::make_tuple(w.drift, w.x, w.v));
    rows.append(py::make_tuple(method.result.drift, method.result.x, method.result.v));
    return py::tuple(rows);
}

// Return families and coefficients of all methods, for Python's theory of stability.
py::dict methods() {
    py::dict all;
    for (const Method& method : all_methods()) {
        py::dict facts;
        facts["family"] = method.runge_kutta ? "runge_kutta"
            : method.splitting               ? "splitting"
            : method.stabilised              ? "stabilised"
                                             : "implicit";
        facts["in_kernels"] = method.in_kernels;
        facts["adaptive"] =
            method.stabilised || (method.runge_kutta && !method.runge_kutta->errors.empty());
        std::size_t stages = 1;
        if (const ExplicitMethod* const rk = method.runge_kutta) {
            stages = std::size_t(rk->stages);
            facts["order"] = rk->order;
            facts["tableau"] = rk->a;
        } else if (const Splitting* const parts = method.splitting) {
            stages = parts->kicks.size() - parts->first_same_as_last();
            facts["splitting"] = py::make_tuple(parts->drifts, parts->kicks);
        }
        if (method.stabilised) {
            facts["order"] = 2;
            stages = 2;
        }
        facts["stages"] = stages;
        facts["stages_damped"] = method.damped ? std::size_t(method.damped->stages) : stages;
        if (method.damped) facts["damped"] = rows_of_tableau(*method.damped);
        all[py::str(std::string(method.name))] = facts;
    }
    return all;
}

py::array_t<ThreadId> thread_ids(int rows, int columns) {
    py::array_t<ThreadId> ids({py::ssize_t(rows), py::ssize_t(columns)});
    auto out = ids.mutable_unchecked<2>();
    for (int y = 0; y < rows; ++y)
        for (int x = 0; x < columns; ++x) out(y, x) = thread_id({columns, rows}, x, y);
    return ids;
}

}  // namespace

void bind_model(py::module_& m) {
    PYBIND11_NUMPY_DTYPE(ThreadId, group_x, group_y, thread_x, thread_y, dispatch_x, dispatch_y,
                         index);
    m.attr("group_size") = group_size;
    m.def("thread_ids", &thread_ids);
    py::class_<Cloth>(m, "Cloth")
        .def(py::init(&make_cloth), py::kw_only(), "rows"_a, "columns"_a, "row_spacing"_a,
             "column_spacing"_a, "stiffness"_a, "spring_damping"_a, "drag"_a, "mass"_a,
             "uniform_mass"_a, "pinned"_a);
    py::class_<Motion>(m, "Motion")
        .def(py::init<>())
        .def(py::init(&make_motion), "pieces"_a, "period"_a, "phase"_a, "relative"_a)
        .def("states", &motion_states);
    py::class_<Sphere>(m, "Sphere")
        .def(py::init(&make_sphere), py::kw_only(), "center"_a, "radius"_a, "offset"_a,
             "response"_a, "as_printed"_a, "restitution"_a, "friction"_a, "motion"_a, "normal"_a,
             "thickness"_a = 0.0, "stiffness"_a = 0.0, "dissipation"_a = 0.0, "slip_speed"_a = 0.0,
             "speed"_a = 0.0)
        .def_readonly("normal", &Sphere::normal)
        .def("center_at", py::overload_cast<double>(&Sphere::center_at, py::const_))
        .def("velocity_at", [](const Sphere& s, double t) { return s.velocity_at(t); });
    py::class_<Force, std::shared_ptr<Force>>(m, "Force")
        .def(py::init([](const std::string& name, std::vector<double> values, Motion motion) {
            return std::const_pointer_cast<Force>(
                make_force(name, std::move(values), std::move(motion)));
        }))
        .def("damping_bound",
             [](const Force& force, const Cloth& cloth) { return force.damping_bound(cloth, 0); })
        .def_readonly("name", &Force::name)
        .def("damping_blocks", &damping_blocks);
    py::class_<Plan>(m, "Plan")
        .def(py::init(&make_plan), py::kw_only(), "cloth"_a, "gravity"_a, "spheres"_a, "force"_a,
             "pin_motions"_a, "driven_pins"_a, "forces"_a, "precision"_a, "kernel"_a,
             "integrator"_a)
        .def("with_python_force",
             [](const Plan& plan, py::object function) {
                 return with_force(plan, python_function(std::move(function), plan.cloth), true);
             })
        .def(
            "with_c_force",
            [](const Plan& plan, std::uintptr_t address, std::optional<std::uintptr_t> data,
               py::object owner, std::optional<double> fixed_time) {
                return with_force(
                    plan,
                    [function = c_function(address, data), fixed_time,
                     owner_of_function = kept_object(std::move(owner))](
                        double t, const double* x, const double* v, double* f,
                        std::int64_t points) { function(fixed_time.value_or(t), x, v, f, points); },
                    false);
            })
        .def("contact_table", &contact_table)
        .def("normals_towards", &normals_towards)
        .def("runaway_speed",
             [](const Plan& p, double dt, double stable_dt) {
                 return runaway_speed(p.cloth, dt, stable_dt);
             })
        .def_property_readonly("instruction_set",
                               [](const Plan& p) { return std::string(p.kernels->name); });
    m.def("edge_offset", &edge_offset);
    // They lie above every squared frequency [1/s^2] and damping rate [1/s] of springs and forces.
    m.def("mode_bounds", [](const Cloth& cloth, const std::vector<std::shared_ptr<Force>>& forces) {
        ModeBounds bounds = mode_bounds(cloth);
        for (const auto& force : forces) bounds.damping += force->damping_bound(cloth, 0);
        return std::make_pair(bounds.stiffness, bounds.damping);
    });
    // It returns signature, address and user data of a capsule, as scipy.LowLevelCallable has them.
    m.def("capsule_facts", [](const py::capsule& capsule) {
        const char* const signature = PyCapsule_GetName(capsule.ptr());
        return py::make_tuple(signature ? signature : "",
                              std::uintptr_t(PyCapsule_GetPointer(capsule.ptr(), signature)),
                              std::uintptr_t(PyCapsule_GetContext(capsule.ptr())));
    });
    m.def("methods", &methods);
}

}  // namespace clothsim
