#include "simulation/simulation.hpp"

#include <algorithm>
#include <chrono>
#include <limits>
#include <utility>

#include "simulation/diagnostics.hpp"

namespace clothsim {
namespace {

using std::chrono::steady_clock;

// Steps between two looks at the state: an unstable run is caught within so many steps of its first non-finite
// value, then the exact step is found by going back. Keeping the state to go back to and looking at it cost about as
// much as a step of a cloth that does not fit in cache, so steps that take long are not looked at one by one either.
constexpr std::int64_t fewest_steps_unchecked = 16, most_steps_unchecked = 64;
// Above the guaranteed time step energies are compared too, after every so many steps of the clock.
constexpr std::int64_t steps_between_energies = 16;
constexpr double seconds_between_polls = 0.01;

// How often the alternative of a team choice is tried again, at the price of one chunk each time.
constexpr double seconds_between_trials = 0.5;
constexpr double disaster = 3;  // times what the alternative cost

double seconds_since(steady_clock::time_point start) {
    return std::chrono::duration<double>(steady_clock::now() - start).count();
}

}  // namespace

void TeamChoice::observe(double seconds_per_step, double seconds) {
    const double other = cost_[!use_team_];
    since_change_ += seconds;
    // The first chunk after a change wakes threads and fills caches; only a disaster counts.
    if (std::exchange(just_changed_, false) && (other == 0 || seconds_per_step < disaster * other)) return;
    cost_[use_team_] = seconds_per_step;
    if (other == 0 || seconds_per_step > other || since_change_ > seconds_between_trials) {
        use_team_ = !use_team_;
        just_changed_ = true;
        since_change_ = 0;
    }
}

Simulation::Simulation(const std::vector<Plan>& plans, double time) : plans_(plans) {
    members_.reserve(plans.size());
    for (const Plan& plan : plans) members_.push_back(make_engine(plan));
    stable_dt_.assign(plans.size(), std::numeric_limits<double>::infinity());
    frozen_.assign(plans.size(), 0);
    for (const Plan& plan : plans_) watches_.emplace_back(plan);
    clock.origin = time;
}

void Simulation::set_stable_dt(std::vector<double> stable_dt) {
    stable_dt_ = std::move(stable_dt);
    speed_limits_.clear();
}

void Simulation::advance_members(std::int64_t steps, int threads) {
    const std::int64_t count = std::int64_t(members_.size());
    if (count == 1) {
        if (!frozen_[0]) members_[0]->advance_in_contact(steps, clock, threads);
        return;
    }
    const int team = int(std::min<std::int64_t>(threads, count));
#pragma omp parallel for num_threads(team) if (team > 1) schedule(dynamic)
    for (std::int64_t i = 0; i < count; ++i)
        if (!frozen_[std::size_t(i)]) members_[std::size_t(i)]->advance_in_contact(steps, clock, 1);
}

bool Simulation::above_stable_dt() const {
    for (std::size_t i = 0; i < members_.size(); ++i)
        if (!frozen_[i] && clock.dt > stable_dt_[i]) return true;
    return false;
}

std::int64_t Simulation::bad_point(std::size_t i, int threads) {
    if (frozen_[i]) return -1;
    const std::int64_t point = members_[i]->first_bad_point(speed_limits_[i], threads);
    return point < 0 && clock.dt > stable_dt_[i] ? watches_[i].runaway_point(*members_[i]) : point;
}

std::int64_t Simulation::first_bad_member(int threads) {
    for (std::size_t i = 0; i < members_.size(); ++i)
        if (bad_point(i, threads) >= 0 || members_[i]->contact_report.shut_in >= 0) return std::int64_t(i);
    return -1;
}

void Simulation::set_step(double dt) {
    if (dt == clock.dt && !speed_limits_.empty()) return;
    clock.set_step(dt);
    speed_limits_.clear();
    for (std::size_t i = 0; i < plans_.size(); ++i)
        speed_limits_.push_back(runaway_speed(plans_[i].cloth, dt, stable_dt_[i]));
}

Outcome::Unstable Simulation::rewind_to_last_good(std::int64_t steps, int threads) {
    for (auto& member : members_) {
        member->restore_checkpoint();
        member->contact_report.shut_in = -1;
    }
    for (std::int64_t k = 0; k < steps; ++k) {
        for (auto& member : members_) member->save_checkpoint(threads);
        advance_members(1, threads);
        const std::int64_t bad = first_bad_member(threads);
        if (bad >= 0) {
            const std::int64_t point = bad_point(std::size_t(bad), threads);
            const std::int64_t shut_in = std::exchange(members_[std::size_t(bad)]->contact_report.shut_in, -1);
            for (auto& member : members_) member->restore_checkpoint();
            return {bad, point >= 0 ? point : shut_in, k + 1, clock.at(1), point < 0};
        }
        clock.steps += 1;
    }
    return {0, 0, steps, clock.now(), false};  // not reached: the same steps give the same bits
}

Outcome Simulation::advance(std::int64_t steps, double dt, int threads, bool optional,
                            const std::function<bool()>& interrupted) {
    set_step(dt);
    Outcome outcome;
    const bool watched = above_stable_dt();
    if (watched && steps > 0) first_bad_member(threads);  // notes the energies to begin with
    auto last_poll = steady_clock::now();
    while (outcome.steps < steps) {
        const auto team = [&] { return optional && !choice_.team() ? 1 : threads; };
        std::int64_t n = std::min(std::max(chunk_, fewest_steps_unchecked), steps - outcome.steps);
        // At the same steps whatever the clock on the wall says.
        if (watched) n = std::min(steps_between_energies - clock.steps % steps_between_energies, steps - outcome.steps);
        for (auto& member : members_) member->save_checkpoint(team());
        std::int64_t done = 0;
        while (done < n && !outcome.interrupted) {
            const std::int64_t part = watched ? n : std::min(chunk_, n - done);
            const auto start = steady_clock::now();
            advance_members(part, team());
            clock.steps += part;
            done += part;
            bool shut_in = false;
            for (std::size_t i = 0; i < members_.size(); ++i) {
                const std::int64_t point = std::exchange(members_[i]->contact_report.pinned_inside, -1);
                if (point >= 0 && !outcome.pinned_inside) outcome.pinned_inside = {std::int64_t(i), point};
                shut_in |= members_[i]->contact_report.shut_in >= 0;
            }
            if (shut_in) break;
            const double seconds = seconds_since(start);
            const double per_step = seconds / double(part);
            if (optional && threads > 1) choice_.observe(per_step, seconds);
            chunk_ = std::clamp(std::int64_t(seconds_between_polls / std::max(per_step, 1e-9)), std::int64_t(1),
                                most_steps_unchecked);
            if (seconds_since(last_poll) > seconds_between_polls) {
                outcome.interrupted = interrupted();
                last_poll = steady_clock::now();
            }
        }
        if (first_bad_member(team()) >= 0) {
            clock.steps -= done;
            outcome.unstable = rewind_to_last_good(done, threads);
            outcome.unstable->step += outcome.steps;
            outcome.steps = outcome.unstable->step - 1;
            return outcome;
        }
        outcome.steps += done;
        if (outcome.interrupted) return outcome;
    }
    return outcome;
}

std::vector<double> Simulation::largest_stretch() const {
    std::vector<double> result(members_.size()), x, v;
    for (std::size_t i = 0; i < members_.size(); ++i) {
        const Cloth& cloth = plans_[i].cloth;
        x.resize(std::size_t(cloth.points()) * 3);
        v.resize(x.size());
        members_[i]->store(x.data(), v.data());
        const double largest = clothsim::largest_stretch(cloth, {x.data(), cloth.points(), 3});
        result[i] = largest < -1 ? 0 : largest;  // no length is below 0
    }
    return result;
}

}  // namespace clothsim
