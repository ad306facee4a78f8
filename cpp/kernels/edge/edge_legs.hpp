// The springs of a row as the edge kernel takes them, vector by vector of its mass points.
#pragma once

#include <array>

#include "model/stencil.hpp"

namespace clothsim {
namespace {

// Springs that start in a vector of points, and the spring that rises from the row below to the next vector.
enum Leg : int {
    rising,
    down,
    falling,
    down_2,
    side,
    side_2,
    leg_count,
};
using Legs = unsigned;  // a set of them
inline constexpr std::array<SpringKind, leg_count> kind_of_leg{to_diagonal, to_below, to_diagonal,
                                                               to_below_2,  to_right, to_right_2};

constexpr int legs_needed() {
    int legs = 0;  // two of a diagonal kind
    for (const MirroredNeighbour& n : neighbours) legs += leads_on(n);
    return legs;
}
static_assert(legs_needed() == leg_count,
              "a spring without a leg here lacks a place in the sums of edge_row.hpp and edge_general.hpp");

}  // namespace
}  // namespace clothsim
