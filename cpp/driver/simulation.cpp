#include "driver/simulation.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <limits>
#include <numeric>
#include <utility>

#include "forces/function.hpp"
#include "measure/diagnostics.hpp"
#include "memory/threads.hpp"

namespace clothsim {

Simulation::Simulation(const std::vector<Plan>& plans, double time, int threads) {
    members_.reserve(plans.size());
    for (const Plan& plan : plans) members_.push_back(make_engine(plan));
    if (members_.size() == 1) members_[0]->threads = threads;
    stable_dt_.assign(plans.size(), std::numeric_limits<double>::infinity());
    frozen_.assign(plans.size(), 0);
    bad_points_.assign(plans.size(), -1);
    passages_.assign(plans.size(), {});
    pinned_inside_.assign(plans.size(), -1);
    silent_below_.assign(plans.size(), 0);
    silent_stiff_.assign(plans.size(), 0);
    stable_depths_.resize(plans.size());
    all_.resize(plans.size());
    std::iota(all_.begin(), all_.end(), std::size_t(0));
    for (const auto& member : members_) watches_.emplace_back(member->plan());
    clock.origin = time;
    for (const Plan& plan : plans) points_ += plan.cloth.points();
    find_forces_of_caller();
}

void Simulation::find_forces_of_caller() {
    by_caller_ = false;
    for (const auto& member : members_)
        for (const auto& force : member->plan().forces)
            if (const auto* function = dynamic_cast<const FunctionForce*>(force.get()))
                by_caller_ |= members_.size() > 1 && function->forces_need_caller;
}

void Simulation::set_stable_dt(std::vector<double> stable_dt) {
    stable_dt_ = std::move(stable_dt);
    speed_limits_.clear();
}

void Simulation::set_stable_layer_depths(std::size_t i, std::vector<double> depths) {
    stable_depths_[i] = std::move(depths);
}

void Simulation::set_plans(const std::vector<Plan>& plans, std::vector<double> stable_dt) {
    std::vector<std::unique_ptr<Engine>> members;
    std::vector<EnergyWatch> watches;
    watches.reserve(plans.size());
    for (std::size_t i = 0; i < plans.size(); ++i) {
        members.push_back(make_engine(plans[i]));
        Engine& member = *members.back();
        member.threads = members_[i]->threads;
        SavedState state = members_[i]->saved_state();
        state.normals.clear();  // They belong to other obstacles.
        member.set_saved_state(state, clock.now());
        if (!frozen_[i]) member.place_pins(clock.now());
        watches.emplace_back(member.plan());
    }
    members_.swap(members);
    watches_.swap(watches);
    find_forces_of_caller();
    set_stable_dt(std::move(stable_dt));
    for (const std::size_t i : all_) {
        stable_depths_[i].clear();
        restart(i);
    }
}

void Simulation::restart(std::size_t i) {
    watches_[i].restart();
    members_[i]->watched = {};
    members_[i]->contacts.forget_extremes();
    age_ = 0;
    bad_points_[i] = -1;
    passages_[i] = {};
    silent_below_[i] = silent_stiff_[i] = 0;
    end_block();
}

std::optional<Outcome> Simulation::call(double time, const Load& load, std::int64_t steps,
                                        double dt, int threads,
                                        const std::function<bool()>& interrupted) {
    clock = {time, 0, clock.dt};
    set_step(dt);
    std::fill(frozen_.begin(), frozen_.end(), 0);
    const Load load_state = [&](std::size_t i) {
        const bool finite = load(i);
        members_[i]->place_pins(time);
        return finite;
    };
    std::atomic<bool> finite{true};
    each_member(threads, [&](std::size_t i, int team) {
        members_[i]->threads = team;
        members_[i]->clear_counts();
        if (!load_state(i)) finite = false;
    });
    for (const std::size_t i : all_) {
        restart(i);
        if (find_passage(i, time).obstacle >= 0) finite = false;
    }
    if (!finite) return {};
    in_block_ = true;
    input_ = &load_state;
    try {
        const Outcome outcome = advance(steps, dt, threads, interrupted);
        end_block();
        return outcome;
    } catch (...) {
        end_block();
        throw;
    }
}

void Simulation::set_sphere(std::size_t i, std::size_t sphere, const Vec3& center,
                            const Motion& motion) {
    watches_[i].change_scene(*members_[i], clock.now(),
                             [&] { members_[i]->set_sphere(sphere, center, motion); });
    end_block();
}

void Simulation::set_force(std::size_t i, const double* force) {
    watches_[i].change_scene(*members_[i], clock.now(), [&] { members_[i]->set_force(force); });
    end_block();
}

void Simulation::set_frozen(std::size_t i, bool frozen) {
    frozen_[i] = frozen;
    bad_points_[i] = -1;
    end_block();
}

void Simulation::set_step(double dt) {
    if (dt == clock.dt && !speed_limits_.empty()) return;
    clock.set_step(dt);
    end_block();
    speed_limits_.clear();
    for (std::size_t i = 0; i < members_.size(); ++i)
        speed_limits_.push_back(runaway_speed(plan(i).cloth, dt, stable_dt_[i]));
    for (std::size_t i = 0; i < members_.size(); ++i) watches_[i].set_step(dt, stable_dt_[i]);
}

// Everything is done member by member, so that the state of a member is in cache.
void Simulation::advance_and_inspect_member(std::size_t i, const Steps& steps, bool copy,
                                            int threads) {
    Engine& member = *members_[i];
    member.threads = threads;
    if (copy) member.save_checkpoint();
    advance_member(i, clock, steps.count, threads);
    if (steps.inspect) inspect(i, age_ + steps.count, steps.each);
    if (sample_every_ > 0 && (age_ + steps.count) % sample_every_ == 0)
        sample(i, clock.at(steps.count));
}

// A straight path between two places outside the layer goes through an obstacle only if it is
// longer than the chord of a sphere at the depth h in it.
bool Simulation::may_pass(std::size_t i, double dt) const {
    const double speed = members_[i]->has_penalty() ? members_[i]->speed_bound() : 0;
    return std::any_of(plan(i).spheres.begin(), plan(i).spheres.end(), [&](const Sphere& s) {
        const double chord =
            std::min(2 * s.radius, std::sqrt(8 * s.radius * std::max(s.thickness, 0.0)));
        // A point may double its speed within a block.
        return s.penalty() && !s.flat() && 2 * (speed + s.speed) * dt > chord;
    });
}

void Simulation::advance_member(std::size_t i, const Clock& from, std::int64_t steps, int threads) {
    Engine& member = *members_[i];
    if (!may_pass(i, from.dt)) return member.advance_and_respond(steps, from, threads);
    const Plan& plan = this->plan(i);
    Points before(plan.cloth.points(), 3), after = before;
    member.store(after.data(), nullptr);
    Clock now = from;
    for (std::int64_t k = 0; k < steps; ++k, ++now.steps) {
        before.swap(after);
        member.advance_and_respond(1, now, threads);
        member.store(after.data(), nullptr);
        for (std::size_t s = 0; s < plan.spheres.size(); ++s) {
            const Sphere& sphere = plan.spheres[s];
            if (!sphere.penalty() || sphere.flat()) continue;
            const double least = sphere.contact_radius() - sphere.thickness;
            const Vec3 center = sphere.center_at(now.at(0)), end = sphere.center_at(now.at(1));
            for (int p = 0; p < plan.cloth.points(); ++p) {
                if (plan.cloth.pinned[std::size_t(p)]) continue;
                const Vec3 a = before.row(p).transpose() - center;
                const Vec3 way = after.row(p).transpose() - end - a;
                const double length2 = way.squaredNorm();
                const double part = length2 > 0 ? std::clamp(-a.dot(way) / length2, 0.0, 1.0) : 0;
                if ((a + part * way).squaredNorm() >= least * least) continue;
                passages_[i] = {p, std::int64_t(s), std::sqrt(length2)};
                return;
            }
        }
    }
}

Simulation::Passage Simulation::deepest_passage(const std::vector<Depth>& depths,
                                                const Plan& plan) {
    Passage passage;
    for (std::size_t s = 0; s < depths.size(); ++s)
        if (beyond_layer(plan.spheres[s], depths[s].depth) && depths[s].depth > passage.depth)
            passage = {depths[s].point, std::int64_t(s), depths[s].depth};
    return passage;
}

Simulation::Passage Simulation::find_passage(std::size_t i, double t) const {
    if (!members_[i]->has_penalty() || passages_[i].obstacle >= 0) return passages_[i];
    std::vector<Depth> depths = members_[i]->depths(t);
    for (std::size_t s = 0; s < depths.size(); ++s)
        depths[s].depth = std::max(depths[s].depth, members_[i]->contacts.of(s).deepest);
    return deepest_passage(depths, plan(i));
}

void Simulation::each_member_of(const std::vector<std::size_t>& members, int threads,
                                const MemberWork& work) {
    // Most members are stepped by one thread each. The whole team steps those left one after the
    // other where that is faster.
    const std::size_t team = std::size_t(threads);
    const std::size_t left = members.size() % team;
    const bool shared = 4 * left <= 3 * team &&
        plan(0).cloth.points() >= heuristics::points_per_thread_of_step * threads;
    const std::size_t single_count = members.size() == 1 ? 0 : members.size() - (shared ? left : 0);
    std::atomic<std::size_t> next{0};
    if (single_count > 0)
        run_in_team(int(std::min(team, single_count)), [&](int, int) {
            for (std::size_t i; (i = next++) < single_count;) work(members[i], 1);
        });
    for (std::size_t i = single_count; i < members.size(); ++i) work(members[i], threads);
}

void Simulation::run(const Steps& steps, int threads) {
    const bool copy = !std::exchange(in_block_, true);
    moving_.clear();
    for (const std::size_t i : all_)
        if (!frozen_[i]) moving_.push_back(i);
    try {
        each_member_of(moving_, threads, [&](std::size_t i, int team) {
            advance_and_inspect_member(i, steps, copy, team);
        });
    } catch (...) {
        end_block();  // Some members have a copy of another step.
        throw;
    }
    steps_in_block_ += steps.count;
    clock.steps += steps.count;
    age_ += steps.count;
}

std::exception_ptr Simulation::take_force_failure() {
    std::exception_ptr first;
    for (const auto& member : members_) {
        std::exception_ptr failure = std::exchange(member->force_failure, nullptr);
        if (!first) first = failure;
    }
    return first;
}

void Simulation::end_block() {
    in_block_ = false;
    steps_in_block_ = 0;
    input_ = nullptr;
}

void Simulation::back_to_start_of_block(std::size_t i) {
    if (!input_) return members_[i]->restore_checkpoint();
    members_[i]->clear_counts();
    (*input_)(i);
}

void Simulation::back_to_start_of_block() {
    for (std::size_t i = 0; i < members_.size(); ++i) {
        if (!frozen_[i]) back_to_start_of_block(i);
        pinned_inside_[i] = -1;
        bad_points_[i] = -1;
        passages_[i] = {};
    }
    clock.steps -= steps_in_block_;
    age_ -= steps_in_block_;
    steps_in_block_ = 0;
}

void Simulation::repeat_step_by_step(Outcome& outcome, int threads, Poll& poll) {
    const std::int64_t all = steps_in_block_, steps = std::min(all, outcome.steps);
    back_to_start_of_block();
    begin_watches();  // They begin at the input, if that did not pay.
    if (all > steps) run({all - steps, false}, threads);
    outcome.steps -= steps;
    for (std::int64_t k = 0; k < steps; ++k, ++outcome.steps) {
        outcome.interrupted = poll.stopped();
        if (outcome.interrupted) break;
        end_block();
        run({1, true, true}, threads);
        const std::int64_t bad = first_bad_member();
        if (bad < 0) continue;
        const std::int64_t point = bad_points_[std::size_t(bad)];
        const Passage passage = passages_[std::size_t(bad)];
        back_to_start_of_block();
        Event event{"unstable", bad, point};
        if (point < 0) event = {"passed", bad, passage.point, passage.obstacle, passage.depth};
        event.step = outcome.steps + 1;
        event.time = clock.at(1);
        outcome.events.push_back(std::move(event));
        break;
    }
    pinned_inside_.assign(members_.size(), -1);
    end_block();
}

std::int64_t Simulation::energy_period(std::size_t i) const {
    return clock.dt > stable_dt_[i] ? heuristics::steps_of_short_block : heuristics::steps_of_block;
}

std::int64_t Simulation::energy_period() const {
    std::int64_t least = heuristics::steps_of_block;
    for (const std::size_t i : all_)
        if (!frozen_[i]) least = std::min(least, energy_period(i));
    return least;
}

void Simulation::begin_watches() {
    for (std::size_t i = 0; i < members_.size(); ++i)
        if (watch_energy_ && !frozen_[i]) watches_[i].begin(*members_[i], clock.now());
}

void Simulation::inspect(std::size_t i, std::int64_t age, bool each) {
    bad_points_[i] = -1;
    if (frozen_[i]) return;
    bad_points_[i] = members_[i]->first_bad_point(speed_limits_[i]);
    const double now = clock.at(age - age_);
    if (members_[i]->has_penalty() && bad_points_[i] < 0) {
        members_[i]->note_contacts();
        passages_[i] = find_passage(i, now);
        note_pinned_inside(i, now);
    }
    const bool due = age % energy_period(i) == 0;
    // A block begins where states are sampled, at a good one.
    const bool sampled = sample_every_ > 0 && age % sample_every_ == 0;
    if (bad_points_[i] < 0 && (due || sampled || each || clock.dt > stable_dt_[i]))
        bad_points_[i] = watches_[i].runaway_point(*members_[i], now, due);
}

void Simulation::sample(std::size_t i, double t) {
    const Plan& plan = this->plan(i);
    Engine& member = *members_[i];
    Points x(plan.cloth.points(), 3);
    member.store(x.data(), static_cast<double*>(nullptr));
    const PointsView view(x.data(), x.rows(), 3);
    member.watched.stretch = std::max(member.watched.stretch, largest_stretch(plan.cloth, view));
    for (const Sphere& sphere : plan.spheres) {
        const Penetration depth = penetration(plan.cloth.rows, plan.cloth.columns, view, sphere, t);
        member.watched.triangle_depth = std::max(member.watched.triangle_depth, depth.triangles);
        // Later the steps themselves note how deep points are.
        if (age_ == 0 && t == clock.now())
            member.watched.point_depth = std::max(member.watched.point_depth, depth.points);
    }
}

void Simulation::sample() {
    for (std::size_t i = 0; i < members_.size(); ++i) {
        if (frozen_[i]) continue;
        if (sample_every_ > 0) sample(i, clock.now());
        // A run that begins here has gained no energy.
        if (watch_energy_ && watches_[i].begin(*members_[i], clock.now())) continue;
        watches_[i].runaway_point(*members_[i], clock.now(), true);
    }
}

std::int64_t Simulation::first_bad_member() const {
    for (std::size_t i = 0; i < members_.size(); ++i)
        if (bad_points_[i] >= 0 || passages_[i].obstacle >= 0) return std::int64_t(i);
    return -1;
}

void Simulation::note_pinned_inside(std::size_t i, double t) {
    if (pinned_inside_[i] < 0) pinned_inside_[i] = members_[i]->pinned_point_below(t);
}

void Outcome::add(Event event, double time) {
    for (const Event& other : events)
        if (other.kind == event.kind) return;
    event.step = steps;
    event.time = time;
    events.push_back(std::move(event));
}

void Outcome::append(Outcome part) {
    for (Event& event : part.events) {
        event.step += steps;
        events.push_back(std::move(event));
    }
    steps += part.steps;
    interrupted = part.interrupted;
}

void Simulation::report_depths(std::size_t i, Outcome& outcome, double t) {
    if (!members_[i]->has_penalty()) return;
    const std::int64_t member = std::int64_t(i);
    const Watched& watched = members_[i]->watched;
    const double below = std::max(watched.point_depth, watched.triangle_depth);
    if (!silent_below_[i] && below > heuristics::negligible_depth) {
        silent_below_[i] = 1;
        outcome.add({"below", member, -1, -1, below}, t);
    }
    for (std::size_t s = 0; s < stable_depths_[i].size() && !silent_stiff_[i]; ++s) {
        const double deepest = members_[i]->contacts.of(s).deepest;
        if (!(deepest > stable_depths_[i][s])) continue;
        silent_stiff_[i] = 1;
        outcome.add({"stiff", member, -1, std::int64_t(s), deepest}, t);
    }
}

void Simulation::report_contacts(Outcome& outcome, double t) {
    for (std::size_t i = 0; i < members_.size(); ++i) {
        const std::int64_t pinned = std::exchange(pinned_inside_[i], -1);
        if (pinned >= 0) outcome.add({"pinned_inside", std::int64_t(i), pinned}, t);
        report_depths(i, outcome, t);
    }
}

Outcome Simulation::advance(std::int64_t steps, double dt, int threads,
                            const std::function<bool()>& interrupted) {
    set_step(dt);
    Outcome outcome;
    // A block ends where energies are compared. A call with arrays that ends before needs none.
    const std::int64_t period = energy_period();
    const bool watched = period < heuristics::steps_of_block || !input_ || steps >= period;
    if (steps > 0 && watched) begin_watches();
    if (steps_in_block_ * points_ > heuristics::point_steps_of_block) end_block();
    Poll poll(interrupted);
    auto start = poll.last_question();
    while (outcome.steps < steps) {
        // Blocks end, and states are sampled, at the same steps whatever the clock on the wall
        // says.
        const std::int64_t to_block = period - age_ % period;
        const std::int64_t to_sample =
            sample_every_ > 0 ? sample_every_ - age_ % sample_every_ : to_block;
        const std::int64_t to_inspection = std::min({to_block, to_sample, steps - outcome.steps});
        const std::int64_t n = std::min(chunk_, to_inspection);
        run({n, n == to_inspection}, threads);
        outcome.steps += n;
        const auto end = std::chrono::steady_clock::now();
        const double seconds = std::max(std::chrono::duration<double>(end - start).count(), 1e-9);
        chunk_ = std::clamp(std::int64_t(heuristics::seconds_between_polls * double(n) / seconds),
                            std::int64_t(1), heuristics::steps_of_block);
        start = end;
        report_contacts(outcome, clock.now());
        outcome.interrupted = poll.stopped(end);
        std::exception_ptr failure = take_force_failure();
        const bool ends = outcome.interrupted || failure;
        for (std::size_t i = 0; i < members_.size() && ends && n < to_inspection; ++i)
            inspect(i, age_, false);
        if (first_bad_member() >= 0) {
            repeat_step_by_step(outcome, threads, poll);
            // An exception that comes once, as that of Ctrl-C, counts too.
            if (std::exception_ptr again = take_force_failure()) failure = again;
            if (failure) std::rethrow_exception(failure);
            return outcome;
        }
        if (failure) {
            end_block();
            std::rethrow_exception(failure);
        }
        bool grown = false;
        for (std::size_t i = 0; i < members_.size(); ++i) {
            if (!watches_[i].take_news_of_growth()) continue;
            grown = true;
            outcome.add({"grown", std::int64_t(i)}, clock.now());
        }
        // The next block begins at the state of this inspection, so that steps which are repeated
        // pass none.
        if (n == to_block || n == to_sample) end_block();
        if (outcome.interrupted || grown) return outcome;
    }
    return outcome;
}

}  // namespace clothsim
