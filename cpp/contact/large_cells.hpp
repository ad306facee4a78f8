// Cells larger than a sphere of offset "cell". Their corners may all be too far from the sphere to touch it,
// while the sphere is in the middle of the cell.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "contact/exact.hpp"
#include "measure/diagnostics.hpp"
#include "model/cloth.hpp"

namespace clothsim {

class LargeCells {
public:
    // The first point of a cell that is larger than a sphere and lies in it, or -1. `position(i)` of a mass
    // point.
    template <class Position>
    std::int64_t pierced(const Cloth& cloth, const std::vector<SweptSphere>& spheres,
                         const Position& position) {
        if (!some_ && ++steps_ < steps_between_scans) return -1;
        steps_ = 0;
        some_ = false;
        std::int64_t first = -1;
        const int right = cloth.columns > 1, below = cloth.rows > 1 ? cloth.columns : 0;
        for (int r = 0; r < std::max(cloth.rows - 1, 1); ++r) {
            const int start = r * cloth.columns;
            std::array<Vec3, 4> x{position(start), position(start), position(start + below),
                                  position(start + below)};
            for (int c = 0; c < std::max(cloth.columns - 1, 1); ++c) {
                const int i = start + c;
                x = {x[1], position(i + right), x[3], position(i + below + right)};
                const double size2 = std::max((x[3] - x[0]).squaredNorm(), (x[2] - x[1]).squaredNorm());
                for (const SweptSphere& s : spheres)
                    if (s.cells && size2 > about * s.radius * s.radius) {
                        some_ = true;
                        if (first < 0 && size2 > 4 * s.radius * s.radius && lies_in(x, s)) first = i;
                    }
            }
        }
        return first;
    }

private:
    // Steps with contact from scan to scan. A scan takes about as long as two steps. Half cost 1 % of a step,
    // with twice as many a cell may grow for longer before its first scan.
    static constexpr int steps_between_scans = 256;
    // Squared diagonal of a cell, in squared radii, above which every step scans: 0.9 of the largest that
    // fits.
    static constexpr double about = 4 * 0.81;

    static bool lies_in(const std::array<Vec3, 4>& x, const SweptSphere& s) {
        const Vec3 center = exact::vec(s.end);
        const auto inside = [&](std::size_t i, std::size_t j, std::size_t k) {
            return (closest_point_on_triangle(center, x[i], x[j], x[k]) - center).norm() < s.radius - s.slop;
        };
        return inside(0, 2, 1) || inside(1, 2, 3);
    }

    int steps_ = steps_between_scans;
    bool some_ = false;  // the newest scan found cells that are about as large as a sphere: every step scans
};

}  // namespace clothsim
