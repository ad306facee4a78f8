#include "simulation/diagnostics.hpp"

#include <algorithm>
#include <limits>

namespace clothsim {

Energy energy(const Cloth& cloth, const Vec3& gravity, const PointsView& x, const PointsView& v) {
    Energy e{0, 0, 0};
    for (int i = 0; i < cloth.points(); ++i) {
        e.kinetic += cloth.mass[i] / 2 * v.row(i).squaredNorm();
        e.gravity -= cloth.mass[i] * gravity.dot(x.row(i));
    }
    for (int n = 0; n < neighbour_count; ++n) {
        const Neighbour& neighbour = neighbours[n];
        const bool counted_once = neighbour.row > 0 || (neighbour.row == 0 && neighbour.column > 0);
        if (!cloth.present[neighbour.family] || !counted_once) continue;
        const double rest_length = cloth.rest_length(neighbour);
        const double half_stiffness = cloth.stiffness[neighbour.family] / 2;
        for (int r = 0; r + neighbour.row < cloth.rows; ++r)
            for (int c = std::max(0, -neighbour.column); c + std::max(0, neighbour.column) < cloth.columns; ++c) {
                const int i = r * cloth.columns + c;
                const int j = i + neighbour.row * cloth.columns + neighbour.column;
                const double stretch = (x.row(j) - x.row(i)).norm() - rest_length;
                e.elastic += half_stiffness * stretch * stretch;
            }
    }
    return e;
}

Eigen::Matrix<std::int64_t, Eigen::Dynamic, 3, Eigen::RowMajor> triangles(int rows, int columns) {
    Eigen::Matrix<std::int64_t, Eigen::Dynamic, 3, Eigen::RowMajor> result(2 * std::int64_t(rows - 1) * (columns - 1), 3);
    std::int64_t next = 0;
    for (std::int64_t r = 0; r + 1 < rows; ++r)
        for (std::int64_t c = 0; c + 1 < columns; ++c) {
            const std::int64_t i = r * columns + c;
            result.row(next++) << i, i + 1, i + columns;
            result.row(next++) << i + 1, i + columns + 1, i + columns;
        }
    return result;
}

// Voronoi regions of the triangle, vertices and edges first (Ericson, Real-Time Collision Detection, 5.1.5).
Vec3 closest_point_on_triangle(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c) {
    const Vec3 ab = b - a, ac = c - a, ap = p - a;
    const double ab_ap = ab.dot(ap), ac_ap = ac.dot(ap);
    if (ab_ap <= 0 && ac_ap <= 0) return a;

    const Vec3 bp = p - b;
    const double ab_bp = ab.dot(bp), ac_bp = ac.dot(bp);
    if (ab_bp >= 0 && ac_bp <= ab_bp) return b;

    const double weight_c = ab_ap * ac_bp - ab_bp * ac_ap;
    if (weight_c <= 0 && ab_ap >= 0 && ab_bp <= 0) {
        const double length = ab_ap - ab_bp;
        return length > 0 ? Vec3(a + ab_ap / length * ab) : a;
    }

    const Vec3 cp = p - c;
    const double ab_cp = ab.dot(cp), ac_cp = ac.dot(cp);
    if (ac_cp >= 0 && ab_cp <= ac_cp) return c;

    const double weight_b = ab_cp * ac_ap - ab_ap * ac_cp;
    if (weight_b <= 0 && ac_ap >= 0 && ac_cp <= 0) {
        const double length = ac_ap - ac_cp;
        return length > 0 ? Vec3(a + ac_ap / length * ac) : a;
    }

    const double weight_a = ab_bp * ac_cp - ab_cp * ac_bp;
    const double along_b = ac_bp - ab_bp, along_c = ab_cp - ac_cp;
    if (weight_a <= 0 && along_b >= 0 && along_c >= 0) {
        const double length = along_b + along_c;
        return length > 0 ? Vec3(b + along_b / length * (c - b)) : b;
    }

    const double total = weight_a + weight_b + weight_c;
    return a + (weight_b * ab + weight_c * ac) / total;
}

Penetration penetration(int rows, int columns, const PointsView& x, const Vec3& center, double radius) {
    const auto corner = [&](std::int64_t i) { return Vec3(x.row(i).transpose()); };
    double nearest_point = std::numeric_limits<double>::infinity();
    for (std::int64_t i = 0; i < x.rows(); ++i)
        nearest_point = std::min(nearest_point, (corner(i) - center).norm());
    double nearest = nearest_point;
    const auto indices = triangles(rows, columns);
    for (std::int64_t t = 0; t < indices.rows(); ++t) {
        const Vec3 closest = closest_point_on_triangle(center, corner(indices(t, 0)), corner(indices(t, 1)),
                                                       corner(indices(t, 2)));
        nearest = std::min(nearest, (closest - center).norm());
    }
    return {std::max(0.0, radius - nearest_point), std::max(0.0, radius - nearest)};
}

}  // namespace clothsim
