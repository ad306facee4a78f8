// One cloth, or a batch of cloths of one shape, advanced together.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "driver/energy_watch.hpp"
#include "driver/frames.hpp"
#include "engines/engine.hpp"
#include "integrators/adaptive.hpp"
#include "memory/poll.hpp"

namespace clothsim {

// What a user should know of a call. engine/judge.py makes an error or a warning of each of these
// kinds:
//
//     "unstable"       the state is not finite or has run away; it is the last good one again
//     "passed"         the point has gone through the layer of the obstacle; likewise
//     "pinned_inside"  the pinned point is below the true surface of an obstacle
//     "below"          a free point or a triangle is `value` below the true surface of an obstacle
//     "stiff"          a point is so deep in the layer that the time step may be too long for it
//     "grown"          the energy has grown out of nothing (EnergyWatch)
struct Event {
    std::string kind;
    std::int64_t member = 0;
    std::int64_t point = -1;     // mass point, or -1
    std::int64_t obstacle = -1;  // sphere or plane, or -1
    double value = 0;  // depth [m]
    std::int64_t step = 0;  // of the call, counted from 1
    double time = 0;  // at the end of that step [s]

    bool failed() const { return kind == "unstable" || kind == "passed"; }
};

// How a call of `advance` ended, at a whole step in every case.
struct Outcome {
    std::int64_t steps = 0;  // done; some are left after "unstable", "passed" and "grown"
    bool interrupted = false;
    std::vector<Event> events;  // at most one of each kind

    // Return whether all steps were done, and no event has to be reported.
    bool complete() const { return !interrupted && events.empty(); }
    // Add an event after the steps so far, unless there is one of its kind.
    void add(Event event, double time);
    // Add a call that went on from there.
    void append(Outcome part);
};

// Steps are taken first and judged afterwards, which costs less than an inspection before each. A
// block of at most heuristics::steps_of_block steps begins with a copy of the state in each engine
// and ends with an inspection.
//
//     copy                              inspection
//      |------- steps of a block -----------|
//      |<~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~| a bad state: all members repeat them one by one,
//                                             each inspected
//
// A bad state is not finite, runs away, or holds a mass point that has gone through a layer. A
// block goes on over several calls of `advance`, as a call may be one step long. In the first block
// of a call with arrays, these take the place of the copies, and stay unchanged until the call has
// succeeded.

// A run with error control: the steps that are asked of it, and the steps so far.
struct AdaptiveRun : RunInProgress {
    Tolerance tolerance;
    double near = 0;  // longest step in reach of a sphere that responds after it [s], stable
    // Rising times [s] at which a step ends; the last is the end of the run.
    std::vector<double> stops;
    std::vector<double> grid;  // prescribed ends of steps; empty: the controller chooses
    StepController controller;

    std::vector<double> ends;  // of the accepted steps
    std::vector<std::int64_t> kinks;  // accepted steps before each stop
    std::int64_t rejected = 0;  // steps tried in vain
    double begin = 0;  // of the last step [s]
    double local_error = 0;  // sum of the method's estimates, in units of the tolerance
    double start = 0;  // time at the start of the run [s]
    std::int64_t every = 0;  // steps after which there is a frame too; 0: none
    std::int64_t since_frame = 0;  // steps

    // Return where the step from the time t has to end at the latest.
    double target(double t);
    std::size_t next_stop = 0, next_given = 0;

    std::int64_t steps() const override { return std::int64_t(ends.size()); }  // accepted
    double dt() const override { return controller.h; }
    bool complete() const override { return next_moment == frames.moments.size(); }
    std::size_t next_moment = 0;
};

class Simulation {
public:
    // Steps, and so copies of the state, may use so many `threads`.
    Simulation(const std::vector<Plan>& plans, double time, int threads);

    std::size_t size() const { return members_.size(); }
    Engine& member(std::size_t i) { return *members_[i]; }
    const Engine& member(std::size_t i) const { return *members_[i]; }
    // The caller has set the state of a member.
    void restart(std::size_t i);

    Clock clock;

    const Plan& plan(std::size_t i) const { return members_[i]->plan(); }
    // Replace the scenes of all members, by scenes of the same shape, precision and integrator.
    // State and clock stay; points that are now pinned stop. An exception leaves everything as it
    // was.
    void set_plans(const std::vector<Plan>& plans, std::vector<double> stable_dt);

    // Start anew at a time from the state that `load` brings into a member, and advance. Return
    // nothing if `load` finds that a state is not finite.
    using Load = std::function<bool(std::size_t i)>;
    std::optional<Outcome> call(double time, const Load& load, std::int64_t steps, double dt,
                                int threads, const std::function<bool()>& interrupted);

    // Does work for member i with a team of so many threads.
    using MemberWork = std::function<void(std::size_t i, int threads)>;
    void each_member(int threads, const MemberWork& work) { each_member_of(all_, threads, work); }

    // Set the guaranteed time step of each member [s]: only above it a point can be too fast. It is
    // infinite until it is set.
    void set_stable_dt(std::vector<double> stable_dt);
    // Set the depths in the layers of a member's obstacles up to which the time step is stable [m].
    void set_stable_layer_depths(std::size_t i, std::vector<double> depths);

    // Change an obstacle, or the force on points, from now on.
    void set_sphere(std::size_t i, std::size_t sphere, const Vec3& center, const Motion& motion);
    void set_force(std::size_t i, const double* force);

    // Return whether a batch has forces that only the thread of the call may ask.
    bool forces_need_caller() const { return by_caller_; }
    // Take from all members what their forces have thrown, and return the first of it.
    std::exception_ptr take_force_failure();
    void throw_force_failure() {
        if (const std::exception_ptr failure = take_force_failure())
            std::rethrow_exception(failure);
    }

