#include "model/sphere.hpp"

#include <algorithm>
#include <cmath>

namespace clothsim {
namespace {

// Fraction of the way to the turning point and its rate, `u` being the fraction of the half period.
struct Travel {
    double fraction, rate, sign;
};

Travel reciprocating_travel(const Motion& m, double t) {
    const double cycles = t / m.period + m.phase;
    const double half = 2 * (cycles - std::floor(cycles));
    const bool back = half >= 1;
    const double u = back ? half - 1 : half;
    const double k = m.deceleration;
    const double half_period = m.period / 2;
    const double sign = back ? -1 : 1;
    if (k == 0) return {u, 1 / half_period, sign};
    const double norm = -std::expm1(-k);
    return {-std::expm1(-k * u) / norm, k * std::exp(-k * u) / (norm * half_period), sign};
}

// Index of the segment that holds t; the caller has excluded times outside the table.
std::size_t segment(const Motion& m, double t) {
    return static_cast<std::size_t>(std::upper_bound(m.times.begin(), m.times.end(), t) - m.times.begin()) -
        1;
}

Vec3 place(const Motion& motion, const Vec3& center, double t) {
    switch (motion.kind) {
        case Motion::Kind::none: return center;
        case Motion::Kind::linear: return center + t * motion.velocity;
        case Motion::Kind::reciprocate: {
            const Travel travel = reciprocating_travel(motion, t);
            return center + travel.sign * motion.distance * (travel.fraction - 0.5) * motion.direction;
        }
        case Motion::Kind::keyframes: {
            if (t < motion.times.front()) return motion.centers.front();
            if (t >= motion.times.back()) return motion.centers.back();
            const std::size_t i = segment(motion, t);
            const double u = (t - motion.times[i]) / (motion.times[i + 1] - motion.times[i]);
            return motion.centers[i] + u * (motion.centers[i + 1] - motion.centers[i]);
        }
    }
    return center;
}

}  // namespace

Vec3 Sphere::center_at(double t) const { return place(motion, center, t) - origin; }

Vec3 Sphere::velocity_at(double t) const {
    switch (motion.kind) {
        case Motion::Kind::none: return Vec3::Zero();
        case Motion::Kind::linear: return motion.velocity;
        case Motion::Kind::reciprocate: {
            const Travel travel = reciprocating_travel(motion, t);
            return travel.sign * motion.distance * travel.rate * motion.direction;
        }
        case Motion::Kind::keyframes: {
            if (t < motion.times.front() || t >= motion.times.back()) return Vec3::Zero();
            const std::size_t i = segment(motion, t);
            return (motion.centers[i + 1] - motion.centers[i]) / (motion.times[i + 1] - motion.times[i]);
        }
    }
    return Vec3::Zero();
}

}  // namespace clothsim
