#include "model/motion.hpp"

#include <algorithm>
#include <cmath>

namespace clothsim {

MotionState Motion::at(double t, double inside) const {
    if (pieces.empty()) return {};
    double part = inside;
    if (period > 0) {
        const double cycles = inside / period + phase;
        const double cycle = std::floor(cycles);
        part = cycles - cycle;
        t = t / period + phase - cycle;
    }
    const MotionPiece& p = *(
        std::upper_bound(pieces.begin() + 1, pieces.end(), part,
                         [](double time, const MotionPiece& piece) { return time < piece.begin; }) -
        1);
    const double u = (t - p.begin) / p.length;
    const double seconds = period > 0 ? p.length * period : p.length;
    double wave = std::sin(p.angle * u);
    double slope = p.angle * std::cos(p.angle * u) / seconds;
    if (p.decay > 0) {
        const double all = -std::expm1(-p.decay);
        wave = -std::expm1(-p.decay * u) / all;
        slope = p.decay * std::exp(-p.decay * u) / (all * seconds);
    }
    return {
        p.p0 + u * (p.p1 + u * (p.p2 + u * (p.p3 + u * (p.p4 + u * p.p5)))) + wave * p.amplitude,
        (p.p1 + u * (2 * p.p2 + u * (3 * p.p3 + u * (4 * p.p4 + 5 * u * p.p5)))) / seconds +
            slope * p.amplitude};
}

}  // namespace clothsim
