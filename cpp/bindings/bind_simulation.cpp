#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <optional>

#include "bindings/bindings.hpp"
#include "bindings/saved_fields.hpp"
#include "bindings/unlocked.hpp"
#include "driver/simulation.hpp"

namespace clothsim {
namespace {

// A Simulation that refuses a second caller while one is inside: the lock of the interpreter is not held
// while the core works.
class SharedSimulation {
public:
    SharedSimulation(const std::vector<Plan>& plans, double time, int threads)
        : simulation_(plans, time, granted(threads)) {}

    class Use {
    public:
        explicit Use(SharedSimulation& shared) : shared_(shared) {
            if (shared_.busy_.exchange(true))
                throw std::runtime_error(
                    "this state is being advanced by another thread; give each thread a Stepper of its own");
        }
        ~Use() { shared_.busy_ = false; }
        Simulation* operator->() { return &shared_.simulation_; }
        Simulation& operator*() { return shared_.simulation_; }

    private:
        SharedSimulation& shared_;
    };
    Use use() { return Use(*this); }
    void set_scene(std::vector<Plan> plans, std::vector<double> stable_dt) {
        Use(*this)->set_plans(std::move(plans), std::move(stable_dt));
        environment_ = kernel_environment();
    }
    // Whether the environment would choose the same kernels now.
    bool current() const { return environment_ == kernel_environment(); }

private:
    Simulation simulation_;
    std::string environment_ = kernel_environment();
    std::atomic<bool> busy_{false};
};

// Of a batch, arrays of one member after the other.
template <class T>
struct Members {
    T* x;
    T* v;
    std::size_t size;
    T* x_of(std::size_t i) const { return x ? x + i * size : nullptr; }
    T* v_of(std::size_t i) const { return v ? v + i * size : nullptr; }
};
template <class T>
Members<const T> members_of(const Simulation& simulation, const Array<T>& x, const Array<T>& v) {
    return {x.data(), v.data(), std::size_t(x.size()) / simulation.size()};
}
template <class T>
Members<T> members_of(const Simulation& simulation, Array<T>& x, Array<T>& v) {
    return {x.mutable_data(), v.mutable_data(), std::size_t(x.size()) / simulation.size()};
}

// Arguments that are None keep the state, with the digits of T.
template <class T>
void load(SharedSimulation& shared, const std::optional<Array<T>>& x, const std::optional<Array<T>>& v,
          std::optional<double> time) {
    auto simulation = shared.use();
    const FlushSubnormals flushed;
    const std::size_t size = 3 * std::size_t(simulation->plan(0).cloth.points());
    std::vector<T> own_x(x ? 0 : size), own_v(v ? 0 : size);
    for (std::size_t i = 0; i < simulation->size(); ++i) {
        Engine& member = simulation->member(i);
        member.store(x ? nullptr : own_x.data(), v ? nullptr : own_v.data());
        member.load(x ? x->data() + i * size : own_x.data(), v ? v->data() + i * size : own_v.data());
        if (!simulation->frozen(i)) member.place_pins(time ? *time : simulation->clock.now());
        simulation->restart(i);
    }
    if (time) simulation->clock = {*time, 0, 0};
}

template <class T>
void store(SharedSimulation& shared, std::optional<Array<T>> x, std::optional<Array<T>> v) {
    auto simulation = shared.use();
    const FlushSubnormals flushed;
    const auto part = [&](std::optional<Array<T>>& array, std::size_t i) -> T* {
        return array ? array->mutable_data() + i * (std::size_t(array->size()) / simulation->size())
                     : nullptr;
    };
    for (std::size_t i = 0; i < simulation->size(); ++i) simulation->member(i).store(part(x, i), part(v, i));
}

// Values from which python/clothsim/engine/state.py makes its errors.
void signal(const Outcome& outcome, py::dict& result) {
    if (outcome.pinned_inside)
        result["pinned_inside"] = py::make_tuple(outcome.pinned_inside->member, outcome.pinned_inside->point);
    if (outcome.large_cell)
        result["large_cell"] = py::make_tuple(outcome.large_cell->member, outcome.large_cell->point);
    if (outcome.start) {
        const ContactReport::Start& at = outcome.start->at;
        result["start"] = py::make_tuple(outcome.start->member, at.sphere, at.points, at.deepest, at.depth);
    }
    if (outcome.lifted) result["lifted"] = *outcome.lifted;
    if (outcome.grown) {
        result["grown"] = *outcome.grown;
        result["steps"] = outcome.steps;
    }
    const auto& unstable = outcome.unstable;
    if (!unstable) return;
    result["member"] = unstable->member;
    result["point"] = unstable->point;
    result["step"] = unstable->step;
    result["time"] = unstable->time;
    result["trapped"] = unstable->trapped;
}

// None where all steps were done without an event: a call may be shorter than the making of a
// dict.
py::object reported(const Outcome& outcome) {
    if (outcome.interrupted) throw py::error_already_set();
    if (outcome.complete()) return py::none();
    py::dict result;
    signal(outcome, result);
    return result;
}

py::object advance(SharedSimulation& shared, std::int64_t steps, double dt, int threads) {
    auto simulation = shared.use();
    threads = granted(threads);
    Outcome outcome;
    {
        Unlocked unlocked;
        outcome = simulation->advance(steps, dt, threads, [&] { return unlocked.signal_pending(); });
    }
    return reported(outcome);
}

template <class T, class U>
bool overlap(const Array<T>& a, const Array<U>& b) {
    const auto begin = [](const auto& array) { return reinterpret_cast<std::uintptr_t>(array.data()); };
    return begin(a) < begin(b) + std::uintptr_t(b.nbytes()) &&
        begin(b) < begin(a) + std::uintptr_t(a.nbytes());
}
// Whether results of the shape of `x` may be written there.
template <class T, class U>
bool can_hold(const Array<T>& out, const Array<U>& x) {
    return out.writeable() && reinterpret_cast<std::uintptr_t>(out.data()) % sizeof(T) == 0 &&
        out.ndim() == x.ndim() && std::equal(out.shape(), out.shape() + out.ndim(), x.shape());
}

// A whole call: a state in, steps, and the state out if no event has to be reported. False, with nothing
// done, where an array cannot be used. An array cannot be used if its state is
// not finite, or if the results have no place.
template <class T>
py::object step(SharedSimulation& shared, double time, const Array<T>& x, const Array<T>& v,
                std::int64_t steps, double dt, int threads, Array<T>& x_out, Array<T>& v_out) {
    if (!can_hold(x_out, x) || !can_hold(v_out, x) || overlap(x_out, v_out)) return py::bool_(false);
    auto simulation = shared.use();
    const auto from = members_of(*simulation, x, v);
    const auto to = members_of(*simulation, x_out, v_out);
    threads = granted(threads);
    std::optional<Outcome> outcome;
    {
        Unlocked unlocked;
        const auto load = [&](std::size_t i) {
            Engine& member = simulation->member(i);
            member.rounding_of_arrays = std::numeric_limits<T>::epsilon();
            return member.load(from.x_of(i), from.v_of(i));
        };
        outcome = simulation->call(time, load, steps, dt, threads, [&] { return unlocked.signal_pending(); });
        if (outcome && outcome->complete())
            simulation->each_member(
                threads, [&](std::size_t i, int) { simulation->member(i).store(to.x_of(i), to.v_of(i)); });
    }
    return outcome ? reported(*outcome) : py::bool_(false);
}

// At a state, see `step`; or at the present one.
template <class T>
bool accelerations(SharedSimulation& shared, const Array<T>& x, const Array<T>& v, Array<double>& a,
                   int threads) {
    // A member is written before the next one is read.
    const auto in_the_way = [&](const Array<T>& given) {
        return overlap(given, a) && static_cast<const void*>(given.data()) != a.data();
    };
    if (!can_hold(a, x) || in_the_way(x) || in_the_way(v)) return false;
    auto simulation = shared.use();
    const auto from = members_of(*simulation, x, v);
    double* const out = a.mutable_data();
    threads = granted(threads);
    std::atomic<bool> finite{true};
    const Unlocked unlocked;
    simulation->each_member(threads, [&](std::size_t i, int team) {
        Engine& member = simulation->member(i);
        if (member.load(from.x_of(i), from.v_of(i))) member.accelerations(out + i * from.size, team);
        else finite = false;
    });
    return finite;
}
void accelerations_here(SharedSimulation& shared, Array<double>& a, int threads) {
    auto simulation = shared.use();
    const std::size_t size = std::size_t(a.size()) / simulation->size();
    double* const out = a.mutable_data();
    threads = granted(threads);
    const Unlocked unlocked;
    simulation->each_member(
        threads, [&](std::size_t i, int team) { simulation->member(i).accelerations(out + i * size, team); });
}

py::object advance_adaptive(SharedSimulation& shared, AdaptiveRun& run, double until, std::int64_t steps,
                            int threads) {
    auto simulation = shared.use();
    if (simulation->size() != 1 || !simulation->member(0).adaptive())
        throw std::invalid_argument("error control needs one cloth and an adaptive integrator");
    threads = granted(threads);
    Outcome outcome;
    {
        Unlocked unlocked;
        outcome = simulation->advance_adaptive(run, until, steps, threads,
                                               [&] { return unlocked.signal_pending(); });
    }
    return reported(outcome);
}

void dense(SharedSimulation& shared, double t, Array<double>& x, Array<double>& v, int threads) {
    auto simulation = shared.use();
    double* const px = x.mutable_data();
    double* const pv = v.mutable_data();
    threads = granted(threads);
    const Unlocked unlocked;
    simulation->dense(t, px, pv, threads);
}

// Of a member: first contact, depth of mass points and of triangles, stretch, energy gained (NaN: unknown);
// impulse on each sphere.
py::list watched(SharedSimulation& shared) {
    auto simulation = shared.use();
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    py::list members;
    for (std::size_t i = 0; i < simulation->size(); ++i) {
        const Watched& w = simulation->watched(i);
        py::dict one;
        one["in_contact"] = w.in_contact();
        one["first_contact"] = w.in_contact() ? w.first_contact.load() : nan;
        one["point_depth"] = w.point_depth;
        one["triangle_depth"] = std::max(w.triangle_depth, w.point_depth);
        one["stretch"] = std::isfinite(w.stretch) ? w.stretch : 0.0;  // of a cloth without springs
        one["lift_work"] = w.lift_work;
        one["energy_gained"] = simulation->energy_known(i) ? w.energy_gained : nan;
        std::vector<std::array<double, 3>> impulses;
        for (std::size_t s = 0; s < simulation->plan(i).spheres.size(); ++s) {
            const Vec3 impulse = simulation->member(i).impulses.on_sphere(s);
            impulses.push_back({impulse[0], impulse[1], impulse[2]});
        }
        one["impulse"] = impulses;
        members.append(one);
    }
    return members;
}

void sample(SharedSimulation& shared) {
    auto simulation = shared.use();
    const Unlocked unlocked;
    simulation->sample();
}

// `get(simulation, i)` of each member.
template <class Get>
auto of_members(Get get) {
    return [get](SharedSimulation& shared) {
        auto simulation = shared.use();
        std::vector<std::decay_t<decltype(get(*simulation, 0))>> all;
        for (std::size_t i = 0; i < simulation->size(); ++i) all.push_back(get(*simulation, i));
        return all;
    };
}

}  // namespace

void bind_simulation(py::module_& m) {
    using S = SharedSimulation;
    const py::arg any, exact = py::arg().noconvert();  // an array of the very type
    py::class_<AdaptiveRun>(m, "AdaptiveRun")
        .def(py::init([](double tolerance_x, double tolerance_v, double near, std::vector<double> stops,
                         std::vector<double> grid, const std::tuple<double, double, bool>& controller) {
            AdaptiveRun run;
            run.tolerance = {tolerance_x, tolerance_v};
            run.near = near;
            run.stops = std::move(stops);
            run.grid = std::move(grid);
            std::tie(run.controller.h, run.controller.previous_error, run.controller.rejected) = controller;
            return run;
        }))
        .def_property_readonly("controller",
                               [](const AdaptiveRun& r) {
                                   const StepController& c = r.controller;
                                   return py::make_tuple(c.h, c.previous_error, c.rejected);
                               })
        .def_property_readonly("steps", [](const AdaptiveRun& r) { return r.ends.size(); })
        .def_readonly("begin", &AdaptiveRun::begin)
        .def_readonly("ends", &AdaptiveRun::ends)
        .def_readonly("kinks", &AdaptiveRun::kinks)
        .def_readonly("rejected", &AdaptiveRun::rejected)
        .def_readonly("local_error", &AdaptiveRun::local_error);
    // float64 comes first, so that what is not given keeps all its digits.
    py::class_<S>(m, "Simulation")
        .def(py::init<const std::vector<Plan>&, double, int>())
        .def("load", &load<double>, exact, exact, py::arg() = py::none())
        .def("load", &load<float>, exact, exact, py::arg() = py::none())
        .def_property_readonly("current", &S::current)
        .def("set_scene", &S::set_scene)
        .def("step", &step<double>, any, exact, exact, any, any, any, exact, exact)
        .def("step", &step<float>, any, exact, exact, any, any, any, exact, exact)
        .def("store", &store<float>, exact, exact)
        .def("store", &store<double>, exact, exact)
        .def("advance", &advance)
        .def("accelerations", &accelerations<double>, exact, exact, exact, any)
        .def("accelerations", &accelerations<float>, exact, exact, exact, any)
        .def("accelerations", &accelerations_here, exact, any)
        .def("set_stable_dt",
             [](S& s, const std::vector<double>& stable_dt) {
                 auto simulation = s.use();
                 if (stable_dt.size() != simulation->size())
                     throw std::invalid_argument("one time step a member is needed");
                 simulation->set_stable_dt(stable_dt);
             })
        .def("set_sphere",
             [](S& s, std::size_t sphere, const std::vector<Vec3>& centers,
                const std::vector<Motion>& motions) {
                 auto simulation = s.use();
                 for (std::size_t i = 0; i < simulation->size(); ++i)
                     simulation->set_sphere(i, sphere, centers.at(i), motions.at(i));
             })
        .def("set_force",
             [](S& s, const Array<double>& force) {
                 auto simulation = s.use();
                 const std::size_t size = std::size_t(force.size()) / simulation->size();
                 for (std::size_t i = 0; i < simulation->size(); ++i)
                     simulation->set_force(i, force.data() + i * size);
             })
        .def("set_frozen", [](S& s, std::size_t i, bool frozen) { s.use()->set_frozen(i, frozen); })
        .def_property_readonly("frozen", of_members([](Simulation& s, std::size_t i) { return s.frozen(i); }))
        .def("advance_adaptive", &advance_adaptive)
        .def("dense", &dense, any, exact, exact, any)
        .def_property_readonly("contacts", of_members([](Simulation& s, std::size_t i) {
                                   return s.member(i).contact_responses.load();
                               }))
        .def_property_readonly(
            "evaluations", of_members([](Simulation& s, std::size_t i) { return s.member(i).evaluations; }))
        .def("set_watch",
             [](S& s, std::int64_t every, double interval) { s.use()->set_watch(every, interval); })
        .def("set_watch_energy", [](S& s, bool on) { s.use()->set_watch_energy(on); })
        .def("sample", &sample)
        .def_property_readonly("watched", &watched)
        .def("snapshot", [](S& s) { return saved_fields(*s.use()); })
        .def("restore", [](S& s, const py::dict& fields) { restore_fields(*s.use(), fields); })
        .def_property(
            "time", [](S& s) { return s.use()->clock.now(); },
            [](S& s, double time) { s.use()->clock = {time, 0, 0}; });
}

}  // namespace clothsim
