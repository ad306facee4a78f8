// The whole state of a cloth between steps: from it, an engine of any layout continues bit for bit.
#pragma once

#include <span>
#include <vector>

#include "model/sphere.hpp"

namespace clothsim {

struct SavedState {
    // Of shape (rows, columns, 3) in C order: positions relative to the origin [m], velocities [m/s]. In
    // single the low parts are what compensation adds to them; in double they are empty.
    std::vector<double> x, v, x_low, v_low;
    Vec3 origin = Vec3::Zero();  // m
    std::vector<double> impulses;  // of Impulses [N s]
};

// Three components of all points from the first on (x, y, z, vx, vy, vz), or what compensation adds to them.
struct SavedPart {
    bool low;
    int first;
    std::vector<double> SavedState::* values;
};
inline std::span<const SavedPart> saved_parts(bool compensated) {
    static constexpr SavedPart all[]{{false, 0, &SavedState::x},
                                     {false, 3, &SavedState::v},
                                     {true, 0, &SavedState::x_low},
                                     {true, 3, &SavedState::v_low}};
    return {all, compensated ? 4u : 2u};
}

}  // namespace clothsim
