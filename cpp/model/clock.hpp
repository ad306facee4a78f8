// When a step ends.
#pragma once

#include <cstdint>

namespace clothsim {

// Time of step k counted from an origin, so that rounding does not pile up over many steps.
struct Clock {
    double origin = 0;
    std::int64_t steps = 0;
    double dt = 0;

    double at(std::int64_t further) const {
        return origin + static_cast<double>(steps + further) * dt;
    }
    double now() const { return at(0); }
    void set_step(double new_dt) {
        if (new_dt == dt) return;
        origin = now();
        steps = 0;
        dt = new_dt;
    }
};

}  // namespace clothsim
