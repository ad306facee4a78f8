// The springs of a cloth: the one list of the neighbours of a mass point. The kernels, the
// coefficients, the measures, the compute shader and Python take it from here. A family is added
// here; code that cannot follow by itself does not compile without its part.
#pragma once

#include <array>
#include <cstdint>

namespace clothsim {

enum Family : int {
    structural,
    shear,
    bend,
};
inline constexpr int family_count = 3;
inline constexpr std::array<const char*, family_count> family_names{"structural", "shear", "bend"};

// A spring leads to the mass point so many rows and columns on.
struct Neighbour {
    int row, column;
    Family family;
};

// The list has each spring once up to its mirror images, in the order in which a mass point sums
// their forces.
enum SpringKind : int {
    to_right,
    to_below,
    to_diagonal,
    to_right_2,
    to_below_2,
};
inline constexpr int spring_kind_count = 5;
inline constexpr std::array<Neighbour, spring_kind_count> spring_kinds{
    {{0, 1, structural}, {1, 0, structural}, {1, 1, shear}, {0, 2, bend}, {2, 0, bend}}};

// The list is in the order in which a thread of the compute shader adds its neighbours' forces:
// every kind, mirrored in columns, then in rows. The order is part of the strict arithmetic class.
inline constexpr int neighbour_count = [] {
    int count = 0;
    for (const Neighbour& kind : spring_kinds) count += (kind.row ? 2 : 1) * (kind.column ? 2 : 1);
    return count;
}();
struct MirroredNeighbour : Neighbour {
    SpringKind kind;
};
inline constexpr std::array<MirroredNeighbour, neighbour_count> neighbours = [] {
    std::array<MirroredNeighbour, neighbour_count> all{};
    std::size_t next = 0;
    for (int kind = 0; kind < spring_kind_count; ++kind) {
        const Neighbour& n = spring_kinds[std::size_t(kind)];
        for (const int down : {1, -1})
            for (const int right : {1, -1}) {
                if ((down < 0 && n.row == 0) || (right < 0 && n.column == 0)) continue;
                all[next++] = {{down * n.row, right * n.column, n.family}, SpringKind(kind)};
            }
    }
    return all;
}();

// Returns whether a spring is counted from this of its ends.
constexpr bool leads_on(const Neighbour& n) { return n.row > 0 || (n.row == 0 && n.column > 0); }

// The most rows or columns to a neighbour.
inline constexpr int stencil_reach = [] {
    int reach = 0;
    for (const Neighbour& n : spring_kinds) {
        if (n.row > reach) reach = n.row;
        if (n.column > reach) reach = n.column;
    }
    return reach;
}();

// Features of a scene that the force loop needs.
struct Features {
    std::array<bool, family_count> family{};
    bool spring_damping = false;

    constexpr bool has(const Neighbour& n) const { return family[std::size_t(n.family)]; }
};

}  // namespace clothsim
