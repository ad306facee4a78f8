#include "integrators/adaptive.hpp"

#include <algorithm>
#include <cmath>

namespace clothsim {
namespace {

constexpr double safety = 0.9;  // of a step; not tuned: customary, adaptive.hpp
constexpr double integral_part = 0.4;  // of 1 / order, taken from the proportional one
constexpr double least_factor = 0.2, most_factor = 5;

}  // namespace

bool StepController::judge(double tried, double error, int order) {
    if (!std::isfinite(error)) {
        h = tried * least_factor;
        rejected = true;
        return false;
    }
    const double beta = integral_part / order;
    const double alpha = 1.0 / order - 0.75 * beta;
    const double e = std::max(error, 1e-10);
    if (error > 1) {
        h = tried * std::max(least_factor, safety * std::pow(e, -1.0 / order));
        rejected = true;
        return false;
    }
    double factor = safety * std::pow(e, -alpha) * std::pow(previous_error, beta);
    factor = std::clamp(factor, least_factor, rejected ? 1.0 : most_factor);
    h = tried * factor;
    previous_error = std::max(e, 1e-4);
    rejected = false;
    return true;
}

}  // namespace clothsim
