#include "bindings/saved_fields.hpp"

#include <algorithm>
#include <string>

namespace clothsim {
namespace {

using Shape = std::vector<py::ssize_t>;

// An array made of one part for each member.
struct Values {
    std::vector<double> all;
    void add(const std::vector<double>& part) { all.insert(all.end(), part.begin(), part.end()); }
    void add(const Vec3& part) { all.insert(all.end(), part.begin(), part.end()); }
    py::array_t<double> array(const Shape& shape) const { return py::array_t<double>(shape, all.data()); }
};

// A field in the form that it was saved in, and checked to have its shape.
template <class T>
Array<T> field(const py::dict& fields, const char* name, const Shape& shape) {
    const std::string named = std::string("the field ") + name + " of a snapshot ";
    if (!fields.contains(name)) throw std::invalid_argument(named + "is missing");
    const auto array = Array<T>::ensure(fields[name]);
    if (!array) {
        PyErr_Clear();
        throw std::invalid_argument(named + "must be an array of numbers");
    }
    if (std::equal(shape.begin(), shape.end(), array.shape(), array.shape() + array.ndim())) return array;
    throw std::invalid_argument(named + "must have the shape " +
                                std::string(py::str(py::tuple(py::cast(shape)))) + ", got " +
                                std::string(py::str(py::object(array.attr("shape")))));
}

template <class T>
T number(const py::dict& fields, const char* name) {
    return *field<T>(fields, name, {}).data();
}

// The spheres of one member after the other.
Shape shape_of_impulses(const Simulation& simulation) {
    const Cloth& cloth = simulation.plan(0).cloth;
    std::size_t spheres = 0;
    for (std::size_t i = 0; i < simulation.size(); ++i) spheres += simulation.plan(i).spheres.size();
    return {py::ssize_t(spheres), cloth.rows, py::ssize_t(Impulses::groups_of(cloth)), 3};
}

}  // namespace

py::dict saved_fields(Simulation& simulation) {
    const Cloth& cloth = simulation.plan(0).cloth;
    const py::ssize_t members = py::ssize_t(simulation.size());
    Values x, v, x_low, v_low, origin, impulses;
    std::vector<std::uint8_t> frozen;
    for (std::size_t i = 0; i < simulation.size(); ++i) {
        const SavedState state = simulation.member(i).saved_state();
        x.add(state.x);
        v.add(state.v);
        x_low.add(state.x_low);
        v_low.add(state.v_low);
        origin.add(state.origin);
        frozen.push_back(simulation.frozen(i));
        impulses.add(state.impulses);
    }
    const Shape vectors{members, cloth.rows, cloth.columns, 3};
    py::dict fields;
    fields["positions"] = x.array(vectors);
    fields["velocities"] = v.array(vectors);
    if (simulation.plan(0).precision == Precision::single) {
        fields["positions_low"] = x_low.array(vectors);
        fields["velocities_low"] = v_low.array(vectors);
    }
    fields["origins"] = origin.array({members, 3});
    fields["impulses"] = impulses.array(shape_of_impulses(simulation));
    fields["frozen"] = py::array_t<std::uint8_t>(members, frozen.data()).attr("astype")("bool");
    fields["time"] = py::float_(simulation.clock.now());
    fields["clock_origin"] = py::float_(simulation.clock.origin);
    fields["clock_steps"] = py::int_(simulation.clock.steps);
    fields["clock_step"] = py::float_(simulation.clock.dt);
    return fields;
}

void restore_fields(Simulation& simulation, const py::dict& fields) {
    const Cloth& cloth = simulation.plan(0).cloth;
    const py::ssize_t members = py::ssize_t(simulation.size());
    const Shape vectors{members, cloth.rows, cloth.columns, 3};
    const std::size_t size = 3 * std::size_t(cloth.points());
    std::vector<SavedState> states(simulation.size());
    const auto take = [&](const char* name, std::vector<double> SavedState::* values) {
        const auto array = field<double>(fields, name, vectors);
        for (std::size_t i = 0; i < states.size(); ++i)
            (states[i].*values).assign(array.data() + i * size, array.data() + (i + 1) * size);
    };
    take("positions", &SavedState::x);
    take("velocities", &SavedState::v);
    const bool low = simulation.plan(0).precision == Precision::single;
    if (low != fields.contains("positions_low"))
        throw std::invalid_argument(std::string("the snapshot is of precision '") +
                                    (low ? "double" : "single") + "', and the simulation of the other one");
    if (low) {
        take("positions_low", &SavedState::x_low);
        take("velocities_low", &SavedState::v_low);
    }
    const auto origin = field<double>(fields, "origins", {members, 3});
    const auto frozen = field<std::uint8_t>(fields, "frozen", {members});
    const auto impulses = field<double>(fields, "impulses", shape_of_impulses(simulation));
    const double* sum = impulses.data();
    for (std::size_t i = 0; i < states.size(); ++i) {
        const std::size_t count = simulation.member(i).impulses.sums().size();
        states[i].impulses.assign(sum, sum + count);
        sum += count;
        states[i].origin = Vec3(origin.data() + 3 * i);
    }
    const Clock clock{number<double>(fields, "clock_origin"), number<std::int64_t>(fields, "clock_steps"),
                      number<double>(fields, "clock_step")};
    simulation.clock = clock;
    for (std::size_t i = 0; i < states.size(); ++i) {
        simulation.member(i).set_saved_state(states[i]);
        if (!frozen.data()[i]) simulation.member(i).place_pins(simulation.clock.now());
        simulation.set_frozen(i, frozen.data()[i] != 0);
        simulation.restart(i);
    }
}

}  // namespace clothsim
