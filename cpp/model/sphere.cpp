#include "model/sphere.hpp"

#include <algorithm>
#include <cmath>

namespace clothsim {
namespace {

// Fraction of the way to the turning point and its rate. `inside`: a time of the half period that counts.
struct Travel {
    double fraction, rate, sign;
};

Travel reciprocating_travel(const Motion& m, double t, double inside) {
    const double cycles = t / m.period + m.phase, turns = inside / m.period + m.phase;
    const double half = 2 * (cycles - std::floor(turns));
    const bool back = 2 * (turns - std::floor(turns)) >= 1;
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

}  // namespace

Vec3 Motion::displacement_at(double t) const {
    switch (kind) {
        case Kind::none: return Vec3::Zero();
        case Kind::linear: return t * velocity;
        case Kind::reciprocate: {
            const Travel travel = reciprocating_travel(*this, t, t);
            return travel.sign * distance * (travel.fraction - 0.5) * direction;
        }
        case Kind::keyframes: {
            if (t < times.front()) return centers.front();
            if (t >= times.back()) return centers.back();
            const std::size_t i = segment(*this, t);
            const double u = (t - times[i]) / (times[i + 1] - times[i]);
            return centers[i] + u * (centers[i + 1] - centers[i]);
        }
    }
    return Vec3::Zero();
}

Vec3 Motion::velocity_at(double t, double inside) const {
    switch (kind) {
        case Kind::none: return Vec3::Zero();
        case Kind::linear: return velocity;
        case Kind::reciprocate: {
            const Travel travel = reciprocating_travel(*this, t, inside);
            return travel.sign * distance * travel.rate * direction;
        }
        case Kind::keyframes: {
            if (inside < times.front() || inside >= times.back()) return Vec3::Zero();
            const std::size_t i = segment(*this, inside);
            return (centers[i + 1] - centers[i]) / (times[i + 1] - times[i]);
        }
    }
    return Vec3::Zero();
}

Vec3 Sphere::center_at(double t) const { return motion.place_at(center, t) - origin; }
Vec3 Sphere::velocity_at(double t) const { return motion.velocity_at(t); }

}  // namespace clothsim
