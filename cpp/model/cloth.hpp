// The mass-spring cloth on a regular grid: spring families, neighbours, parameters.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <memory>

#include "model/thread_grid.hpp"

namespace clothsim {

enum Family : int { structural = 0, shear = 1, bend = 2 };
inline constexpr int family_count = 3;
inline constexpr std::array<const char*, family_count> family_names{"structural", "shear", "bend"};

// Where a thread looks for its neighbours, in the order in which it adds their forces. The order is
// part of the strict arithmetic class: the shader and the "gather" kernel keep it.
struct Neighbour {
    int row, column;
    Family family;
};
inline constexpr int neighbour_count = 12;
inline constexpr std::array<Neighbour, neighbour_count> neighbours{{
    {0, 1, structural}, {0, -1, structural}, {1, 0, structural}, {-1, 0, structural},
    {1, 1, shear},      {1, -1, shear},      {-1, 1, shear},     {-1, -1, shear},
    {0, 2, bend},       {0, -2, bend},       {2, 0, bend},       {-2, 0, bend},
}};

// A value for each mass point that never changes, so that the copies of a cloth share it.
template <class T>
class PerPoint {
public:
    PerPoint() = default;
    PerPoint(const T* values, std::size_t count) : values_(std::make_shared_for_overwrite<T[]>(count)) {
        std::copy_n(values, count, values_.get());
    }
    const T& operator[](std::size_t point) const { return values_[std::ptrdiff_t(point)]; }

private:
    std::shared_ptr<T[]> values_;
};

struct Cloth {
    int rows = 0;
    int columns = 0;
    double row_spacing = 0;     // m, along the rows (z)
    double column_spacing = 0;  // m, along the columns (x)
    std::array<bool, family_count> present{};
    std::array<double, family_count> stiffness{};       // N/m
    std::array<double, family_count> spring_damping{};  // N s/m, along the spring
    double point_damping = 0;                           // N s/m per mass point
    bool uniform_mass = true;
    PerPoint<double> mass;  // kg
    PerPoint<bool> pinned;

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
};

}  // namespace clothsim
