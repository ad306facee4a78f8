// The energy of a state, quick enough to be watched in every run. Columns are summed side by side, so that the sums are the
// same for every instruction set.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numeric>
#include <vector>

#include "simulation/diagnostics.hpp"
#include "simulation/versions.hpp"

namespace clothsim {
namespace {

// x, y and z of `count` points, a plane after the other.
void take_apart(const double* points, std::size_t count, double* planes) {
    for (std::size_t i = 0; i < count; ++i)
        for (std::size_t k = 0; k < 3; ++k) planes[k * count + i] = points[3 * i + k];
}

// sum[c] += (|b[c] - a[c]| - rest)^2 for the `count` springs from points a to b of a row.
CLOTHSIM_VERSIONS
void add_stretches(const double* ax, const double* ay, const double* az, const double* bx, const double* by, const double* bz,
                   int count, double rest, double* __restrict sum) {
    for (int c = 0; c < count; ++c) {
        const double dx = bx[c] - ax[c], dy = by[c] - ay[c], dz = bz[c] - az[c];
        const double stretch = std::sqrt(dx * dx + dy * dy + dz * dz) - rest;
        sum[c] += stretch * stretch;
    }
}

// Of a row: kinetic[c] += m v^2 / 2, height[c] += m g.x.
CLOTHSIM_VERSIONS
void add_points(const double* x, const double* v, std::size_t plane, const double* mass, const double* gravity, int count,
                double* __restrict kinetic, double* __restrict height) {
    for (int c = 0; c < count; ++c) {
        const double vx = v[c], vy = v[plane + std::size_t(c)], vz = v[2 * plane + std::size_t(c)];
        kinetic[c] += mass[c] * (vx * vx + vy * vy + vz * vz) / 2;
        height[c] += mass[c] * (gravity[0] * x[c] + gravity[1] * x[plane + std::size_t(c)] + gravity[2] * x[2 * plane + std::size_t(c)]);
    }
}

}  // namespace

Energy energy(const Cloth& cloth, const Vec3& gravity, const PointsView& x, const PointsView& v) {
    const std::size_t points = std::size_t(cloth.points()), columns = std::size_t(cloth.columns);
    std::vector<double> buffer(6 * points + 2 * columns);
    double* const xs = buffer.data();
    double* const vs = xs + 3 * points;
    double* const first = vs + 3 * points;
    double* const second = first + columns;
    take_apart(x.data(), points, xs);
    take_apart(v.data(), points, vs);
    const auto sum = [&](const double* values) { return std::accumulate(values, values + columns, 0.0); };

    Energy e{0, 0, 0};
    for (std::size_t r = 0; r < std::size_t(cloth.rows); ++r)
        add_points(xs + r * columns, vs + r * columns, points, &cloth.mass[r * columns], gravity.data(), cloth.columns, first, second);
    e.kinetic = sum(first);
    e.gravity = -sum(second);
    for (const Neighbour& n : neighbours) {
        const bool counted_once = n.row > 0 || (n.row == 0 && n.column > 0);
        const int start = std::max(0, -n.column), count = cloth.columns - std::abs(n.column);
        if (!cloth.present[n.family] || !counted_once || count <= 0) continue;
        std::fill_n(first, columns, 0.0);
        for (int r = 0; r + n.row < cloth.rows; ++r) {
            const double* const a = xs + r * cloth.columns + start;
            const double* const b = a + n.row * cloth.columns + n.column;
            add_stretches(a, a + points, a + 2 * points, b, b + points, b + 2 * points, count, cloth.rest_length(n), first);
        }
        e.elastic += cloth.stiffness[n.family] / 2 * sum(first);
    }
    return e;
}

}  // namespace clothsim
