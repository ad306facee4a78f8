#include "reference/springs.hpp"

#include <cmath>

namespace clothsim::reference {

std::vector<Spring> springs(const Cloth& cloth) {
    static_assert(family_count == 3, "the reference has a list of springs of its own");
    std::vector<Spring> result;
    const auto join = [&](Family family, int row, int column, int rows, int columns) {
        const int other_row = row + rows, other_column = column + columns;
        if (!cloth.present[family] || other_row >= cloth.rows || other_column < 0 ||
            other_column >= cloth.columns)
            return;
        result.push_back({row * cloth.columns + column, other_row * cloth.columns + other_column,
                          std::hypot(rows * cloth.row_spacing, columns * cloth.column_spacing),
                          cloth.stiffness[family], cloth.spring_damping[family]});
    };
    for (int row = 0; row < cloth.rows; ++row)
        for (int column = 0; column < cloth.columns; ++column) {
            join(structural, row, column, 0, 1);
            join(structural, row, column, 1, 0);
            join(shear, row, column, 1, 1);
            join(shear, row, column, 1, -1);
            join(bend, row, column, 0, 2);
            join(bend, row, column, 2, 0);
        }
    return result;
}

}  // namespace clothsim::reference
