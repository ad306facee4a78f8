// The loop of error control: try, judge, accept.
//
// Contact: the collision pass follows each accepted step, as it follows each step of the fixed-step
// methods. So a contact gets its response at the end of its step. To skip none,
// AdaptiveEngine::contact_step bounds a step near the spheres. The bound takes the velocities before the
// step, and after a trial those after it. A step that was too long is tried again. Every trial comes to an
// end: the velocities after an unstable step mean nothing, so they ask for no step below `near`. From there
// on steps are stable, their velocities are bounded, and a bound of the way bounds the step from below.
// Continuous spheres test
// the whole path between the ends of the step. Their contacts begin within it, so steps end at frames
// instead of being interpolated.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "driver/simulation.hpp"

namespace clothsim {
namespace {

// A step this much smaller than the time span does not move the clock any more.
constexpr double smallest_part = 1e-14;
constexpr std::int64_t steps_between_energies =
    EnergyWatch::steps_between_checks;  // accepted ones, which cost several of others

}  // namespace

Simulation::AdaptiveOutcome Simulation::advance_adaptive(const AdaptiveRequest& request,
                                                         StepController& controller,
                                                         const std::function<bool()>& interrupted) {
    Engine& engine = *members_[0];
    AdaptiveEngine& adaptive = *engine.adaptive();
    AdaptiveOutcome outcome;
    const double end = request.end;
    end_block();
    begin_watches();
    double t = clock.now();
    const double smallest = smallest_part * std::max(std::abs(request.end), request.end - t);
    Poll poll(interrupted);
    while (t < request.until && outcome.steps < request.steps) {
        const double wanted = controller.h;
        const double left = end - t;
        // Two equal steps rather than a long one and a sliver.
        double h = wanted >= left ? left : wanted > left / 2 ? left / 2 : wanted;
        h = adaptive.contact_step(t, h, request.near, false);
        if (!(h > smallest)) {
            if (left <= smallest) break;
            outcome.unstable =
                Outcome::Unstable{0, watches_[0].fastest_free_point(engine), outcome.steps + 1, t};
            return outcome;
        }
        const double error = adaptive.try_step(t, h, request.tolerance, request.threads);
        bool accepted = controller.judge(h, error, adaptive.order());
        const double bounded = accepted ? adaptive.contact_step(t, h, request.near, true) : h;
        if (bounded < h) {
            // A hair less than allowed, as rounding may ask for the same step again.
            controller.h = std::min(controller.h, 0.99 * bounded);
            accepted = false;
        }
        if (accepted) {
            const double next = h == left ? end : t + h;
            engine.accept_in_contact(t, next, request.threads);
            last_begin_ = t;
            last_step_ = h;
            const std::int64_t trapped = std::exchange(engine.contact_report.trapped, -1);
            if (trapped >= 0) {
                outcome.unstable = Outcome::Unstable{0, trapped, outcome.steps + 1, next, true};
                return outcome;
            }
            report_contacts(outcome);
            t = next;
            outcome.steps += 1;
            outcome.error = error;
            clock = {t, 0, 0};
            sample_accepted(t);
            if (++age_ % steps_between_energies == 0) {
                const std::int64_t point = watches_[0].runaway_point(engine, true);
                if (watches_[0].take_growth()) outcome.grown = 0;
                if (point >= 0) {
                    outcome.unstable = Outcome::Unstable{0, point, outcome.steps, t};
                    return outcome;
                }
            }
            // A step cut short by the end says nothing against longer ones.
            if (h < wanted) controller.h = std::max(controller.h, wanted);
        } else {
            outcome.rejected += 1;
        }
        if (outcome.grown) return outcome;
        outcome.interrupted = poll.stopped();
        if (outcome.interrupted) return outcome;
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

void Simulation::dense(double t, double* x, double* v, int threads) {
    members_[0]->adaptive()->dense((t - last_begin_) / last_step_, x, v, threads);
}

}  // namespace clothsim
