#include "measure/diagnostics.hpp"

#include <algorithm>
#include <Eigen/Geometry>
#include <limits>
#include <vector>

namespace clothsim {

namespace {

Vec3 closest_point_on_segment(const Vec3& p, const Vec3& a, const Vec3& b) {
    const Vec3 ab = b - a;
    const double length2 = ab.squaredNorm();
    return length2 > 0 ? Vec3(a + std::clamp(ab.dot(p - a) / length2, 0.0, 1.0) * ab) : a;
}

// Of the bound in `penetration`, far more than its few operations lose.
constexpr double rounding = 1e-12;

}  // namespace

// The nearest of the sides, or the foot of the perpendicular if it lies inside. Every candidate is
// a point of the triangle, so that a thin or collapsed one gives its nearest side and nothing
// worse.
Vec3 closest_point_on_triangle(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c) {
    Vec3 best = closest_point_on_segment(p, a, b);
    const auto consider = [&](const Vec3& q) {
        if ((q - p).squaredNorm() < (best - p).squaredNorm()) best = q;
    };
    consider(closest_point_on_segment(p, b, c));
    consider(closest_point_on_segment(p, c, a));

    const Vec3 ab = b - a, ac = c - a, ap = p - a;
    const Vec3 normal = ab.cross(ac);
    const double area2 = normal.squaredNorm();
    if (area2 > 0) {
        const double weight_b = ap.cross(ac).dot(normal) / area2;
        const double weight_c = ab.cross(ap).dot(normal) / area2;
        if (weight_b >= 0 && weight_c >= 0 && weight_b + weight_c <= 1)
            consider(a + weight_b * ab + weight_c * ac);
    }
    return best;
}

// The distance of a triangle from the centre is at least that of a corner less its longest side. A
// triangle that cannot come nearer than the nearest so far is skipped; that is nearly all of them.
Penetration penetration(int rows, int columns, const PointsView& x, const Sphere& sphere,
                        double t) {
    if (sphere.flat()) {
        const Surface surface = sphere.surface_at(t);
        double depth = 0;
        for (std::int64_t i = 0; i < x.rows(); ++i) {
            const double level = surface.level(x.row(i).transpose() - surface.place);
            depth = std::max(depth, -surface.height(level));
        }
        return {depth, depth};
    }
    const Vec3 center = sphere.center_at(t);
    const double radius = sphere.radius;
    const auto corner = [&](std::int64_t i) { return Vec3(x.row(i).transpose()); };
    std::vector<double> distances(std::size_t(x.rows()));
    double nearest_point = std::numeric_limits<double>::infinity();
    for (std::int64_t i = 0; i < x.rows(); ++i) {
        distances[std::size_t(i)] = (corner(i) - center).norm();
        nearest_point = std::min(nearest_point, distances[std::size_t(i)]);
    }
    // What is farther than the radius is no depth.
    double nearest = std::min(nearest_point, radius);
    const auto consider = [&](std::int64_t a, std::int64_t b, std::int64_t c) {
        const Vec3 at_a = corner(a), at_b = corner(b), at_c = corner(c);
        const double longest2 = std::max((at_b - at_a).squaredNorm(), (at_c - at_a).squaredNorm());
        const double further = distances[std::size_t(a)] * (1 - rounding) - nearest;
        if (further > 0 && further * further > longest2 * (1 + rounding)) return;
        nearest = std::min(nearest,
                           (closest_point_on_triangle(center, at_a, at_b, at_c) - center).norm());
    };
    if (rows == 1 || columns == 1)  // a chain: its links
        for (std::int64_t i = 0; i + 1 < x.rows(); ++i) consider(i, i + 1, i + 1);
    for (std::int64_t r = 0; r + 1 < rows; ++r)
        for (std::int64_t c = 0; c + 1 < columns; ++c) {
            const std::int64_t i = r * columns + c;
            consider(i, i + 1, i + columns);
            consider(i + 1, i + columns + 1, i + columns);
        }
    return {std::max(0.0, radius - nearest_point), std::max(0.0, radius - nearest)};
}

namespace {

static_assert(spring_kind_count == 5 && stencil_reach == 2,
              "largest_symbol knows five kinds of springs");
double largest_symbol(const Cloth& cloth, const std::array<double, family_count>& coefficient) {
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
        for (const double y : {-1.0, 1.0, stationary_on_edge(-1)})
            most = std::max(most, symbol(-1, y));
        if (kh + kb > 0) {
            const double x = inside(-ks / (2 * kh + 4 * kb));
            most = std::max(most, symbol(x, x));
        }
    }
    return most;
}

double largest_sum_of_springs(const Cloth& cloth,
                              const std::array<double, family_count>& coefficient) {
    double most = 0;
    for (int r = 0; r < cloth.rows; ++r)
        for (int c = 0; c < cloth.columns; ++c) {
            const double here = cloth.mobility(r * cloth.columns + c);
            if (here == 0) continue;
            double sum = 0;
            for (const Neighbour& n : neighbours) {
                const int row = r + n.row, column = c + n.column;
                if (!cloth.present[n.family] || row < 0 || row >= cloth.rows || column < 0 ||
                    column >= cloth.columns)
                    continue;
                sum +=
                    coefficient[n.family] * (here + cloth.mobility(row * cloth.columns + column));
            }
            most = std::max(most, sum);
        }
    return most;
}

// Largest eigenvalue of the spring Laplacian per unit mass, from above: coefficient[f] N/m
// (stiffness) or N s/m (damping) give 1/s^2 or 1/s. It is the smaller of two bounds. Pinned points
// only count as ends of springs.
//
// On an infinite uniform grid a wave of (a, b) radians per point has, with x = cos a, y = cos b,
//   2 Ks (2 - x - y) + 4 Kh (1 - x y) + 4 Kb (2 - x^2 - y^2)
// Its maximum over the square, over the lightest mass, bounds every finite cloth. Leaving points
// out, or pinning them, leaves non-negative terms out of the quadratic form. The bound is 8 K
// structural, 12 K with shear, 16.33 K with bend.
//
// Where masses differ, or the cloth is narrow, the bound by single springs may be sharper:
//   k |y_i - y_j|^2 <= k (1/m_i + 1/m_j) (m_i |y_i|^2 + m_j |y_j|^2)
// (Cauchy-Schwarz), so no eigenvalue is above the largest sum of k (1/m_i + 1/m_j) over the springs
// of a point.
double laplacian_bound(const Cloth& cloth, const std::array<double, family_count>& coefficient) {
    const double waves = largest_symbol(cloth, coefficient) * cloth.largest_mobility();
    const bool uniform = cloth.uniform_mass && std::min(cloth.rows, cloth.columns) > 2;
    return uniform ? waves : std::min(waves, largest_sum_of_springs(cloth, coefficient));
}

}  // namespace

ModeBounds mode_bounds(const Cloth& cloth) {
    return {laplacian_bound(cloth, cloth.stiffness), laplacian_bound(cloth, cloth.spring_damping)};
}

}  // namespace clothsim
