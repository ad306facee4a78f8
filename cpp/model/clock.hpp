// When a step ends.
#pragma once

#include <cstdint>

namespace clothsim {

// Time of step k counted from an origin, so that rounding does not pile up over many steps.
struct Clock {
    double origin = 0;  // s
    std::int64_t steps = 0;
    double dt = 0;  // s

    // Returns the time so many steps from now [s].
    double at(std::int64_t count) const { return origin + static_cast<double>(steps + count) * dt; }
    double now() const { return at(0); }
    void set_step(double new_dt) {
        if (new_dt == dt) return;
        origin = now();
        steps = 0;
        dt = new_dt;
    }
};

}  // namespace clothsim
