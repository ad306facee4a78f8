// Soft shadows: which part of the light is visible from a point.
#pragma once

#include <vector>

#include "memory/poll.hpp"
#include "picture/frame.hpp"

namespace clothsim::picture {

class Shadow {
public:
    // Of nothing where the shading has no shadows.
    Shadow(const Picture& picture, Poll& poll);

    // Part of the light that reaches the point of a sample, 0 to 1. A ball throws no shadow on itself.
    double lit(const Triple& point, int column, int row, const Ball* on = nullptr) const;

private:
    double past_sheet(const Triple& point, int which) const;
    // Metres towards the light that the sheet at (x, y) of the map is above `height`.
    double above(double x, double y, double height) const;

    const Picture& picture_;
    View view_;                    // from the light
    std::vector<double> nearness_;  // the map: of the sheet, -infinity beside it
    double highest_ = 0;            // of the map [m]
};

}  // namespace clothsim::picture
