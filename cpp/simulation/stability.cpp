#include "simulation/stability.hpp"

#include <algorithm>
#include <limits>

namespace clothsim {

double laplacian_bound(const Cloth& cloth, const std::array<double, family_count>& coefficient) {
    const auto value = [&](Family f) { return cloth.present[f] ? coefficient[f] : 0.0; };
    const double ks = value(structural), kh = value(shear), kb = value(bend);
    const auto symbol = [&](double x, double y) {
        return 2 * ks * (2 - x - y) + 4 * kh * (1 - x * y) + 4 * kb * (2 - x * x - y * y);
    };
    // A strip of one row or one column has waves along one axis only; the other cosine is 1.
    const bool strip = cloth.rows == 1 || cloth.columns == 1;
    const auto inside = [](double x) { return std::clamp(x, -1.0, 1.0); };
    const auto stationary_on_edge = [&](double x) {  // d symbol / d y = 0 at fixed x
        return kb > 0 ? inside(-(2 * ks + 4 * kh * x) / (8 * kb)) : -1.0;
    };
    double most = std::max(symbol(1, -1), symbol(1, stationary_on_edge(1)));
    if (!strip) {
        for (const double y : {-1.0, 1.0, stationary_on_edge(-1)}) most = std::max(most, symbol(-1, y));
        if (kh + kb > 0) {
            const double x = inside(-ks / (2 * kh + 4 * kb));
            most = std::max(most, symbol(x, x));
        }
    }
    return most / *std::min_element(cloth.mass.begin(), cloth.mass.end());
}

double rk4_stable_dt(const Cloth& cloth) {
    const double lambda = laplacian_bound(cloth, cloth.stiffness);
    const double lightest = *std::min_element(cloth.mass.begin(), cloth.mass.end());
    const double delta = laplacian_bound(cloth, cloth.spring_damping) + cloth.point_damping / lightest;
    double dt = std::numeric_limits<double>::infinity();
    if (lambda > 0) dt = (delta > 0 ? 2.6155 : 2.828) / std::sqrt(lambda);
    if (delta > 0) dt = std::min(dt, 2.785 / delta);
    return dt;
}

}  // namespace clothsim
