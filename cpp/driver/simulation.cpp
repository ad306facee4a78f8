#include "driver/simulation.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <limits>
#include <numeric>
#include <utility>

#include "memory/threads.hpp"

namespace clothsim {
namespace {

// A checkpoint serves later calls too, so that a call of one step need not copy the state. To go back over
// the steps of earlier calls cannot be interrupted, and takes no longer than this. Half or twice: as
// long without Ctrl-C.
constexpr double most_seconds_of_earlier_calls = 0.5;
constexpr double seconds_between_polls = 0.01;  // not tuned: below what a person notices
// Of steps between separating planes since a checkpoint. Where a plane is crossed, they are repeated with a
// contact pass each, and Ctrl-C waits for them.
constexpr double most_seconds_behind_planes = 0.004;
// Of a batch later: each member has to come into cache, and should then be stepped more than once. Half or
// twice: as long until Ctrl-C is seen.
constexpr double seconds_of_batch = 0.05;

}  // namespace

Simulation::Simulation(const std::vector<Plan>& plans, double time, int threads) : plans_(plans) {
    members_.reserve(plans.size());
    for (const Plan& plan : plans) members_.push_back(make_engine(plan));
    if (members_.size() == 1) members_[0]->threads = threads;
    stable_dt_.assign(plans.size(), std::numeric_limits<double>::infinity());
    frozen_.assign(plans.size(), 0);
    bad_points_.assign(plans.size(), -1);
    all_.resize(plans.size());
    std::iota(all_.begin(), all_.end(), std::size_t(0));
    for (const Plan& plan : plans_) watches_.emplace_back(plan);
    clock.origin = time;
    for (const Plan& plan : plans_) points_ += plan.cloth.points();
}

void Simulation::set_stable_dt(std::vector<double> stable_dt) {
    stable_dt_ = std::move(stable_dt);
    speed_limits_.clear();
}

void Simulation::set_plans(std::vector<Plan> plans, std::vector<double> stable_dt) {
    std::vector<std::unique_ptr<Engine>> members;
    std::vector<EnergyWatch> watches;
    watches.reserve(plans.size());
    for (std::size_t i = 0; i < plans.size(); ++i) {
        members.push_back(make_engine(plans[i]));
        Engine& member = *members.back();
        member.threads = members_[i]->threads;
        member.watch_depths(sample_every_ > 0);
        member.set_saved_state(members_[i]->saved_state());
        if (!frozen_[i]) member.place_pins(clock.now());
        watches.emplace_back(plans[i]);  // refers to the plan, which stays where it is
    }
    plans_.swap(plans);
    members_.swap(members);
    watches_.swap(watches);
    set_stable_dt(std::move(stable_dt));
    for (const std::size_t i : all_) restart(i);
}

void Simulation::restart(std::size_t i) {
    watches_[i].restart();
    members_[i]->watched = {};
    age_ = 0;
    bad_points_[i] = -1;
    checkpoint_.drop();
}

std::optional<Outcome> Simulation::call(double time, const Checkpoint::Load& load, std::int64_t steps,
                                        double dt, int threads, const std::function<bool()>& interrupted) {
    clock = {time, 0, clock.dt};
    set_step(dt);
    std::fill(frozen_.begin(), frozen_.end(), 0);
    const Checkpoint::Load load_state = [&](std::size_t i) {
        const bool finite = load(i);
        members_[i]->place_pins(time);
        return finite;
    };
    std::atomic<bool> finite{true};
    each_member(threads, [&](std::size_t i, int team) {
        members_[i]->threads = team;
        members_[i]->begin_anew();
        if (!load_state(i)) finite = false;
    });
    for (const std::size_t i : all_) restart(i);
    if (!finite) return {};
    checkpoint_.take_input(load_state);
    const Outcome outcome = advance(steps, dt, threads, interrupted);
    checkpoint_.drop();
    return outcome;
}

void Simulation::set_sphere(std::size_t i, std::size_t sphere, const Vec3& center, const Motion& motion) {
    plans_[i].spheres[sphere].center = center;
    plans_[i].spheres[sphere].motion = motion;
    members_[i]->set_sphere(sphere, center, motion);
    checkpoint_.drop();
}

void Simulation::set_force(std::size_t i, const double* force) {
    watches_[i].change_force(*members_[i], [&] {
        plans_[i].force = PointsView(force, plans_[i].cloth.points(), 3);
        members_[i]->set_force(force);
    });
    checkpoint_.drop();
}

void Simulation::set_frozen(std::size_t i, bool frozen) {
    frozen_[i] = frozen;
    bad_points_[i] = -1;
    checkpoint_.drop();
}

void Simulation::set_step(double dt) {
    if (dt == clock.dt && !speed_limits_.empty()) return;
    clock.set_step(dt);
    checkpoint_.drop();
    speed_limits_.clear();
    for (std::size_t i = 0; i < plans_.size(); ++i)
        speed_limits_.push_back(runaway_speed(plans_[i].cloth, dt, stable_dt_[i]));
    for (std::size_t i = 0; i < plans_.size(); ++i) watches_[i].set_step(dt, stable_dt_[i]);
}

// All of it member by member, so that the state of a member is in cache for it.
void Simulation::run_member(std::size_t i, const Block& block, bool copy, int threads) {
    Engine& member = *members_[i];
    member.threads = threads;
    if (copy) checkpoint_.copy(i);
    if (!member.advance_in_contact(block.steps, clock, threads, true)) {
        checkpoint_.restore(i);
        Clock from = clock;
        from.steps -= checkpoint_.steps();
        member.advance_in_contact(checkpoint_.steps() + block.steps, from, threads, false);
    }
    if (block.inspect) inspect(i, age_ + block.steps, block.each);
    if (sample_every_ > 0 && (age_ + block.steps) % sample_every_ == 0) sample(i, clock.at(block.steps));
}

void Simulation::run(const Block& block, int threads) {
    const bool copy = !checkpoint_.taken();
    if (copy) checkpoint_.take();
    moving_.clear();
    for (const std::size_t i : all_)
        if (!frozen_[i]) moving_.push_back(i);
    try {
        each_member_of(moving_, plans_[0].cloth.points(), threads,
                       [&](std::size_t i, int team) { run_member(i, block, copy, team); });
    } catch (...) {
        checkpoint_.drop();  // some members have a copy of another step
        throw;
    }
    checkpoint_.pass(block.steps);
    clock.steps += block.steps;
    age_ += block.steps;
}

void Simulation::back_to_checkpoint() {
    for (std::size_t i = 0; i < members_.size(); ++i) {
        if (!frozen_[i]) checkpoint_.restore(i);
        members_[i]->contact_report = {};
        bad_points_[i] = -1;
    }
    clock.steps -= checkpoint_.steps();
    age_ -= checkpoint_.steps();
    checkpoint_.restored();
}

void Simulation::repeat_step_by_step(Outcome& outcome, int threads, Poll& poll) {
    const std::int64_t all = checkpoint_.steps(), steps = std::min(all, outcome.steps);
    back_to_checkpoint();
    begin_watches();  // at the input, if it did not pay
    if (all > steps) run({all - steps, false}, threads);
    outcome.steps -= steps;
    for (std::int64_t k = 0; k < steps; ++k, ++outcome.steps) {
        outcome.interrupted = poll.stopped();
        if (outcome.interrupted) break;
        checkpoint_.drop();
        run({1, true, true}, threads);
        const std::int64_t bad = first_bad_member();
        if (bad < 0) continue;
        const std::int64_t point = bad_points_[std::size_t(bad)];
        const ContactReport contact = members_[std::size_t(bad)]->contact_report;
        back_to_checkpoint();
        outcome.unstable = {bad, point >= 0 ? point : contact.trapped, outcome.steps + 1, clock.at(1),
                            point < 0};
        break;
    }
    for (auto& member : members_) member->contact_report = {};
    checkpoint_.drop();
}

Outcome Simulation::advance(std::int64_t steps, double dt, int threads,
                            const std::function<bool()>& interrupted) {
    set_step(dt);
    Outcome outcome;
    const std::int64_t energy_period = this->energy_period();
    // A call with arrays that ends before energies are compared needs none of them.
    const bool watched = above_stable_dt() || !checkpoint_.is_input() || steps >= energy_period;
    if (steps > 0 && watched) begin_watches();
    const bool continuous = !above_stable_dt() &&
        std::any_of(members_.begin(), members_.end(),
                    [](const auto& member) { return member->has_continuous(); });
    const double longest = members_.size() > 1 ? seconds_of_batch
        : continuous                           ? most_seconds_behind_planes
                                               : seconds_between_polls;
    const double renewal = continuous ? most_seconds_behind_planes : std::numeric_limits<double>::infinity();
    const double oldest = above_stable_dt() ? 0 : most_seconds_of_earlier_calls;
    if (checkpoint_.steps() > 0 && checkpoint_.seconds() > oldest) checkpoint_.drop();
    Poll poll(interrupted);
    auto start = poll.asked();
    while (outcome.steps < steps) {
        // Energies are compared, and states sampled, at the same steps whatever the clock on the wall says.
        const std::int64_t to_energies = energy_period - age_ % energy_period;
        const std::int64_t to_sample =
            sample_every_ > 0 ? sample_every_ - age_ % sample_every_ : most_steps_unchecked;
        const std::int64_t to_inspection = std::min(
            {most_steps_unchecked - checkpoint_.steps(), to_energies, to_sample, steps - outcome.steps});
        const std::int64_t n = std::min(chunk_, to_inspection);
        const bool renew = checkpoint_.seconds() > renewal;
        run({n, n == to_inspection || renew}, threads);
        outcome.steps += n;
        const auto end = Poll::Clock::now();
        const double seconds = std::chrono::duration<double>(end - start).count();
        step_seconds_ = seconds / double(n);
        checkpoint_.spend(seconds);
        chunk_ = std::clamp(std::int64_t(longest / std::max(step_seconds_, 1e-9)), std::int64_t(1),
                            most_steps_unchecked);
        for (std::size_t i = 0; i < members_.size(); ++i) {
            ContactReport& found = members_[i]->contact_report;
            const std::int64_t pinned = std::exchange(found.pinned_inside, -1),
                               capped = std::exchange(found.capped, -1);
            if (pinned >= 0 && !outcome.pinned_inside) outcome.pinned_inside = {std::int64_t(i), pinned};
            if (capped >= 0 && !outcome.capped) outcome.capped = {std::int64_t(i), capped};
        }
        outcome.interrupted = poll.stopped(end);
        start = std::max(end, poll.asked());
        if (outcome.interrupted && n < to_inspection && !renew) inspect();
        if (first_bad_member() >= 0) {
            repeat_step_by_step(outcome, threads, poll);
            return outcome;
        }
        for (std::size_t i = 0; i < members_.size(); ++i)
            if (watches_[i].take_growth() && !outcome.grown) outcome.grown = std::int64_t(i);
        // The next checkpoint is the state of this inspection, so that steps which are repeated pass none.
        if (checkpoint_.steps() >= most_steps_unchecked || n == to_energies || n == to_sample ||
            (renew && may_be_checkpoint()))
            checkpoint_.drop();
        if (outcome.interrupted || outcome.grown) return outcome;
    }
    return outcome;
}

}  // namespace clothsim
