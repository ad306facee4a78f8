// The energy of a state and its largest stretch, quick enough to be watched in every run. Springs
// are summed column by column, so that the sums are the same for every instruction set.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <numeric>
#include <vector>

#include "lanes/versions.hpp"
#include "measure/diagnostics.hpp"

namespace clothsim {
namespace {

// Takes x, y and z of `count` points apart, a plane after the other.
CLOTHSIM_VERSIONS
void take_apart(const double* __restrict points, std::ptrdiff_t count, double* __restrict planes) {
    for (std::ptrdiff_t i = 0; i < count; ++i)
        for (int k = 0; k < 3; ++k) planes[k * count + i] = points[3 * i + k];
}

// Springs of one kind: there are `count` in each of `rows` rows, from points of a row to those
// `offset` further on.
struct SpringRows {
    std::ptrdiff_t plane, row, offset;
    int rows, count;
    double rest_length;
};

// Adds the springs of a column: sum[c] += (length - rest length)^2, largest[c] = max(largest[c],
// length^2).
CLOTHSIM_VERSIONS
void add_stretches(const double* first, const SpringRows& s, double* __restrict sum,
                   double* __restrict largest) {
    for (int r = 0; r < s.rows; ++r) {
        const double* const ax = first + r * s.row;
        const double *const ay = ax + s.plane, *const az = ay + s.plane;
        const double *const bx = ax + s.offset, *const by = ay + s.offset,
                            *const bz = az + s.offset;
        for (int c = 0; c < s.count; ++c) {
            const double dx = bx[c] - ax[c];
            const double dy = by[c] - ay[c];
            const double dz = bz[c] - az[c];
            const double square = dx * dx + dy * dy + dz * dz;
            const double stretch = std::sqrt(square) - s.rest_length;
            sum[c] += stretch * stretch;
            largest[c] = square > largest[c] ? square : largest[c];
        }
    }
}

// Calls `visit(kind, rest length, sum of (length - rest length)^2, largest length)` for each kind
// of spring that the cloth has.
template <class Visit>
void each_spring_kind(const Cloth& cloth, const PointsView& x, Visit visit) {
    std::vector<double> planes(std::size_t(3 * x.rows())), sum, largest;
    take_apart(x.data(), x.rows(), planes.data());
    for (const Neighbour& n : neighbours) {
        const SpringRows springs{cloth.points(),
                                 cloth.columns,
                                 std::ptrdiff_t(n.row) * cloth.columns + n.column,
                                 cloth.rows - n.row,
                                 cloth.columns - std::abs(n.column),
                                 cloth.rest_length(n)};
        if (!cloth.present[n.family] || !leads_on(n) || springs.count <= 0 || springs.rows <= 0)
            continue;
        sum.assign(std::size_t(springs.count), 0.0);
        largest.assign(std::size_t(springs.count), 0.0);
        add_stretches(planes.data() + std::max(0, -n.column), springs, sum.data(), largest.data());
        visit(n, springs.rest_length, std::accumulate(sum.begin(), sum.end(), 0.0),
              std::sqrt(*std::max_element(largest.begin(), largest.end())));
    }
}

}  // namespace

Energy energy(const Scene& scene, const PointsView& x, const PointsView& v, double t) {
    Energy e{0, 0, 0, 0, 0};
    for (int i = 0; i < scene.cloth.points(); ++i) {
        e.kinetic += scene.cloth.mass[i] / 2 * v.row(i).squaredNorm();
        e.gravity -= scene.cloth.mass[i] * x.row(i).dot(scene.gravity);
    }
    if (scene.has_force()) e.force = -scene.force.cwiseProduct(x).sum();
    each_spring_kind(scene.cloth, x, [&](const Neighbour& n, double, double squares, double) {
        e.elastic += scene.cloth.stiffness[n.family] / 2 * squares;
    });
    each_contact(scene, t, each_free_of(scene.cloth, x),
                 [&](std::size_t, const PenaltyContact& contact, int,
                     const PenaltyContact::Gap& gap) { e.contact += contact.energy(gap.depth); });
    return e;
}

double largest_stretch(const Cloth& cloth, const PointsView& x) {
    double most = -std::numeric_limits<double>::infinity();
    each_spring_kind(cloth, x, [&](const Neighbour&, double rest_length, double, double longest) {
        most = std::max(most, longest / rest_length - 1);
    });
    return most;
}

}  // namespace clothsim
