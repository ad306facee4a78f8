#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <optional>

#include "bindings/bindings.hpp"
#include "bindings/unlocked.hpp"
#include "driver/simulation.hpp"
#include "memory/threads.hpp"

namespace clothsim {
namespace {

// A Simulation that refuses a second caller while one is inside: the lock of the interpreter is not
// held while the core works.
class SharedSimulation {
public:
    SharedSimulation(const std::vector<Plan>& plans, double time, int threads)
        : simulation_(plans, time, granted_threads(threads)) {}

    class Use {
    public:
        explicit Use(SharedSimulation& shared) : shared_(shared) {
            if (shared_.busy_.exchange(true))
                throw std::runtime_error(
                    "this state is being advanced by another thread; give each thread a Stepper of "
                    "its own");
        }
        ~Use() { shared_.busy_ = false; }
        Simulation* operator->() { return &shared_.simulation_; }
        Simulation& operator*() { return shared_.simulation_; }

    private:
        SharedSimulation& shared_;
    };
    Use use() { return Use(*this); }
    void set_scene(const std::vector<Plan>& plans, std::vector<double> stable_dt) {
        Use(*this)->set_plans(plans, std::move(stable_dt));
        environment_ = kernel_environment();
    }
    // Return whether the environment would choose the same kernels now.
    bool has_current_kernels() const { return environment_ == kernel_environment(); }

private:
    Simulation simulation_;
    std::string environment_ = kernel_environment();
    std::atomic<bool> busy_{false};
};

// The arrays of a batch, which have one member after the other.
template <class T>
struct Members {
    T* x;
    T* v;
    std::size_t size;
    T* x_of(std::size_t i) const { return x ? x + i * size : nullptr; }
    T* v_of(std::size_t i) const { return v ? v + i * size : nullptr; }
};
template <class T>
Members<const T> arrays_of_members(const Simulation& simulation, const Array<T>& x,
                                   const Array<T>& v) {
    return {x.data(), v.data(), std::size_t(x.size()) / simulation.size()};
}
template <class T>
Members<T> arrays_of_members(const Simulation& simulation, Array<T>& x, Array<T>& v) {
    return {x.mutable_data(), v.mutable_data(), std::size_t(x.size()) / simulation.size()};
}

template <class T>
void load(SharedSimulation& shared, const Array<T>& x, const Array<T>& v,
          std::optional<double> time) {
    auto simulation = shared.use();
    const FlushSubnormals flushed;
    const auto from = arrays_of_members(*simulation, x, v);
    for (std::size_t i = 0; i < simulation->size(); ++i) {
        Engine& member = simulation->member(i);
        const double now = time ? *time : simulation->clock.now();
        member.load(now, from.x_of(i), from.v_of(i));
        if (!simulation->frozen(i)) member.place_pins(now);
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
    for (std::size_t i = 0; i < simulation->size(); ++i)
        simulation->member(i).store(part(x, i), part(v, i));
}

// Return the events of a call for python/clothsim/engine/judge.py; None where all steps were done
// without one: a call may be shorter than the making of a list.
py::object events_or_none(const Outcome& outcome) {
    if (outcome.interrupted) throw py::error_already_set();
    if (outcome.complete()) return py::none();
    return py::cast(outcome.events);
}

py::object advance(SharedSimulation& shared, std::int64_t steps, double dt, int threads) {
    auto simulation = shared.use();
    threads = simulation->forces_need_caller() ? 1 : granted_threads(threads);
    Outcome outcome;
    {
        Unlocked unlocked;
        outcome =
            simulation->advance(steps, dt, threads, [&] { return unlocked.signal_pending(); });
    }
    return events_or_none(outcome);
}

// Load a state, take steps, and store the state if no event has to be reported. Return False, and
// do nothing, where the state is not finite.
template <class T>
py::object step(SharedSimulation& shared, double time, const Array<T>& x, const Array<T>& v,
                std::int64_t steps, double dt, int threads, Array<T>& x_out, Array<T>& v_out) {
    auto simulation = shared.use();
    const auto from = arrays_of_members(*simulation, x, v);
    const auto to = arrays_of_members(*simulation, x_out, v_out);
    threads = simulation->forces_need_caller() ? 1 : granted_threads(threads);
    std::optional<Outcome> outcome;
    {
        Unlocked unlocked;
        const auto load = [&](std::size_t i) {
            return simulation->member(i).load(time, from.x_of(i), from.v_of(i));
        };
        outcome = simulation->call(time, load, steps, dt, threads,
                                   [&] { return unlocked.signal_pending(); });
        if (outcome && outcome->complete())
            simulation->each_member(threads, [&](std::size_t i, int) {
                simulation->member(i).store(to.x_of(i), to.v_of(i));
            });
    }
    return outcome ? events_or_none(*outcome) : py::bool_(false);
}

// Write the accelerations at a state, see `step`, which `a` does not share memory with; or at the
// present one.
template <class T>
bool accelerations(SharedSimulation& shared, double time, const Array<T>& x, const Array<T>& v,
                   Array<double>& a, int threads) {
    auto simulation = shared.use();
    const auto from = arrays_of_members(*simulation, x, v);
    double* const out = a.mutable_data();
    threads = simulation->forces_need_caller() ? 1 : granted_threads(threads);
    std::atomic<bool> finite{true};
    const Unlocked unlocked;
    simulation->each_member(threads, [&](std::size_t i, int) {
        Engine& member = simulation->member(i);
        if (member.load(time, from.x_of(i), from.v_of(i)))
            member.accelerations(time, out + i * from.size);
        else finite = false;
    });
    simulation->throw_force_failure();
    return finite;
}
void accelerations_of_state(SharedSimulation& shared, Array<double>& a, int threads) {
    auto simulation = shared.use();
    const std::size_t size = std::size_t(a.size()) / simulation->size();
    double* const out = a.mutable_data();
    threads = simulation->forces_need_caller() ? 1 : granted_threads(threads);
    const Unlocked unlocked;
    simulation->each_member(threads, [&](std::size_t i, int) {
        simulation->member(i).accelerations(simulation->clock.now(), out + i * size);
    });
    simulation->throw_force_failure();
}

// Arrays of frames, one for each member; none for members that no longer move.
FrameArrays frame_arrays(std::vector<Array<double>>& x, std::vector<Array<double>>& v,
                         const std::function<bool(std::size_t)>& moves) {
    FrameArrays arrays{{}, {}, std::numeric_limits<std::size_t>::max()};
    for (std::size_t i = 0; i < x.size(); ++i) {
        arrays.x.push_back(moves(i) ? x[i].mutable_data() : nullptr);
        arrays.v.push_back(moves(i) ? v[i].mutable_data() : nullptr);
        if (moves(i))
            arrays.capacity =
                std::min({arrays.capacity, std::size_t(x[i].shape(0)), std::size_t(v[i].shape(0))});
    }
    return arrays;
}

// The cloths of the graphics adapter, python/clothsim/gpu/simulation.py.
class AdapterCloths : public Cloths {
public:
    explicit AdapterCloths(py::object simulation)
        : simulation_(std::move(simulation)),
          plans_(simulation_.attr("plans")),
          frozen_(simulation_.attr("frozen").cast<std::vector<bool>>()) {}

    std::size_t size() const override { return plans_.size(); }
    bool moves(std::size_t i) const override { return !frozen_[i]; }
    const Scene& scene(std::size_t i) const override { return plans_[i].cast<const Plan&>(); }
    double now() const override { return simulation_.attr("time").cast<double>(); }
    Outcome advance(std::int64_t steps, double dt) override {
        Outcome outcome;
        outcome.events = simulation_.attr("advance")(steps, dt, 1).cast<std::vector<Event>>();
        outcome.steps = steps;
        for (const Event& event : outcome.events)
            if (event.failed()) outcome.steps = event.step - 1;
        return outcome;
    }
    bool interrupted() override { return PyErr_CheckSignals() != 0; }
    void sample() override { simulation_.attr("sample")(); }
    void store(const std::vector<double*>& x, const std::vector<double*>& v) override {
        const py::ssize_t points = scene(0).cloth.points();
        const std::vector<py::ssize_t> shape{py::ssize_t(size()), points, 3};
        const Array<double> xs(shape), vs(shape);
        simulation_.attr("store")(xs, vs);
        for (std::size_t i = 0; i < x.size(); ++i) {
            if (!x[i]) continue;
            std::copy_n(xs.data(py::ssize_t(i)), 3 * points, x[i]);
            std::copy_n(vs.data(py::ssize_t(i)), 3 * points, v[i]);
        }
    }

private:
    py::object simulation_;
    py::list plans_;
    std::vector<bool> frozen_;
};

template <class AnyRun>
py::object record(SharedSimulation& shared, AnyRun& run, std::vector<Array<double>> x,
                  std::vector<Array<double>> v, std::int64_t steps, std::size_t frames,
                  int threads) {
    auto simulation = shared.use();
    threads = simulation->forces_need_caller() ? 1 : granted_threads(threads);
    const FrameArrays arrays =
        frame_arrays(x, v, [&](std::size_t i) { return !simulation->frozen(i); });
    Outcome outcome;
    {
        Unlocked unlocked;
        outcome = simulation->record(run, arrays, steps, frames, threads,
                                     [&] { return unlocked.signal_pending(); });
    }
    return events_or_none(outcome);
}

py::object record_of_adapter(FixedRun& run, const py::object& simulation,
                             std::vector<Array<double>> x, std::vector<Array<double>> v,
                             std::int64_t steps, std::size_t frames) {
    AdapterCloths cloths(simulation);
    const FrameArrays arrays = frame_arrays(x, v, [&](std::size_t i) { return cloths.moves(i); });
    return events_or_none(run.record(cloths, arrays, steps, frames));
}

py::tuple interpolate_state(const Plan& plan, double t, double begin, double length,
                            const Array<double>& x0, const Array<double>& v0,
                            const Array<double>& x1, const Array<double>& v1) {
    const std::vector<py::ssize_t> shape(x0.shape(), x0.shape() + x0.ndim());
    Array<double> x(shape), v(shape);
    interpolate(plan, t, {begin, length, x0.data(), v0.data(), x1.data(), v1.data()},
                x.mutable_data(), v.mutable_data());
    return py::make_tuple(x, v);
}

// Return the extremes of each member over its states. NaN stands for what is unknown.
py::list watched(SharedSimulation& shared) {
    auto simulation = shared.use();
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    py::list members;
    for (std::size_t i = 0; i < simulation->size(); ++i) {
        const Watched& w = simulation->watched(i);
        py::dict member;
        member["in_contact"] = w.in_contact();
        member["responded"] = w.responded;
        member["first_contact"] = w.in_contact() ? w.first_contact : nan;
        member["point_depth"] = w.point_depth;
        member["triangle_depth"] = std::max(w.triangle_depth, w.point_depth);
        member["stretch"] =
            std::isfinite(w.stretch) ? w.stretch : 0.0;  // of a cloth without springs
        member["energy_gained"] = simulation->energy_known(i) ? w.energy_gained : nan;
        std::vector<std::array<double, 3>> impulses;
        std::vector<double> work;
        for (std::size_t s = 0; s < simulation->plan(i).spheres.size(); ++s) {
            const ContactSums sums = simulation->member(i).contacts.of(s);
            Vec3 impulse = simulation->member(i).impulses.on_sphere(s);
            for (int k = 0; k < 3; ++k) impulse[k] -= sums.impulse[k];
            impulses.push_back({impulse[0], impulse[1], impulse[2]});
            work.push_back(sums.work);
        }
        py::dict force_work;
        for (const Engine::Work& work : simulation->member(i).works_of_forces())
            force_work[py::str(work.force)] = work.work;
        member["force_work"] = force_work;
        member["impulse"] = impulses;
        member["obstacle_work"] = work;
        members.append(member);
    }
    return members;
}

void sample(SharedSimulation& shared) {
    auto simulation = shared.use();
    const Unlocked unlocked;
    simulation->sample();
}

// Return a simulation between steps as named fields. Arrays have an entry for each member; those of
// the sums of impulses have one for each sphere of each member.
constexpr std::array<const char*, 4> names_of_values{"positions", "velocities", "positions_low",
                                                     "velocities_low"};
std::size_t parts_of_snapshot(const Simulation& simulation) {
    return simulation.plan(0).precision == Precision::single ? 4 : 2;
}

py::dict snapshot(SharedSimulation& shared) {
    auto simulation = shared.use();
    const Cloth& cloth = simulation->plan(0).cloth;
    const std::size_t members = simulation->size(), parts = parts_of_snapshot(*simulation),
                      size = 3 * std::size_t(cloth.points());
    std::vector<std::vector<double>> values(parts);
    std::vector<double> origins, impulses, contacts, normals;
    py::list frozen;
    for (std::size_t i = 0; i < members; ++i) {
        const SavedState state = simulation->member(i).saved_state();
        for (std::size_t part = 0; part < parts; ++part)
            values[part].insert(values[part].end(),
                                state.values.begin() + std::ptrdiff_t(part * size),
                                state.values.begin() + std::ptrdiff_t((part + 1) * size));
        origins.insert(origins.end(), state.origin.begin(), state.origin.end());
        impulses.insert(impulses.end(), state.impulses.begin(), state.impulses.end());
        contacts.insert(contacts.end(), state.contacts.begin(), state.contacts.end());
        for (const Vec3& normal : state.normals)
            normals.insert(normals.end(), normal.begin(), normal.end());
        frozen.append(simulation->frozen(i));
    }
    using Shape = std::vector<py::ssize_t>;
    const auto array = [](const std::vector<double>& all, const Shape& shape) {
        return py::array_t<double>(shape, all.data());
    };
    const py::ssize_t count = py::ssize_t(members), rows = cloth.rows,
                      groups = py::ssize_t(Impulses::groups_of(cloth));
    py::dict fields;
    for (std::size_t part = 0; part < parts; ++part)
        fields[names_of_values[part]] = array(values[part], {count, rows, cloth.columns, 3});
    fields["origins"] = array(origins, {count, 3});
    fields["impulses"] =
        array(impulses, {py::ssize_t(impulses.size()) / (3 * rows * groups), rows, groups, 3});
    py::ssize_t obstacles = 0;  // of members with contacts
    for (std::size_t i = 0; i < members; ++i)
        if (simulation->member(i).has_penalty())
            obstacles += py::ssize_t(simulation->plan(i).spheres.size());
    fields["contacts"] =
        array(contacts, {obstacles, obstacles ? py::ssize_t(contacts.size()) / obstacles : 0});
    fields["normals"] = array(normals, {py::ssize_t(normals.size()) / 3, 3});
    fields["frozen"] = py::module_::import("numpy").attr("array")(frozen);
    fields["time"] = simulation->clock.now();
    fields["clock_origin"] = simulation->clock.origin;
    fields["clock_steps"] = simulation->clock.steps;
    fields["clock_step"] = simulation->clock.dt;
    return fields;
}

// Continue from fields. Throw, and change nothing, where one is missing or has another size.
void restore(SharedSimulation& shared, const py::dict& fields) {
    auto simulation = shared.use();
    const std::size_t members = simulation->size(),
                      size = 3 * std::size_t(simulation->plan(0).cloth.points());
    const auto take = [&](const char* name, std::size_t count) {
        const auto array = fields[name].cast<Array<double>>();
        if (std::size_t(array.size()) != count)
            throw std::invalid_argument(std::string("the field ") + name +
                                        " of a snapshot must hold " + std::to_string(count) +
                                        " numbers, got " + std::to_string(array.size()));
        return array;
    };
    std::vector<SavedState> states(members);
    for (std::size_t part = 0; part < parts_of_snapshot(*simulation); ++part) {
        const auto values = take(names_of_values[part], members * size);
        for (std::size_t i = 0; i < members; ++i)
            states[i].values.insert(states[i].values.end(), values.data() + i * size,
                                    values.data() + (i + 1) * size);
    }
    std::size_t sums = 0;
    std::size_t contact_sums = 0;
    std::size_t spheres = 0;
    for (std::size_t i = 0; i < members; ++i) {
        sums += simulation->member(i).impulses.sums().size();
        contact_sums += simulation->member(i).contacts.sums().size();
        spheres += simulation->plan(i).spheres.size();
    }
    const auto origins = take("origins", 3 * members), frozen = take("frozen", members),
               impulses = take("impulses", sums),
               contacts = fields["contacts"].cast<Array<double>>(),
               normals = take("normals", 3 * spheres);
    const Clock clock{fields["clock_origin"].cast<double>(),
                      fields["clock_steps"].cast<std::int64_t>(),
                      fields["clock_step"].cast<double>()};
    simulation->clock = clock;
    const double *sum = impulses.data(), *contact = contacts.data(), *normal = normals.data();
    for (std::size_t i = 0; i < members; ++i) {
        Engine& member = simulation->member(i);
        states[i].origin = Vec3(origins.data() + 3 * i);
        states[i].impulses.assign(sum, sum + member.impulses.sums().size());
        sum += states[i].impulses.size();
        // Processors of another instruction set have another number of lanes.
        const std::size_t own = contact_sums
            ? member.contacts.sums().size() * std::size_t(contacts.size()) / contact_sums
            : 0;
        states[i].contacts.assign(contact, contact + own);
        contact += own;
        for (std::size_t s = 0; s < simulation->plan(i).spheres.size(); ++s, normal += 3)
            states[i].normals.emplace_back(normal);
        member.set_saved_state(states[i], clock.now());
        simulation->set_frozen(i, frozen.data()[i] != 0);
        if (!simulation->frozen(i)) member.place_pins(clock.now());
        simulation->restart(i);
    }
}

// Return a function that calls `get(simulation, i)` for each member.
template <class Get>
auto property_of_members(Get get) {
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
    py::class_<Moment>(m, "Moment")
        .def(py::init<double, double>(), py::arg("seconds"), py::arg("time"))
        .def_readonly("seconds", &Moment::seconds)
        .def_readonly("time", &Moment::time);
    py::class_<Segment>(m, "Segment")
        .def(py::init<Moment, Moment, double, std::int64_t, double>(), py::arg("begin"),
             py::arg("end"), py::arg("dt"), py::arg("whole"), py::arg("rest") = 0.0)
        .def_readonly("dt", &Segment::dt);
    py::class_<RunInProgress>(m, "RunInProgress")
        .def_property_readonly("dt", &RunInProgress::dt)
        .def_property_readonly("steps", &RunInProgress::steps)
        .def_property_readonly("complete", &RunInProgress::complete)
        .def_property_readonly("ahead", &RunInProgress::ahead)
        .def_property_readonly("frames", [](const RunInProgress& r) { return r.frames.stored; })
        .def("frame", [](const RunInProgress& r, std::size_t k) { return r.frames.stored.at(k); })
        .def_property_readonly("stored",
                               [](const RunInProgress& r) { return r.frames.stored.size(); });
    py::class_<FixedRun, RunInProgress>(m, "FixedRun")
        .def(py::init<std::vector<Segment>, std::vector<Moment>>())
        .def("record", &record_of_adapter, any, exact, exact, any, any);
    py::class_<AdaptiveRun, RunInProgress>(m, "AdaptiveRun")
        .def(py::init([](double tolerance_x, double tolerance_v, double near,
                         std::vector<double> stops, std::vector<double> grid,
                         const std::tuple<double, double, bool>& controller,
                         std::vector<Moment> moments, double start, std::int64_t every,
                         std::int64_t since_frame) {
                 AdaptiveRun run;
                 run.tolerance = {tolerance_x, tolerance_v};
                 run.near = near;
                 run.stops = std::move(stops);
                 run.grid = std::move(grid);
                 std::tie(run.controller.h, run.controller.previous_error,
                          run.controller.rejected) = controller;
                 run.frames.moments = std::move(moments);
                 run.start = start;
                 run.every = every;
                 run.since_frame = since_frame;
                 return run;
             }),
             py::kw_only(), py::arg("tolerance_x"), py::arg("tolerance_v"), py::arg("near"),
             py::arg("stops"), py::arg("grid"), py::arg("controller"), py::arg("moments"),
             py::arg("start"), py::arg("every"), py::arg("since_frame"))
        .def_property_readonly("controller",
                               [](const AdaptiveRun& r) {
                                   const StepController& c = r.controller;
                                   return py::make_tuple(c.h, c.previous_error, c.rejected);
                               })
        .def_readonly("ends", &AdaptiveRun::ends)
        .def_readonly("kinks", &AdaptiveRun::kinks)
        .def_readonly("rejected", &AdaptiveRun::rejected)
        .def_readonly("local_error", &AdaptiveRun::local_error);
    py::class_<Event>(m, "Event")
        .def(py::init<std::string, std::int64_t, std::int64_t, std::int64_t, double, std::int64_t,
                      double>(),
             py::arg("kind"), py::arg("member"), py::arg("point") = -1, py::arg("obstacle") = -1,
             py::arg("value") = 0.0, py::arg("step"), py::arg("time"))
        .def_readonly("kind", &Event::kind)
        .def_readonly("member", &Event::member)
        .def_readonly("point", &Event::point)
        .def_readonly("obstacle", &Event::obstacle)
        .def_readonly("value", &Event::value)
        .def_readonly("step", &Event::step)
        .def_readonly("time", &Event::time);
    m.def("interpolate", &interpolate_state);
    // float64 comes first, so that what is not given keeps all its digits.
    py::class_<S>(m, "Simulation")
        .def(py::init<const std::vector<Plan>&, double, int>())
        .def("load", &load<double>, exact, exact, py::arg() = py::none())
        .def("load", &load<float>, exact, exact, py::arg() = py::none())
        .def_property_readonly("has_current_kernels", &S::has_current_kernels)
        .def_property_readonly("instruction_set",
                               [](S& s) { return s.use()->plan(0).kernels->name; })
        .def("set_scene", &S::set_scene)
        .def("step", &step<double>, any, exact, exact, any, any, any, exact, exact)
        .def("step", &step<float>, any, exact, exact, any, any, any, exact, exact)
        .def("store", &store<float>, exact, exact)
        .def("store", &store<double>, exact, exact)
        .def("advance", &advance)
        .def("accelerations", &accelerations<double>, any, exact, exact, exact, any)
        .def("accelerations", &accelerations<float>, any, exact, exact, exact, any)
        .def("accelerations", &accelerations_of_state, exact, any)
        .def("set_stable_dt",
             [](S& s, const std::vector<double>& stable_dt) { s.use()->set_stable_dt(stable_dt); })
        .def("set_stable_layer_depths",
             [](S& s, std::size_t i, const std::vector<double>& depths) {
                 s.use()->set_stable_layer_depths(i, depths);
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
        .def_property_readonly(
            "frozen", property_of_members([](Simulation& s, std::size_t i) { return s.frozen(i); }))
        .def("record", &record<FixedRun>, any, exact, exact, any, any, any)
        .def("record", &record<AdaptiveRun>, any, exact, exact, any, any, any)
        .def_property_readonly("contacts", property_of_members([](Simulation& s, std::size_t i) {
                                   return s.member(i).contact_responses;
                               }))
        .def_property_readonly("evaluations", property_of_members([](Simulation& s, std::size_t i) {
                                   return s.member(i).evaluations;
                               }))
        .def("set_watch",
             [](S& s, std::int64_t every, double interval) { s.use()->set_watch(every, interval); })
        .def("set_watch_energy", [](S& s, bool on) { s.use()->set_watch_energy(on); })
        .def("sample", &sample)
        .def_property_readonly("watched", &watched)
        .def("snapshot", &snapshot)
        .def("restore", &restore)
        .def_property(
            "time", [](S& s) { return s.use()->clock.now(); },
            [](S& s, double time) { s.use()->clock = {time, 0, 0}; });
}

}  // namespace clothsim
