// The mass-spring cloth on a regular grid, and its parameters.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

#include "model/stencil.hpp"
#include "model/thread_grid.hpp"

namespace clothsim {

struct Cloth {
    int rows = 0;
    int columns = 0;
    double row_spacing = 0;     // m, along the rows (z)
    double column_spacing = 0;  // m, along the columns (x)
    std::array<bool, family_count> present{};
    std::array<double, family_count> stiffness{};       // N/m
    std::array<double, family_count> spring_damping{};  // N s/m, along the spring
    double drag = 0;                                    // N s/m per mass point
    bool uniform_mass = true;
    // Each point has these; the copies of a cloth share them.
    std::shared_ptr<const double[]> mass;  // kg
    std::shared_ptr<const bool[]> pinned;

    int points() const { return rows * columns; }
    ThreadGrid grid() const { return {columns, rows}; }

    double rest_length(const Neighbour& n) const {
        const double along_rows = n.row * row_spacing;
        const double along_columns = n.column * column_spacing;
        return std::sqrt(along_columns * along_columns + along_rows * along_rows);
    }

    bool has_spring_damping() const {
        for (int f = 0; f < family_count; ++f)
            if (present[f] && spring_damping[f] != 0) return true;
        return false;
    }

    // Returns 1 / mass of a point that moves, 0 of one that does not [1/kg].
    double mobility(int point) const {
        return pinned[std::size_t(point)] ? 0 : 1 / mass[std::size_t(point)];
    }
    double largest_mobility() const {
        double most = 0;
        for (int i = 0; i < points(); ++i) most = std::max(most, mobility(i));
        return most;
    }

    // Calls `visit(i, j, neighbour)` for each spring once, from mass point i to j.
    template <class Visit>
    void each_spring(Visit visit) const {
        for (const Neighbour& n : neighbours) {
            if (!present[n.family] || !leads_on(n)) continue;
            for (int row = 0; row + n.row < rows; ++row)
                for (int column = std::max(0, -n.column);
                     column < std::min(columns, columns - n.column); ++column) {
                    const int i = row * columns + column;
                    visit(i, i + n.row * columns + n.column, n);
                }
        }
    }
};

}  // namespace clothsim
