// Cells larger than a sphere of offset "cell". Their corners may all be too far from the sphere to
// touch it, while the sphere is in the middle of the cell.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "measure/diagnostics.hpp"
#include "model/cloth.hpp"
#include "model/sphere.hpp"

namespace clothsim {

// The first point of a cell that is larger than a sphere and touches it at time t, or -1.
// `position(i)` of a mass point.
template <class Position>
std::int64_t large_cell_at_sphere(const Cloth& cloth, const std::vector<Sphere>& spheres, double t,
                                  const Position& position) {
    const int right = cloth.columns > 1, below = cloth.rows > 1 ? cloth.columns : 0;
    for (int r = 0; r < std::max(cloth.rows - 1, 1); ++r) {
        const int start = r * cloth.columns;
        std::array<Vec3, 4> x{position(start), position(start), position(start + below),
                              position(start + below)};
        for (int c = 0; c < std::max(cloth.columns - 1, 1); ++c) {
            x = {x[1], position(start + c + right), x[3], position(start + c + below + right)};
            const double size2 = std::max((x[3] - x[0]).squaredNorm(), (x[2] - x[1]).squaredNorm());
            for (const Sphere& s : spheres) {
                if (!s.cells || size2 <= 4 * s.radius * s.radius) continue;
                const Vec3 center = s.center_at(t);
                for (const std::size_t corner : {0, 3})
                    if ((closest_point_on_triangle(center, x[corner], x[1], x[2]) - center).norm() <
                        s.radius + s.reach())
                        return start + c;
            }
        }
    }
    return -1;
}

}  // namespace clothsim
