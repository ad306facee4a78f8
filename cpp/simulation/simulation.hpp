// One cloth, or a batch of cloths of one shape, advanced together.
#pragma once

#include <functional>
#include <optional>

#include "simulation/stability.hpp"

namespace clothsim {

// How a call of `advance` ended. The state is at a whole step in every case.
struct Outcome {
    std::int64_t steps = 0;  // done
    bool interrupted = false;
    struct Unstable {
        std::int64_t member, point;
        std::int64_t step;  // of this call, the first whose result is not finite or has run away
        double time;
        bool shut_in = false;  // finite, but the spheres leave this point no place
    };
    std::optional<Unstable> unstable;  // state: the last good one, one step before
    struct PinnedInside {
        std::int64_t member, point;
    };
    std::optional<PinnedInside> pinned_inside;  // a continuous sphere has run into a pinned point
};

// Chooses between one thread and a team by what their steps were seen to cost. The result has the same bits
// either way, so a machine whose processors are taken by others costs time, not a result.
class TeamChoice {
public:
    bool team() const { return use_team_; }
    void observe(double seconds_per_step, double seconds);

private:
    double cost_[2] = {0, 0};  // last seconds per step of one thread and of the team; 0: not seen yet
    double since_change_ = 0;  // seconds
    bool use_team_ = true;
    bool just_changed_ = true;
};

class Simulation {
public:
    explicit Simulation(const std::vector<Plan>& plans, double time);

    std::size_t size() const { return members_.size(); }
    Engine& member(std::size_t i) { return *members_[i]; }
    // To be called when a member's state was set from outside.
    void restart(std::size_t i) { watches_[i].restart(); }
    const Engine& member(std::size_t i) const { return *members_[i]; }

    Clock clock;

    // The guaranteed time step of each member [s]: only above it a point can be too fast. Default: infinite.
    void set_stable_dt(std::vector<double> stable_dt);

    // A frozen member takes no part in further steps: it keeps its state, and the others go on without it.
    void set_frozen(std::size_t i, bool frozen) { frozen_[i] = frozen; }
    bool frozen(std::size_t i) const { return frozen_[i] != 0; }

    // At most `threads` threads; if they are `optional`, one instead wherever that is measured to be faster.
    // `interrupted` is asked about every 10 ms, between steps.
    Outcome advance(std::int64_t steps, double dt, int threads, bool optional,
                    const std::function<bool()>& interrupted);

    // Error control, for one member whose integrator has it: steps until `until` is reached or passed, the last of
    // them no longer than to `end`, at most `steps` of them.
    struct AdaptiveRequest {
        double until, end;
        std::int64_t steps;
        Tolerance tolerance;
        double longest;  // step [s]
        int threads;
        bool optional;  // the threads, see above
    };
    struct AdaptiveOutcome : Outcome {
        std::int64_t rejected = 0, contacts = 0;  // steps tried in vain, and steps that ended in contact
    };
    AdaptiveOutcome advance_adaptive(const AdaptiveRequest& request, StepController& controller,
                                     const std::function<bool()>& interrupted);
    // The state at a time within the last step of `advance_adaptive`.
    void dense(double t, double* x, double* v, int threads);

    // Of every member, see diagnostics.hpp; 0 for one without springs.
    std::vector<double> largest_stretch() const;

private:
    void advance_members(std::int64_t steps, int threads);
    void set_step(double dt);
    bool above_stable_dt() const;
    std::int64_t bad_point(std::size_t i, int threads);  // of a member that has no result, or -1
    std::int64_t first_bad_member(int threads);
    Outcome::Unstable rewind_to_last_good(std::int64_t steps, int threads);

    TeamChoice choice_;
    std::int64_t chunk_ = 1;  // steps between two looks at the clock on the wall
    std::vector<Plan> plans_;
    std::vector<std::unique_ptr<Engine>> members_;
    std::vector<double> stable_dt_;
    std::vector<std::uint8_t> frozen_;
    std::vector<EnergyWatch> watches_;
    std::vector<double> speed_limits_;  // of the members, at the clock's time step
    double last_begin_ = 0, last_step_ = 0;  // the last step of `advance_adaptive`
};

}  // namespace clothsim
