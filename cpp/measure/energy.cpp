// The energy of a state and its largest stretch, quick enough to be watched in every run. Columns are summed
// side by side, so that the sums are the same for every instruction set.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <memory>
#include <numeric>
#include <vector>

#include "measure/diagnostics.hpp"
#include "memory/versions.hpp"

namespace clothsim {
namespace {

// x, y and z of `count` points, a plane after the other.
CLOTHSIM_VERSIONS
void take_apart(const double* __restrict points, std::ptrdiff_t count, double* __restrict x,
                double* __restrict y, double* __restrict z) {
    for (std::ptrdiff_t i = 0; i < count; ++i) {
        x[i] = points[3 * i];
        y[i] = points[3 * i + 1];
        z[i] = points[3 * i + 2];
    }
}

// Of the coordinates of a row: squares[j] += m v^2, heights[j] += m x.
CLOTHSIM_VERSIONS
void add_points(const double* x, const double* v, const double* mass, int count, double* __restrict squares,
                double* __restrict heights) {
    for (int j = 0; j < count; ++j) {
        squares[j] += mass[j] * (v[j] * v[j]);
        heights[j] += mass[j] * x[j];
    }
}

// Springs of one kind: `count` in each of `rows` rows, from points of a row to those `offset` further on.
struct Springs {
    std::ptrdiff_t plane, row, offset;
    int rows, count;
    double rest_length;
};

// `add(c, |b - a|^2)` for each spring, of its column.
template <class Add>
inline __attribute__((always_inline)) void each_square(const double* first, const Springs& s, Add add) {
    for (int r = 0; r < s.rows; ++r) {
        const double* const ax = first + r * s.row;
        const double *const ay = ax + s.plane, *const az = ay + s.plane;
        const double *const bx = ax + s.offset, *const by = ay + s.offset, *const bz = az + s.offset;
        for (int c = 0; c < s.count; ++c) {
            const double dx = bx[c] - ax[c], dy = by[c] - ay[c], dz = bz[c] - az[c];
            add(c, dx * dx + dy * dy + dz * dz);
        }
    }
}

// sum[c] += (length - rest length)^2
CLOTHSIM_VERSIONS
void add_stretches(const double* first, const Springs& s, double* __restrict sum) {
    each_square(first, s, [&](int c, double square) __attribute__((always_inline)) {
        const double stretch = std::sqrt(square) - s.rest_length;
        sum[c] += stretch * stretch;
    });
}

// largest[c] = max(largest[c], length^2)
CLOTHSIM_VERSIONS
void raise_squares(const double* first, const Springs& s, double* __restrict largest) {
    each_square(first, s, [&](int c, double square) __attribute__((always_inline)) {
        largest[c] = square > largest[c] ? square : largest[c];
    });
}

// `visit(kind, springs, first)` for each kind of spring that the cloth has, of points in planes.
template <class Visit>
void each_kind(const Cloth& cloth, const double* planes, Visit visit) {
    for (const Neighbour& n : neighbours) {
        const bool counted_once = n.row > 0 || (n.row == 0 && n.column > 0);
        const Springs springs{cloth.points(),
                              cloth.columns,
                              std::ptrdiff_t(n.row) * cloth.columns + n.column,
                              cloth.rows - n.row,
                              cloth.columns - std::abs(n.column),
                              cloth.rest_length(n)};
        if (cloth.present[n.family] && counted_once && springs.count > 0 && springs.rows > 0)
            visit(n, springs, planes + std::max(0, -n.column));
    }
}

}  // namespace

Energy energy(const Scene& scene, const PointsView& x, const PointsView& v) {
    const Cloth& cloth = scene.cloth;
    const std::ptrdiff_t points = cloth.points(), row = 3 * std::ptrdiff_t(cloth.columns);
    const auto buffer = std::unique_ptr<double[]>(new double[std::size_t(3 * points + 3 * row)]);
    double* const planes = buffer.get();
    double* const mass = planes + 3 * points;
    double* const squares = mass + row;
    double* const heights = squares + row;

    std::fill_n(squares, 2 * row, 0.0);
    for (std::ptrdiff_t r = 0; r < cloth.rows; ++r) {
        for (std::ptrdiff_t j = 0; j < row && (r == 0 || !cloth.uniform_mass); ++j)
            mass[j] = cloth.mass[std::size_t(r * cloth.columns + j / 3)];
        add_points(x.data() + r * row, v.data() + r * row, mass, int(row), squares, heights);
    }
    Energy e{std::accumulate(squares, squares + row, 0.0) / 2, 0, 0, 0};
    for (std::ptrdiff_t j = 0; j < row; ++j) e.gravity -= scene.gravity[j % 3] * heights[j];
    if (scene.has_force()) e.force = -scene.force.cwiseProduct(x).sum();

    take_apart(x.data(), points, planes, planes + points, planes + 2 * points);
    each_kind(cloth, planes, [&](const Neighbour& n, const Springs& springs, const double* first) {
        std::fill_n(squares, springs.count, 0.0);
        add_stretches(first, springs, squares);
        e.elastic += cloth.stiffness[n.family] / 2 * std::accumulate(squares, squares + springs.count, 0.0);
    });
    return e;
}

// A length is a monotonic function of its square, so the root of the largest square suffices for each kind.
double largest_stretch(const Cloth& cloth, const PointsView& x) {
    const std::ptrdiff_t points = cloth.points();
    const auto planes = std::unique_ptr<double[]>(new double[std::size_t(3 * points)]);
    take_apart(x.data(), points, planes.get(), planes.get() + points, planes.get() + 2 * points);
    double largest = -std::numeric_limits<double>::infinity();
    each_kind(cloth, planes.get(), [&](const Neighbour&, const Springs& springs, const double* first) {
        std::vector<double> squares(std::size_t(springs.count));
        raise_squares(first, springs, squares.data());
        const double length = std::sqrt(*std::max_element(squares.begin(), squares.end()));
        largest = std::max(largest, length / springs.rest_length - 1);
    });
    return largest;
}

}  // namespace clothsim
