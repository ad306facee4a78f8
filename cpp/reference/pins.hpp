// Driven pins for the oracles: the formulae of docs/model.md in any arithmetic, with nothing of the core's
// own.
#pragma once

#include <cmath>
#include <vector>

#include "model/scene.hpp"

namespace clothsim::reference {

template <class Real>
struct PinState {
    Real x[3], v[3];  // m, m/s
};

// A pin at time t. Where its velocity jumps, `inside` selects the piece that counts.
template <class Real>
PinState<Real> pin_state(const DrivenPin& pin, const Motion& motion, Real t, Real inside) {
    PinState<Real> s{};
    for (int k = 0; k < 3; ++k) s.x[k] = Real(pin.start[k]);
    switch (motion.kind) {
        case Motion::Kind::none: break;
        case Motion::Kind::linear:
            for (int k = 0; k < 3; ++k) {
                s.v[k] = Real(motion.velocity[k]);
                s.x[k] += t * s.v[k];
            }
            break;
        case Motion::Kind::reciprocate: {
            const Real period = Real(motion.period), decay = Real(motion.deceleration);
            const Real whole = std::floor(inside / period + Real(motion.phase));
            const bool back = inside / period + Real(motion.phase) - whole >= Real(0.5);
            const Real q = 2 * (t / period + Real(motion.phase) - whole) - (back ? 1 : 0);
            const Real end = decay == 0 ? Real(1) : -std::expm1(-decay);
            const Real done = decay == 0 ? q : -std::expm1(-decay * q) / end;
            const Real rate = (decay == 0 ? Real(1) : decay * std::exp(-decay * q) / end) * 2 / period;
            const Real travel = (back ? -1 : 1) * Real(motion.distance);
            for (int k = 0; k < 3; ++k) {
                s.x[k] += travel * (done - Real(0.5)) * Real(motion.direction[k]);
                s.v[k] = travel * rate * Real(motion.direction[k]);
            }
            break;
        }
        case Motion::Kind::keyframes: {
            const std::size_t last = motion.times.size() - 1;
            std::size_t n = 0;  // the piece that ends at key n
            while (n <= last && inside >= Real(motion.times[n])) ++n;
            for (int k = 0; k < 3; ++k) {
                if (!motion.relative) s.x[k] = 0;
                if (n == 0 || n > last) {
                    s.x[k] += Real(motion.centers[n == 0 ? 0 : last][k]);
                    continue;
                }
                const Real begin = Real(motion.times[n - 1]), from = Real(motion.centers[n - 1][k]);
                s.v[k] = (Real(motion.centers[n][k]) - from) / (Real(motion.times[n]) - begin);
                s.x[k] += from + (t - begin) * s.v[k];
            }
            break;
        }
    }
    return s;
}

// Put the driven pins of a state to their places; three numbers a point in x and v.
template <class Real, class Values>
void place_pins(const std::vector<DrivenPin>& pins, const std::vector<Motion>& motions, Real t, Real inside,
                Values&& x, Values&& v) {
    for (const DrivenPin& pin : pins) {
        const PinState<Real> s = pin_state(pin, motions[std::size_t(pin.motion)], t, inside);
        for (int k = 0; k < 3; ++k) {
            x[3 * pin.point + k] = s.x[k];
            v[3 * pin.point + k] = s.v[k];
        }
    }
}

}  // namespace clothsim::reference
