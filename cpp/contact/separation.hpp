// Two boxes, and the axis across which a plane keeps them apart.
#pragma once

#include <optional>

#include "model/sphere.hpp"

namespace clothsim {

struct Box {
    Vec3 low, high;
};

struct Separation {
    int axis;
    bool above;  // whether the first box is above the second
};

// The axis of largest distance; none if no axis separates them.
inline std::optional<Separation> widest_separation(const Box& first, const Box& second) {
    std::optional<Separation> found;
    double widest = 0;
    for (int axis = 0; axis < 3; ++axis)
        for (const bool above : {true, false}) {
            const double gap =
                above ? first.low[axis] - second.high[axis] : second.low[axis] - first.high[axis];
            if (!(gap > widest)) continue;
            widest = gap;
            found = Separation{axis, above};
        }
    return found;
}

}  // namespace clothsim