    // A frozen member takes no part in further steps: it keeps its state, and the others go on
    // without it.
    void set_frozen(std::size_t i, bool frozen);
    bool frozen(std::size_t i) const { return frozen_[i] != 0; }

    // `interrupted` is asked between two steps, about every 50 ms.
    Outcome advance(std::int64_t steps, double dt, int threads,
                    const std::function<bool()>& interrupted);

    // Take steps and store frames, at most so many of either. It ends sooner at an event, which the
    // caller has to report before he goes on.
    Outcome record(FixedRun& run, const FrameArrays& arrays, std::int64_t most_steps,
                   std::size_t most_frames, int threads, const std::function<bool()>& interrupted);
    // Error control, for one member whose integrator has it. Dense output gives frames within steps until an obstacle responds after a step, and from
    // then on `interpolate`.
    Outcome record(AdaptiveRun& run, const FrameArrays& arrays, std::int64_t most_steps,
                   std::size_t most_frames, int threads, const std::function<bool()>& interrupted);

    // Sample depths of triangles and stretches after every `every` steps; an adaptive run also
    // after `interval` [s].
    void set_watch(std::int64_t every, double interval) {
        sample_every_ = every;
        sample_interval_ = interval;
    }
    void set_watch_energy(bool on) { watch_energy_ = on; }
    // Sample the present state of every member, and its energy, whenever that is due.
    void sample();
    const Watched& watched(std::size_t i) const { return members_[i]->watched; }
    // Return whether Watched::energy_gained has a meaning: until a sphere responds, from the first
    // step on.
    bool energy_known(std::size_t i) const {
        return watches_[i].begun() && !members_[i]->watched.responded;
    }

private:
    struct Steps {
        std::int64_t count;
        bool inspect;  // at the state after them
        // The steps are repeated one by one, to find the one that went wrong.
        bool each = false;
    };
    void each_member_of(const std::vector<std::size_t>& members, int threads,
                        const MemberWork& work);
    // Take at most `steps` steps of `run`, until one ends at the time `until` or after it.
    Outcome advance_adaptive(AdaptiveRun& run, double until, std::int64_t steps, int threads,
                             const std::function<bool()>& interrupted);
    // Write the state at a time within the last step of `run`.
    void store_within(const AdaptiveRun& run, double t, double* x, double* v, int threads);
    void run(const Steps& steps, int threads);
    void find_forces_of_caller();
    void advance_and_inspect_member(std::size_t i, const Steps& steps, bool copy, int threads);
    void set_step(double dt);
    // Add the events of contacts in the steps so far, up to the time t.
    void report_contacts(Outcome& outcome, double t);
    void note_pinned_inside(std::size_t i, double t);
    void report_depths(std::size_t i, Outcome& outcome, double t);
    // Take steps of a member, one by one where a point may pass an obstacle in one: their paths
    // tell.
    void advance_member(std::size_t i, const Clock& from, std::int64_t steps, int threads);
    bool may_pass(std::size_t i, double dt) const;
    // A point that has left a layer on its inner side.
    struct Passage {
        std::int64_t point = -1, obstacle = -1;
        double depth = 0;
    };
    static Passage deepest_passage(const std::vector<Depth>& depths, const Plan& plan);
    // Return the passage at the time t, or in a step before.
    Passage find_passage(std::size_t i, double t) const;
    // Look whether a member's state is finite. The energy is looked at where that is due, at the
    // end of a call above the guaranteed time step, and after `each` repeated step.
    void inspect(std::size_t i, std::int64_t age, bool each);
    // Return the steps between two inspections of the energy of a member, and of all.
    std::int64_t energy_period(std::size_t i) const;
    std::int64_t energy_period() const;
    void begin_watches();
    // Sample a member's state, of time t.
    void sample(std::size_t i, double t);
    void sample_accepted(double t);
    std::int64_t first_bad_member() const;  // as last inspected, or -1
    void end_block();
    void back_to_start_of_block();
    void back_to_start_of_block(std::size_t i);
    // A state is bad: take the steps of this call in the block again one by one, up to the last
    // good state.
    void repeat_step_by_step(Outcome& outcome, int threads, Poll& poll);

    bool by_caller_ = false;
    std::int64_t chunk_ = 1;  // steps between two questions for Ctrl-C
    std::vector<std::unique_ptr<Engine>> members_;
    std::int64_t points_ = 0;  // of all members
    std::vector<double> stable_dt_;
    std::vector<std::uint8_t> frozen_;
    std::vector<std::size_t> all_, moving_;  // members; those that are not frozen, in this block
    // The first bad mass point of each member at its last inspection, or -1.
    std::vector<std::int64_t> bad_points_;
    bool in_block_ = false;
    std::int64_t steps_in_block_ = 0;  // so far
    // Brings the state at the start of the block; null: copies in the engines.
    const Load* input_ = nullptr;
    std::vector<EnergyWatch> watches_;
    std::vector<Passage> passages_;
    std::vector<std::vector<double>> stable_depths_;
    std::vector<std::uint8_t> silent_below_, silent_stiff_;
    std::vector<std::int64_t> pinned_inside_;  // a point of each member below a surface, or -1
    bool watch_energy_ = true;
    std::int64_t age_ = 0;  // steps since the state was set
    std::int64_t sample_every_ = 0;  // steps; 0: nothing is sampled
    double sample_interval_ = 0;  // [s]
    double last_sample_ = 0;  // of an adaptive run: its time [s], and steps since
    std::int64_t steps_since_sample_ = 0;
    std::vector<double> speed_limits_;  // of the members, at the clock's time step
};

}  // namespace clothsim
