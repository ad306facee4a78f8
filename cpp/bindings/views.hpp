// Arguments from Python in the form of the core.
#pragma once

#include <tuple>

#include "bindings/bindings.hpp"
#include "model/scene.hpp"

namespace clothsim {

inline PointsView view(const Array<double>& a) { return {a.data(), a.size() / 3, 3}; }

using PinValues = std::vector<std::tuple<int, Vec3, int>>;

inline std::vector<DrivenPin> pins_of(const PinValues& values) {
    std::vector<DrivenPin> pins;
    for (const auto& [point, start, motion] : values) pins.push_back({point, start, motion});
    return pins;
}

}  // namespace clothsim
