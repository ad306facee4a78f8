// The way back, all of it; docs/dev/rollback.md explains it.
//
// Steps are taken first and judged afterwards, which costs less than an inspection before each. There are two
// judges:
//   1. Separating planes (contact/separating_planes.hpp): rows may cross in steps without a contact pass.
//   2. Inspection of the state (Simulation::inspect).
//      It may not be finite, may run away, or hold a mass point trapped between spheres.
// Each ends in the same way: back to the checkpoint, and the steps since then again with more care.
//
//   checkpoint         inspection           inspection
//        |----- steps ------|------ steps -------x
//        |<~~~~~~~~~~~~~ crossed by a member: it repeats them, with a contact pass after each
//        |<~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~ a bad state: all members repeat them one by one, each
//        inspected
//
// A checkpoint is a state that an inspection has found good, at most 128 steps ago. It outlasts a call of one
// step. It is a copy in the engines or, at the start of a call with arrays, the arrays themselves. They stay
// unchanged until the call has succeeded.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "engines/engine.hpp"

namespace clothsim {

class Checkpoint {
public:
    // Brings the state that a call was given into member i; whether it is finite.
    using Load = std::function<bool(std::size_t i)>;

    explicit Checkpoint(const std::vector<std::unique_ptr<Engine>>& members) : members_(members) {}

    bool taken() const { return steps_ >= 0; }
    bool is_input() const { return input_ != nullptr; }
    // Since it was taken.
    std::int64_t steps() const { return taken() ? steps_ : 0; }
    double seconds() const { return seconds_; }
    void pass(std::int64_t steps) { steps_ += steps; }
    void spend(double seconds) { seconds_ += seconds; }

    // At the present state, which every member copies before it leaves it, by any thread.
    void take() {
        set(nullptr, 0);
        copied_.assign(members_.size(), 0);
    }
    void copy(std::size_t i) {
        members_[i]->save_checkpoint();
        copied_[i] = 1;
    }
    // At the state that `load` has just brought; it is asked again to go back.
    void take_input(const Load& load) { set(&load, 0); }
    void drop() { set(nullptr, none); }

    // A member back to it; when all are back, none of the steps has passed.
    void restore(std::size_t i) const {
        Engine& member = *members_[i];
        if (!input_) {
            if (copied_[i]) member.restore_checkpoint();
            return;
        }
        member.begin_anew();
        (*input_)(i);
    }
    void restored() { steps_ = 0; }

private:
    static constexpr std::int64_t none = -1;
    void set(const Load* input, std::int64_t steps) {
        input_ = input;
        steps_ = steps;
        seconds_ = 0;
    }

    const std::vector<std::unique_ptr<Engine>>& members_;
    const Load* input_ = nullptr;
    std::vector<std::uint8_t> copied_;  // members; the others are still at it
    std::int64_t steps_ = none;
    double seconds_ = 0;
};

}  // namespace clothsim
