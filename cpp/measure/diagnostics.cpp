#include "measure/diagnostics.hpp"

#include <algorithm>
#include <cmath>
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

// The nearest of the sides, or the foot of the perpendicular if it lies inside. Every candidate is a point of
// the triangle, so that a thin or collapsed one gives its nearest side and nothing worse.
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

// The distance of a triangle from the centre is at least that of a corner less its longest side. A triangle
// that cannot come nearer than the nearest so far is skipped; that is nearly all of them.
Penetration penetration(int rows, int columns, const PointsView& x, const Sphere& sphere, double t) {
    if (sphere.flat()) {
        double depth = 0;
        for (std::int64_t i = 0; i < x.rows(); ++i)
            depth = std::max(depth, -sphere.height(x.row(i).transpose() - sphere.place_at(t)));
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
    double nearest = std::min(nearest_point, radius);  // what is farther than the radius is no depth
    const auto consider = [&](std::int64_t a, std::int64_t b, std::int64_t c) {
        const Vec3 at_a = corner(a), at_b = corner(b), at_c = corner(c);
        const double longest2 = std::max((at_b - at_a).squaredNorm(), (at_c - at_a).squaredNorm());
        const double further = distances[std::size_t(a)] * (1 - rounding) - nearest;
        if (further > 0 && further * further > longest2 * (1 + rounding)) return;
        nearest = std::min(nearest, (closest_point_on_triangle(center, at_a, at_b, at_c) - center).norm());
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

}  // namespace clothsim
