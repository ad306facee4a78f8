#include "driver/team_choice.hpp"

#include <algorithm>
#include <utility>

namespace clothsim {
namespace {

// Seconds by which one thread and a team are compared: some thirty steps of the paper's cloth. Half would
// compare within the spread of fifteen steps; twice doubles what a trial costs.
constexpr double seconds_of_trial = 2e-4;
// Seconds until the alternative is tried again, less at first, as a trial may fall into a busy moment. A
// trial of an alternative ten times slower then costs 0.4 %; half or twice the time, twice or half as much.
constexpr double seconds_between_trials = 0.5;
// Times what the alternative cost. Equal costs spread by some 3 %, so half the gain would change for nothing;
// twice would leave a tenth unused.
constexpr double least_gain = 1.05;
// Times what the alternative cost, where a trial ends at once. Half is within the spread of a first step;
// twice lets a team beside a busy process go on for twice as long.
constexpr double disaster = 3;
// A requested team is crowded if its threads sleep for this part of a window. Beside two busy processes they
// sleep for half of it. Half the part is near the pauses of a quiet virtual machine; twice may not be
// reached.
constexpr double most_slept = 0.25;
// Seconds: some slices of the system's scheduler. Half would judge by one slice; twice decides twice as late.
constexpr double seconds_of_window = 0.05;

}  // namespace

std::int64_t TeamChoice::steps(std::int64_t wanted) const {
    const double expected = std::max(last_, cost_[use_team_]);
    if (!on_trial_ || expected == 0) return wanted;
    return std::clamp(std::int64_t(seconds_of_trial / expected), std::int64_t(1), wanted);
}

void TeamChoice::observe(std::int64_t steps, double seconds) {
    const double other = cost_[!use_team_];
    last_ = seconds / double(steps);
    since_change_ += seconds;
    const bool too_costly = other > 0 && last_ > disaster * other;
    // The first steps after a change wake threads and fill caches.
    if (std::exchange(just_changed_, false) && !too_costly) return;
    seconds_ += seconds;
    steps_ += steps;
    if (seconds_ < seconds_of_trial && !too_costly) return;
    cost_[use_team_] = std::exchange(seconds_, 0) / double(std::exchange(steps_, 0));
    const bool due = !std::exchange(on_trial_, false) && since_change_ > patience_;
    if (due) patience_ = std::min(2 * patience_, seconds_between_trials);
    if (other == 0 || cost_[use_team_] > least_gain * other || due) {
        use_team_ = !use_team_;
        just_changed_ = on_trial_ = true;
        since_change_ = 0;
    }
}

bool Crowding::observe(std::int64_t slept, double seconds) {
    seconds_ += seconds;
    slept_ += 1e-9 * double(slept);
    if (slept_ > most_slept * seconds_of_window) return found_ = true;
    if (seconds_ > seconds_of_window) seconds_ = slept_ = 0;
    return false;
}

}  // namespace clothsim
