// The loop of error control tries steps, judges and accepts them.
//
// The paper's responses follow each accepted step, as they follow each step of the fixed-step
// methods. To skip no contact, AdaptiveEngine::contact_step bounds a step near the spheres, by the
// velocities before the step, and after a trial by those after it: a step that was too long is
// tried again. Every trial comes to an end. The velocities after an unstable step mean nothing, so
// they ask for no step below `near`; from there on steps are stable, and a bound of the velocities
// bounds the step from below.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "driver/simulation.hpp"

namespace clothsim {
namespace {

// A step this much smaller than the time span does not move the clock any more.
constexpr double smallest_part = 1e-14;
// A stop this near, over the time, is at the end of a step. The clock rounds by less.
constexpr double rounding_of_stops = 1e-12;

}  // namespace

double AdaptiveRun::target(double t) {
    while (next_given < grid.size() && grid[next_given] <= t) ++next_given;
    const double rounding = rounding_of_stops * std::max(std::abs(t), std::abs(stops.back()));
    for (; next_stop + 1 < stops.size() && stops[next_stop] <= t + rounding; ++next_stop)
        kinks.push_back(std::int64_t(ends.size()));
    const double end_of_grid = next_given + 1 < grid.size() ? grid[next_given] : stops.back();
    return std::min(end_of_grid, stops[next_stop]);
}

Outcome Simulation::advance_adaptive(AdaptiveRun& run, double until, std::int64_t steps,
                                     int threads, const std::function<bool()>& interrupted) {
    Engine& engine = *members_[0];
    AdaptiveEngine& adaptive = *engine.adaptive();
    StepController& controller = run.controller;
    Outcome outcome;
    end_block();
    begin_watches();
    Poll poll(interrupted);
    bool first_trial = true;
    int passages_in_a_row = 0;
    for (double t = clock.now(), end = t; t < until && outcome.steps < steps;) {
        if (first_trial) {
            end = run.target(t);
            if (!run.grid.empty()) controller.h = end - t;
        }
        const double left = end - t;
        const double smallest = smallest_part * std::max(std::abs(end), left);
        const double goal = controller.h;
        // Two equal steps are better than a long one and a sliver.
        double h = goal;
        if (goal >= left) h = left;
        else if (goal > left / 2) h = left / 2;
        h = adaptive.contact_step(t, h, run.near, false);
        if (!(h > smallest)) {
            if (left <= smallest) break;
            const std::int64_t point = watches_[0].fastest_free_point(engine);
            outcome.events.push_back({"unstable", 0, point, -1, 0, outcome.steps + 1, t});
            return outcome;
        }
        const double error = adaptive.try_step(t, h, run.tolerance, threads);
        throw_force_failure();
        bool accepted = controller.judge(h, error, adaptive.order());
        const double bounded = accepted ? adaptive.contact_step(t, h, run.near, true) : h;
        const Passage passage = accepted && bounded >= h && engine.has_penalty()
            ? deepest_passage(adaptive.trial_depths(t + h), plan(0))
            : Passage{};
        if (passage.obstacle >= 0) {
            // Where steps meet the tolerance and still end beyond the layer, the solution does too.
            constexpr int most_trials = 3;
            if (++passages_in_a_row > most_trials) {
                outcome.events.push_back({"passed", 0, passage.point, passage.obstacle,
                                          passage.depth, outcome.steps + 1, t + h});
                return outcome;
            }
            controller.h = std::min(controller.h, h / 4);
            accepted = false;
        } else if (accepted) {
            passages_in_a_row = 0;
        }
        if (bounded < h) {
            // The next step is a hair shorter, as rounding may ask for the same step again.
            controller.h = std::min(controller.h, 0.99 * bounded);
            accepted = false;
        }
        first_trial = accepted;
        if (accepted) {
            const double next = h == left ? end : t + h;
            engine.accept_and_respond(t, next, threads);
            run.begin = t;
            const bool due = (age_ + 1) % heuristics::steps_of_short_block == 0;
            if (due || next >= until || outcome.steps + 1 == steps) {
                engine.note_contacts();
                note_pinned_inside(0, next);
            }
            t = next;
            outcome.steps += 1;
            report_contacts(outcome, t);
            run.ends.push_back(t);
            run.local_error += error;
            clock = {t, 0, 0};
            sample_accepted(t);
            ++age_;
            if (due) {
                const std::int64_t point = watches_[0].runaway_point(engine, t, true);
                if (point >= 0) {
                    outcome.events.push_back({"unstable", 0, point, -1, 0, outcome.steps, t});
                    return outcome;
                }
            }
            // A step cut short by the end says nothing against longer ones.
            if (h < goal) controller.h = std::max(controller.h, goal);
        } else {
            run.rejected += 1;
        }
        outcome.interrupted = poll.stopped();
        if (outcome.interrupted) return outcome;
    }
    return outcome;
}

void Simulation::store_within(const AdaptiveRun& run, double t, double* x, double* v, int threads) {
    AdaptiveEngine& adaptive = *members_[0]->adaptive();
    if (!members_[0]->watched.responded) return adaptive.dense(t, x, v, threads);
    const std::size_t size = 3 * std::size_t(plan(0).cloth.points());
    std::vector<double> x0(size), v0(size), x1(size), v1(size);
    adaptive.dense(run.begin, x0.data(), v0.data(), threads);
    members_[0]->store(x1.data(), v1.data());
    interpolate(plan(0), t,
                {run.begin, clock.now() - run.begin, x0.data(), v0.data(), x1.data(), v1.data()}, x,
                v);
}

Outcome Simulation::record(AdaptiveRun& run, const FrameArrays& arrays, std::int64_t most_steps,
                           std::size_t most_frames, int threads,
                           const std::function<bool()>& interrupted) {
    Frames& frames = run.frames;
    const std::size_t size = 3 * std::size_t(plan(0).cloth.points());
    const std::size_t last = std::min(arrays.capacity, frames.stored.size() + most_frames);
    const auto store = [&](const Moment& moment) {
        const std::size_t place = frames.stored.size() * size;
        double* const x = arrays.x[0] + place;
        double* const v = arrays.v[0] + place;
        // The run begins at the present state, whatever its clock has rounded.
        const bool within = !frames.stored.empty() && clock.now() > moment.time;
        if (within) {
            store_within(run, moment.time, x, v, threads);
        } else {
            sample();
            members_[0]->store(x, v);
        }
        frames.step = within ? -1 : run.steps();
        frames.stored.push_back(moment);
    };
    Outcome outcome;
    Poll poll(interrupted);  // Calls of `advance_adaptive` may be too short to ask by themselves.
    while (!run.complete() && frames.stored.size() < last) {
        outcome.interrupted = poll.stopped();
        if (outcome.interrupted) return outcome;
        const Moment& moment = frames.moments[run.next_moment];
        if (!frames.stored.empty() && clock.now() < moment.time) {
            std::int64_t steps = most_steps - outcome.steps;
            if (steps <= 0) return outcome;
            if (run.every) steps = std::min(steps, run.every - run.since_frame);
            Outcome part = advance_adaptive(run, moment.time, steps, threads, interrupted);
            const std::int64_t count = part.steps;
            run.since_frame += count;
            outcome.append(std::move(part));
            if (!outcome.complete()) return outcome;
            const bool arrived = clock.now() >= moment.time;
            if (run.every && run.since_frame == run.every && !arrived) {
                run.since_frame = 0;
                store({clock.now() - run.start, clock.now()});
            }
            // Without a step, the remainder is rounding of the clock.
            if (!arrived && count > 0) continue;
        }
        store(moment);
        ++run.next_moment;
    }
    return outcome;
}

void Simulation::sample_accepted(double t) {
    if (sample_every_ == 0) return;
    if (age_ == 0) last_sample_ = -std::numeric_limits<double>::infinity();
    if (++steps_since_sample_ < sample_every_ && t - last_sample_ < sample_interval_) return;
    steps_since_sample_ = 0;
    last_sample_ = t;
    sample(0, t);
}

}  // namespace clothsim
