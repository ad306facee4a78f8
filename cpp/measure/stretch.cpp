// The largest stretch of all springs, quick enough for many inspections in a run. A length is a monotonic
// function of its square, so the root of the largest square suffices for each kind of spring.
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "measure/diagnostics.hpp"
#include "memory/versions.hpp"

namespace clothsim {
namespace {

// largest[c] = max(largest[c], |b[c] - a[c]|^2) for the `count` springs from points a to b of a row.
CLOTHSIM_VERSIONS
void raise_squares(const double* ax, const double* ay, const double* az, const double* bx, const double* by,
                   const double* bz, int count, double* __restrict largest) {
    for (int c = 0; c < count; ++c) {
        const double dx = bx[c] - ax[c], dy = by[c] - ay[c], dz = bz[c] - az[c];
        const double square = dx * dx + dy * dy + dz * dz;
        largest[c] = square > largest[c] ? square : largest[c];
    }
}

}  // namespace

double largest_stretch(const Cloth& cloth, const PointsView& x) {
    const std::size_t points = std::size_t(cloth.points());
    std::vector<double> planes(3 * points + std::size_t(cloth.columns));
    for (std::size_t i = 0; i < points; ++i)
        for (std::size_t k = 0; k < 3; ++k) planes[k * points + i] = x.data()[3 * i + k];
    double* const squares = planes.data() + 3 * points;

    double largest = -std::numeric_limits<double>::infinity();
    for (const Neighbour& n : neighbours) {
        const bool counted_once = n.row > 0 || (n.row == 0 && n.column > 0);
        if (!cloth.present[n.family] || !counted_once) continue;
        const int first = std::max(0, -n.column), count = cloth.columns - std::abs(n.column);
        if (count <= 0 || n.row >= cloth.rows) continue;
        std::fill_n(squares, count, 0.0);
        for (int r = 0; r + n.row < cloth.rows; ++r) {
            const double* const a = planes.data() + r * cloth.columns + first;
            const double* const b = a + n.row * cloth.columns + n.column;
            raise_squares(a, a + points, a + 2 * points, b, b + points, b + 2 * points, count, squares);
        }
        const double length = std::sqrt(*std::max_element(squares, squares + count));
        largest = std::max(largest, length / cloth.rest_length(n) - 1);
    }
    return largest;
}

}  // namespace clothsim
