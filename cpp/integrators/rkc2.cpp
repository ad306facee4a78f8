#include "integrators/rkc2.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace clothsim {
namespace {

constexpr double epsilon = 2.0 / 13;  // damping of the polynomial: a customary choice
constexpr double real_limit = 0.65;   // of the stable part of the real axis, over s^2 - 1
// Rounding of the increments grows with the square of the stages.
constexpr int most_stages = 200;
constexpr double widest_circle = 2.4;  // h / tau
constexpr double longest_undamped = 2;  // h omega where damping matters little

}  // namespace

ChebyshevMethod::ChebyshevMethod(int stages)
    : stages(stages), stage(std::size_t(stages) + 1), weights(std::size_t(stages)) {
    const std::size_t s = std::size_t(stages);
    const double w0 = 1 + epsilon / (double(stages) * stages);
    // Chebyshev polynomials at w0, and their first and second derivatives.
    std::vector<double> T{1, w0};
    std::vector<double> first{0, 1};
    std::vector<double> second{0, 0};
    for (std::size_t j = 2; j <= s; ++j) {
        T.push_back(2 * w0 * T[j - 1] - T[j - 2]);
        first.push_back(2 * T[j - 1] + 2 * w0 * first[j - 1] - first[j - 2]);
        second.push_back(4 * first[j - 1] + 2 * w0 * second[j - 1] - second[j - 2]);
    }
    const double w1 = first[s] / second[s];
    const auto b = [&](std::size_t j) {
        j = std::max<std::size_t>(j, 2);
        return second[j] / (first[j] * first[j]);
    };
    stage[1].first_slope = b(1) * w1;
    for (std::size_t j = 2; j <= s; ++j) {
        stage[j].mu = 2 * b(j) * w0 / b(j - 1);
        if (j > 2) stage[j].nu = -b(j) / b(j - 2);  // d_0 is 0, and not kept
        stage[j].slope = 2 * b(j) * w1 / b(j - 1);
        stage[j].first_slope = -(1 - b(j - 1) * T[j - 1]) * stage[j].slope;
        stage[j].part = w1 * second[j] / first[j];
    }
    stage[1].part = stage[2].part / first[2];
    std::vector<double> previous(s);
    std::vector<double> last(s);
    last[0] = stage[1].first_slope;
    for (std::size_t j = 2; j <= s; ++j) {
        for (std::size_t l = 0; l < s; ++l)
            previous[l] = stage[j].mu * last[l] + stage[j].nu * previous[l];
        previous[0] += stage[j].first_slope;
        previous[j - 1] += stage[j].slope;
        previous.swap(last);
    }
    weights = last;
}

int chebyshev_stages(double rate, double h) {
    return std::clamp(int(std::ceil(std::sqrt(1 + std::min(rate * h, 1e6) / real_limit))), 2,
                      most_stages);
}

double longest_chebyshev_step(double stiffness, double damping) {
    const double by_stages = damping > 0
        ? real_limit * (double(most_stages) * most_stages - 1) / damping
        : std::numeric_limits<double>::infinity();
    if (!(stiffness > 0)) return by_stages;
    const double by_circle = widest_circle * damping / stiffness;
    return std::min(by_stages, std::max(by_circle, longest_undamped / std::sqrt(stiffness)));
}

}  // namespace clothsim
