#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <optional>

#include "bindings/bindings.hpp"
#include "simulation/simulation.hpp"

namespace clothsim {
namespace {

// A Simulation that refuses a second caller while one is inside: the lock of the interpreter is not held
// while the core works.
class SharedSimulation {
public:
    SharedSimulation(const std::vector<Plan>& plans, double time, int threads) : simulation_(plans, time, threads) {}

    class Use {
    public:
        explicit Use(SharedSimulation& shared) : shared_(shared) {
            if (shared_.busy_.exchange(true))
                throw std::runtime_error("this state is being advanced by another thread; give each thread a Stepper of its own");
        }
        ~Use() { shared_.busy_ = false; }
        Simulation* operator->() { return &shared_.simulation_; }

    private:
        SharedSimulation& shared_;
    };
    Use use() { return Use(*this); }

private:
    Simulation simulation_;
    std::atomic<bool> busy_{false};
};

bool signal_pending() {
    py::gil_scoped_acquire gil;
    return PyErr_CheckSignals() != 0;
}

template <class T>
void load(SharedSimulation& shared, const Array<T>& x, const Array<T>& v) {
    auto simulation = shared.use();
    const std::size_t size = std::size_t(x.size()) / simulation->size();
    for (std::size_t i = 0; i < simulation->size(); ++i) {
        simulation->member(i).load(x.data() + i * size, v.data() + i * size);
        simulation->restart(i);
    }
}

// Another state in place of the last, at another time; whether it is finite.
template <class T>
bool begin(SharedSimulation& shared, double time, const Array<T>& x, const Array<T>& v, bool input_kept) {
    shared.use()->begin(time, input_kept);
    load(shared, x, v);
    auto simulation = shared.use();
    for (std::size_t i = 0; i < simulation->size(); ++i)
        if (simulation->member(i).first_bad_point(std::numeric_limits<double>::infinity()) >= 0) return false;
    return true;
}

template <class T>
void store(SharedSimulation& shared, std::optional<Array<T>> x, std::optional<Array<T>> v) {
    auto simulation = shared.use();
    const auto part = [&](std::optional<Array<T>>& array, std::size_t i) -> T* {
        return array ? array->mutable_data() + i * (std::size_t(array->size()) / simulation->size()) : nullptr;
    };
    for (std::size_t i = 0; i < simulation->size(); ++i) simulation->member(i).store(part(x, i), part(v, i));
}

// What the errors of python/clothsim/engine/state.py are made from.
void tell(const Outcome& outcome, py::dict& result) {
    if (outcome.pinned_inside)
        result["pinned_inside"] = py::make_tuple(outcome.pinned_inside->member, outcome.pinned_inside->point);
    if (outcome.grown) {
        result["grown"] = *outcome.grown;
        result["steps"] = outcome.steps;
    }
    if (outcome.again) result["again"] = true;
    const auto& unstable = outcome.unstable;
    if (!unstable) return;
    result["member"] = unstable->member;
    result["point"] = unstable->point;
    result["step"] = unstable->step;
    result["time"] = unstable->time;
    result["shut_in"] = unstable->shut_in;
}

// None where all steps were done and there is nothing to tell: a call may be shorter than the making of a dict.
std::optional<py::dict> advance(SharedSimulation& shared, std::int64_t steps, double dt, int threads, bool optional) {
    auto simulation = shared.use();
    Outcome outcome;
    {
        py::gil_scoped_release release;
        outcome = simulation->advance(steps, dt, threads, optional, signal_pending);
    }
    if (outcome.interrupted) throw py::error_already_set();
    if (!outcome.unstable && !outcome.again && !outcome.pinned_inside && !outcome.grown) return std::nullopt;
    py::dict result;
    tell(outcome, result);
    return result;
}

void accelerations(SharedSimulation& shared, Array<double>& a, int threads) {
    auto simulation = shared.use();
    const std::size_t size = std::size_t(a.size()) / simulation->size();
    double* const out = a.mutable_data();
    py::gil_scoped_release release;
    for (std::size_t i = 0; i < simulation->size(); ++i) simulation->member(i).accelerations(out + i * size, threads);
}

py::dict advance_adaptive(SharedSimulation& shared, double until, double end, std::int64_t steps, double tolerance_x,
                          double tolerance_v, double longest, StepController& controller, int threads, bool optional) {
    auto simulation = shared.use();
    if (simulation->size() != 1 || !simulation->member(0).adaptive())
        throw std::invalid_argument("error control needs one cloth and an adaptive integrator");
    Simulation::AdaptiveOutcome outcome;
    {
        py::gil_scoped_release release;
        outcome = simulation->advance_adaptive(
            {until, end, steps, {tolerance_x, tolerance_v}, longest, threads, optional}, controller, signal_pending);
    }
    py::dict result;
    // Not thrown, so that the caller can count the steps that are done.
    if (outcome.interrupted) result["interrupted"] = py::error_already_set().value();
    result["steps"] = outcome.steps;
    result["rejected"] = outcome.rejected;
    result["error"] = outcome.error;
    tell(outcome, result);
    return result;
}

void dense(SharedSimulation& shared, double t, Array<double>& x, Array<double>& v, int threads) {
    auto simulation = shared.use();
    double* const px = x.mutable_data();
    double* const pv = v.mutable_data();
    py::gil_scoped_release release;
    simulation->dense(t, px, pv, threads);
}

// Of a member: first contact, depth of mass points and of triangles, stretch, energy gained; NaN: not told.
py::list watched(SharedSimulation& shared) {
    auto simulation = shared.use();
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    py::list members;
    for (std::size_t i = 0; i < simulation->size(); ++i) {
        const Watched& w = simulation->watched(i);
        py::dict one;
        one["in_contact"] = w.in_contact();
        one["first_contact"] = w.in_contact() ? w.first_contact.load() : nan;
        one["point_depth"] = w.point_depth.load();
        one["triangle_depth"] = std::max(w.triangle_depth, w.point_depth.load());
        one["stretch"] = std::isfinite(w.stretch) ? w.stretch : 0.0;  // of a cloth without springs
        one["energy_gained"] = simulation->energy_told(i) ? w.energy_gained : nan;
        members.append(one);
    }
    return members;
}

void sample(SharedSimulation& shared) {
    auto simulation = shared.use();
    py::gil_scoped_release release;
    simulation->sample();
}

py::tuple snapshot(SharedSimulation& shared) {
    auto simulation = shared.use();
    py::list members;
    for (std::size_t i = 0; i < simulation->size(); ++i) {
        const std::vector<double> raw = simulation->member(i).raw_state();
        members.append(py::make_tuple(py::array_t<double>(py::ssize_t(raw.size()), raw.data()),
                                      simulation->member(i).contact_energy));
    }
    const Clock& clock = simulation->clock;
    return py::make_tuple(clock.origin, clock.steps, clock.dt, members);
}

void restore(SharedSimulation& shared, double origin, std::int64_t steps, double dt,
             const std::vector<std::pair<std::vector<double>, double>>& members) {
    auto simulation = shared.use();
    if (members.size() != simulation->size()) throw std::invalid_argument("snapshot is of another batch");
    for (std::size_t i = 0; i < members.size(); ++i)
        if (!simulation->member(i).fits(members[i].first.size()))
            throw std::invalid_argument("snapshot is of another shape or precision");
    simulation->clock = {origin, steps, dt};
    for (std::size_t i = 0; i < members.size(); ++i) {
        simulation->member(i).set_raw_state(members[i].first);
        simulation->member(i).contact_energy = members[i].second;
        simulation->restart(i);
    }
}

}  // namespace

void bind_simulation(py::module_& m) {
    using S = SharedSimulation;
    py::class_<TeamChoice>(m, "TeamChoice")
        .def(py::init<bool>(), py::arg("team_first"))
        .def_property_readonly("team", &TeamChoice::team)
        .def("steps", &TeamChoice::steps, py::arg("wanted"))
        .def("observe", &TeamChoice::observe, py::arg("steps"), py::arg("seconds"));
    py::class_<StepController>(m, "StepController")
        .def(py::init<>())
        .def_property(
            "state", [](const StepController& c) { return py::make_tuple(c.h, c.previous_error, c.rejected); },
            [](StepController& c, const std::tuple<double, double, bool>& state) {
                std::tie(c.h, c.previous_error, c.rejected) = state;
            })
        .def_readwrite("h", &StepController::h);
    py::class_<S>(m, "Simulation")
        .def(py::init<const std::vector<Plan>&, double, int>())
        .def("load", &load<float>, py::arg().noconvert(), py::arg().noconvert())
        .def("load", &load<double>, py::arg().noconvert(), py::arg().noconvert())
        .def("begin", &begin<float>, py::arg(), py::arg().noconvert(), py::arg().noconvert(), py::arg())
        .def("begin", &begin<double>, py::arg(), py::arg().noconvert(), py::arg().noconvert(), py::arg())
        .def("store", &store<float>, py::arg().noconvert(), py::arg().noconvert())
        .def("store", &store<double>, py::arg().noconvert(), py::arg().noconvert())
        .def("advance", &advance)
        .def("accelerations", &accelerations, py::arg().noconvert(), py::arg())
        .def("set_stable_dt", [](S& s, const std::vector<double>& stable_dt) {
            auto simulation = s.use();
            if (stable_dt.size() != simulation->size()) throw std::invalid_argument("one time step a member is needed");
            simulation->set_stable_dt(stable_dt);
        })
        .def("set_frozen", [](S& s, std::size_t i, bool frozen) { s.use()->set_frozen(i, frozen); })
        .def_property_readonly("frozen", [](S& s) {
            auto simulation = s.use();
            std::vector<bool> frozen;
            for (std::size_t i = 0; i < simulation->size(); ++i) frozen.push_back(simulation->frozen(i));
            return frozen;
        })
        .def("advance_adaptive", &advance_adaptive)
        .def("dense", &dense, py::arg(), py::arg().noconvert(), py::arg().noconvert(), py::arg())
        .def_property_readonly("contacts", [](S& s) {
            auto simulation = s.use();
            std::vector<std::int64_t> contacts;
            for (std::size_t i = 0; i < simulation->size(); ++i)
                contacts.push_back(simulation->member(i).contacts_answered);
            return contacts;
        })
        .def_property_readonly("evaluations", [](S& s) {
            auto simulation = s.use();
            std::vector<std::int64_t> evaluations;
            for (std::size_t i = 0; i < simulation->size(); ++i) evaluations.push_back(simulation->member(i).evaluations);
            return evaluations;
        })
        .def("set_watch", [](S& s, std::int64_t every, double interval) { s.use()->set_watch(every, interval); })
        .def("set_watch_energy", [](S& s, bool on) { s.use()->set_watch_energy(on); })
        .def("sample", &sample)
        .def_property_readonly("watched", &watched)
        .def("snapshot", &snapshot)
        .def("restore", &restore)
        .def("set_track_contact_energy", [](S& s, bool on) {
            auto simulation = s.use();
            for (std::size_t i = 0; i < simulation->size(); ++i) {
                simulation->member(i).track_contact_energy = on;
                simulation->restart(i);
            }
        })
        .def_property_readonly("contact_energy", [](S& s) {
            auto simulation = s.use();
            std::vector<double> energy;
            for (std::size_t i = 0; i < simulation->size(); ++i) energy.push_back(simulation->member(i).contact_energy);
            return energy;
        })
        .def_property(
            "time", [](S& s) { return s.use()->clock.now(); }, [](S& s, double time) { s.use()->clock = {time, 0, 0}; });
}

}  // namespace clothsim
