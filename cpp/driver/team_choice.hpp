// One thread or a team: by what steps of each were seen to cost.
#pragma once

#include <cstdint>

namespace clothsim {

// Chooses between one thread and a team by what their steps were seen to cost. The result has the same bits
// either way, so a machine whose processors are taken by others costs time, not a result.
class TeamChoice {
public:
    // Where steps are long, the team takes the first step too. Else a short run may be over before the team
    // wakes.
    explicit TeamChoice(bool team_first) : use_team_(team_first) {}
    bool team() const { return use_team_; }
    // Number of steps of a trial: few while the slower alternative may be running.
    std::int64_t steps(std::int64_t wanted) const;
    void observe(std::int64_t steps, double seconds);

private:
    double cost_[2] = {0, 0};  // last seconds per step of one thread and of the team; 0: not seen yet
    double last_ = 0;  // seconds per step of whichever ran last
    double seconds_ = 0;  // of `steps_` steps since the last judgement
    std::int64_t steps_ = 0;
    double since_change_ = 0;  // seconds
    double patience_ = 0.01;  // seconds until the other is tried again
    bool use_team_;
    bool just_changed_ = true, on_trial_ = true;
};

// Whether other processes have the processors of a team that the caller has asked for: its threads then sleep
// for much of the time.
class Crowding {
public:
    bool found() const { return found_; }
    // Steps took these seconds, in which threads slept for so many nanoseconds; whether this shows it.
    bool observe(std::int64_t slept, double seconds);

private:
    bool found_ = false;
    double seconds_ = 0, slept_ = 0;  // in the present window
};

}  // namespace clothsim
