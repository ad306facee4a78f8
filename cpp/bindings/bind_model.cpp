#include <algorithm>
#include <map>
#include <pybind11/eigen.h>

#include "bindings/bindings.hpp"
#include "collision/offset.hpp"
#include "simulation/engine.hpp"
#include "simulation/stability.hpp"

namespace clothsim {
namespace {

using FamilyValues = std::map<std::string, double>;

Cloth make_cloth(int rows, int columns, double row_spacing, double column_spacing, const FamilyValues& stiffness,
                 const FamilyValues& spring_damping, double point_damping, const Array<double>& mass,
                 bool uniform_mass, const Array<bool>& pinned) {
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
    cloth.point_damping = point_damping;
    cloth.uniform_mass = uniform_mass;
    if (mass.size() != cloth.points() || pinned.size() != cloth.points())
        throw std::invalid_argument("mass and pinned hold one value per mass point");
    cloth.mass = {mass.data(), std::size_t(mass.size())};
    cloth.pinned = {pinned.data(), std::size_t(pinned.size())};
    return cloth;
}

Motion reciprocate(const Vec3& direction, double distance, double period, double deceleration, double phase) {
    Motion m;
    m.kind = Motion::Kind::reciprocate;
    m.direction = direction;
    m.distance = distance;
    m.period = period;
    m.deceleration = deceleration;
    m.phase = phase;
    return m;
}

Motion linear(const Vec3& velocity) {
    Motion m;
    m.kind = Motion::Kind::linear;
    m.velocity = velocity;
    return m;
}

Motion keyframes(std::vector<double> times, std::vector<Vec3> centers) {
    Motion m;
    m.kind = Motion::Kind::keyframes;
    m.times = std::move(times);
    m.centers = std::move(centers);
    return m;
}

Sphere make_sphere(const Vec3& center, double radius, double contact_radius, const std::string& response,
                   bool literal, double restitution, double friction, const Motion& motion, bool faces,
                   double push_out_speed) {
    Sphere s;
    s.center = center;
    s.radius = radius;
    s.contact_radius = contact_radius;
    s.response = response == "reflect" ? Response::reflect : response == "ray" ? Response::ray : Response::continuous;
    s.faces = faces;
    s.push_out_speed = push_out_speed;
    s.literal = literal;
    s.restitution = restitution;
    s.friction = friction;
    s.motion = motion;
    return s;
}

Plan make_plan(const Cloth& cloth, const Vec3& gravity, std::vector<Sphere> spheres, const std::string& precision,
               const std::string& kernel, bool strict, const std::string& instruction_set, const std::string& integrator) {
    Plan plan;
    plan.cloth = cloth;
    plan.gravity = gravity;
    plan.spheres = std::move(spheres);
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
            for (const Vec3& part : {sphere.center_at(t), sphere.velocity_at(t)}) next = std::copy_n(part.data(), 3, next);
    return states;
}

template <class Real>
int lanes(const Plan& plan) {
    return kernels_of<Real>(*plan.kernels).lanes;
}

}  // namespace

void bind_model(py::module_& m) {
    py::class_<Cloth>(m, "Cloth")
        .def(py::init(&make_cloth), py::kw_only(), py::arg("rows"), py::arg("columns"), py::arg("row_spacing"),
             py::arg("column_spacing"), py::arg("stiffness"), py::arg("spring_damping"), py::arg("point_damping"),
             py::arg("mass"), py::arg("uniform_mass"), py::arg("pinned"))
        .def_property_readonly("mode_bounds", [](const Cloth& cloth) {
            const ModeBounds bounds = mode_bounds(cloth);
            return std::make_pair(bounds.stiffness, bounds.damping);
        });
    py::class_<Motion>(m, "Motion")
        .def(py::init<>())
        .def_static("linear", &linear)
        .def_static("reciprocate", &reciprocate)
        .def_static("keyframes", &keyframes);
    py::class_<Sphere>(m, "Sphere")
        .def(py::init(&make_sphere), py::kw_only(), py::arg("center"), py::arg("radius"), py::arg("contact_radius"),
             py::arg("response"), py::arg("literal"), py::arg("restitution"), py::arg("friction"), py::arg("motion"),
             py::arg("faces") = false, py::arg("push_out_speed") = 1.0)
        .def("center_at", &Sphere::center_at)
        .def("velocity_at", &Sphere::velocity_at);
    py::class_<Plan>(m, "Plan")
        .def(py::init(&make_plan), py::kw_only(), py::arg("cloth"), py::arg("gravity"), py::arg("spheres"),
             py::arg("precision"), py::arg("kernel"), py::arg("strict"), py::arg("instruction_set"), py::arg("integrator"))
        .def_readonly("cloth", &Plan::cloth)
        .def("sphere_states", &sphere_states)
        .def("runaway_speed",
             [](const Plan& p, double dt, double stable_dt) { return runaway_speed(p.cloth, dt, stable_dt); })
        .def_property_readonly("instruction_set", [](const Plan& p) { return std::string(p.kernels->name); })
        .def_property_readonly("lanes", [](const Plan& p) {
            return p.precision == Precision::single ? lanes<float>(p) : lanes<double>(p);
        });
    m.def("edge_offset", &edge_offset);
}

}  // namespace clothsim
