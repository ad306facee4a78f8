// How the states of a simulation are judged and sampled.
#include <algorithm>

#include "driver/simulation.hpp"
#include "measure/diagnostics.hpp"

namespace clothsim {
namespace {

// Energies are compared after every so many steps of a run; above the guaranteed time step sooner, as growth
// is likely.
constexpr std::int64_t steps_between_energies = most_steps_unchecked,
                       steps_between_energies_above = EnergyWatch::steps_between_checks;

// Of all members. Up to here a state becomes a checkpoint early, by the clock on the wall, only if its energy
// is right too. Else the step named as unstable would depend on how busy the machine is. Half: more cloths
// whose step is named up to 128 steps late. Twice: up to 5 % more time.
constexpr std::int64_t most_points_judged_early = 16384;

}  // namespace

bool Simulation::above_stable_dt() const {
    for (std::size_t i = 0; i < members_.size(); ++i)
        if (!frozen_[i] && clock.dt > stable_dt_[i]) return true;
    return false;
}

std::int64_t Simulation::energy_period(std::size_t i) const {
    return clock.dt > stable_dt_[i] ? steps_between_energies_above : steps_between_energies;
}

std::int64_t Simulation::energy_period() const {
    return above_stable_dt() ? steps_between_energies_above : steps_between_energies;
}

void Simulation::begin_watches() {
    for (std::size_t i = 0; i < members_.size(); ++i)
        if (watch_energy_ && !frozen_[i]) watches_[i].begin(*members_[i]);
}

void Simulation::inspect(std::size_t i, std::int64_t age, bool each) {
    bad_points_[i] = -1;
    if (frozen_[i]) return;
    bad_points_[i] = members_[i]->first_bad_point(speed_limits_[i]);
    const bool due = age % energy_period(i) == 0;
    // A checkpoint is taken where states are sampled, and must be a good one.
    const bool sampled = sample_every_ > 0 && age % sample_every_ == 0;
    if (bad_points_[i] < 0 && (due || sampled || each || clock.dt > stable_dt_[i]))
        bad_points_[i] = watches_[i].runaway_point(*members_[i], due);
}

void Simulation::inspect() {
    for (std::size_t i = 0; i < members_.size(); ++i) inspect(i, age_, false);
}

void Simulation::set_watch(std::int64_t every, double interval) {
    sample_every_ = every;
    sample_interval_ = interval;
    for (auto& member : members_) member->watch_depths(every > 0);
}

void Simulation::sample(std::size_t i, double t) {
    const Plan& plan = plans_[i];
    Engine& member = *members_[i];
    Points x(plan.cloth.points(), 3);
    member.store(x.data(), static_cast<double*>(nullptr));
    const PointsView view(x.data(), x.rows(), 3);
    member.watched.stretch = std::max(member.watched.stretch, largest_stretch(plan.cloth, view));
    for (const Sphere& sphere : plan.spheres) {
        const Penetration depth =
            penetration(plan.cloth.rows, plan.cloth.columns, view, sphere.center_at(t), sphere.radius);
        member.watched.triangle_depth = std::max(member.watched.triangle_depth, depth.triangles);
    }
}

void Simulation::sample() {
    begin_watches();
    for (std::size_t i = 0; i < members_.size(); ++i) {
        if (frozen_[i]) continue;
        if (sample_every_ > 0) {
            if (age_ == 0) members_[i]->note_all_depths(clock.now());
            sample(i, clock.now());
        }
        watches_[i].runaway_point(*members_[i], true);
    }
}

bool Simulation::may_be_checkpoint() {
    if (points_ > most_points_judged_early) return true;
    return std::all_of(all_.begin(), all_.end(), [&](std::size_t i) {
        return frozen_[i] || watches_[i].runaway_point(*members_[i], false) < 0;
    });
}

std::int64_t Simulation::first_bad_member() const {
    for (std::size_t i = 0; i < members_.size(); ++i)
        if (bad_points_[i] >= 0 || members_[i]->contact_report.trapped >= 0) return std::int64_t(i);
    return -1;
}

}  // namespace clothsim
