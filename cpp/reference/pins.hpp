// Driven pins and moving obstacles for the oracles: the pieces of model/motion.hpp in any
// arithmetic, evaluated by nothing of the core's own. tests/model/test_motion.py compares the
// pieces with the formulae of each motion.
#pragma once

#include <cmath>
#include <vector>

#include "model/scene.hpp"

namespace clothsim::reference {

template <class Real>
struct PinState {
    Real x[3], v[3];  // m, m/s
};

// Returns the state of a motion at time t from a start. Where its velocity jumps, `inside` selects
// the piece that counts.
template <class Real>
PinState<Real> motion_state(const Motion& motion, const Vec3& start, Real t, double inside) {
    using std::cos, std::exp, std::expm1, std::sin;
    if (motion.pieces.empty()) return {{start[0], start[1], start[2]}, {0, 0, 0}};
    const double period = motion.period > 0 ? motion.period : 1;
    const double phase = motion.phase;
    const double periods = motion.period > 0 ? std::floor(inside / period + phase) : 0;
    std::size_t n = motion.pieces.size() - 1;
    while (n > 0 && inside / period + phase - periods < motion.pieces[n].begin) --n;
    const MotionPiece& piece = motion.pieces[n];
    const Real length = piece.length;
    const Real angle = piece.angle;
    const Real decay = piece.decay;
    const Real u = (t / period + phase - periods - piece.begin) / length;
    const Real end = -expm1(-decay);
    const Real wave = piece.decay > 0 ? -expm1(-decay * u) / end : sin(angle * u);
    const Real slope = piece.decay > 0 ? decay * exp(-decay * u) / end : angle * cos(angle * u);
    PinState<Real> s{};
    for (int k = 0; k < 3; ++k) {
        const Real p0 = piece.p0[k];
        const Real p1 = piece.p1[k];
        const Real p2 = piece.p2[k];
        const Real p3 = piece.p3[k];
        const Real p4 = piece.p4[k];
        const Real p5 = piece.p5[k];
        const Real begin = motion.relative ? Real(start[k]) : Real(0);
        const Real amplitude = piece.amplitude[k];
        s.x[k] = begin +
            (p0 + u * p1 + u * u * p2 + u * u * u * (p3 + u * p4 + u * u * p5) + amplitude * wave);
        s.v[k] =
            (p1 + 2 * u * p2 + u * u * (3 * p3 + 4 * u * p4 + 5 * u * u * p5) + amplitude * slope) /
            (length * period);
    }
    return s;
}

// Put the driven pins of a state to their places; three numbers a point in x and v.
template <class Real, class Values>
void place_pins(const std::vector<DrivenPin>& pins, const std::vector<Motion>& motions, Real t,
                double inside, Values&& x, Values&& v) {
    for (const DrivenPin& pin : pins) {
        const PinState<Real> s =
            motion_state(motions[std::size_t(pin.motion)], pin.start, t, inside);
        for (int k = 0; k < 3; ++k) {
            x[3 * pin.point + k] = s.x[k];
            v[3 * pin.point + k] = s.v[k];
        }
    }
}

}  // namespace clothsim::reference
