// How the states of a simulation are judged and sampled.
#include <algorithm>

#include "driver/simulation.hpp"
#include "measure/diagnostics.hpp"

namespace clothsim {

bool Simulation::above_stable_dt() const {
    for (std::size_t i = 0; i < members_.size(); ++i)
        if (!frozen_[i] && clock.dt > stable_dt_[i]) return true;
    return false;
}

std::int64_t Simulation::energy_period(std::size_t i) const {
    return clock.dt > stable_dt_[i] ? EnergyWatch::steps_between_checks : most_steps_of_block;
}

std::int64_t Simulation::energy_period() const {
    return above_stable_dt() ? EnergyWatch::steps_between_checks : most_steps_of_block;
}

void Simulation::begin_watches() {
    for (std::size_t i = 0; i < members_.size(); ++i)
        if (watch_energy_ && !frozen_[i]) watches_[i].begin(*members_[i]);
}

void Simulation::inspect(std::size_t i, std::int64_t age, bool each) {
    bad_points_[i] = -1;
    if (frozen_[i]) return;
    bad_points_[i] = members_[i]->first_bad_point(speed_limits_[i]);
    members_[i]->note_large_cells(clock.at(age - age_));
    const bool due = age % energy_period(i) == 0;
    // A block begins where states are sampled, at a good one.
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
}

void Simulation::sample(std::size_t i, double t) {
    const Plan& plan = plans_[i];
    Engine& member = *members_[i];
    Points x(plan.cloth.points(), 3);
    member.store(x.data(), static_cast<double*>(nullptr));
    const PointsView view(x.data(), x.rows(), 3);
    member.watched.stretch = std::max(member.watched.stretch, largest_stretch(plan.cloth, view));
    for (const Sphere& sphere : plan.spheres) {
        const Penetration depth = penetration(plan.cloth.rows, plan.cloth.columns, view, sphere, t);
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

std::int64_t Simulation::first_bad_member() const {
    for (std::size_t i = 0; i < members_.size(); ++i)
        if (bad_points_[i] >= 0 || members_[i]->contact_report.trapped >= 0) return std::int64_t(i);
    return -1;
}

}  // namespace clothsim
