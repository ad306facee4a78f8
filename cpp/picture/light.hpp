// Light on a surface: a light from one side, a light at the eye, and an ambient term that is brighter from
// above.
#pragma once

#include <algorithm>
#include <cmath>

#include "picture/frame.hpp"

namespace clothsim::picture {

// Part of the ambient light that a full shadow takes: where a sheet lies on a sphere, half of the sky is
// hidden. At 0.25 contact hardly shows, at 1 the grid lines vanish in the shadow.
inline constexpr double ambient_in_shadow = 0.5;

// Factor of a colour. The normal (nx, ny, nz) of any length faces the eye, which is along the unit vector
// (ex, ey, ez). `lit` is the visible part of the light, 1 without shadows.
inline double light_on(const Shading& shading, double nx, double ny, double nz, double ex, double ey,
                       double ez, double lit) {
    const double length = std::max(std::sqrt((nx * nx + ny * ny) + nz * nz), 1e-300);
    nx = nx / length, ny = ny / length, nz = nz / length;
    const double to_eye = (nx * ex + ny * ey) + nz * ez;
    const double to_key = (nx * shading.key[0] + ny * shading.key[1]) + nz * shading.key[2];
    double light = (shading.ambient + shading.above * ny) * (1 - ambient_in_shadow * (1 - lit));
    light = light + shading.eye_light * std::max(to_eye, 0.0);
    return light + shading.key_light * lit * std::max(to_key, 0.0);
}

// Redness of a sphere's surface with cloth `under` metres below it.
inline double red_of(const Shading& shading, double under) {
    return under > 0
        ? shading.least_red + (1 - shading.least_red) * std::min(under / shading.full_red_depth, 1.0)
        : 0.0;
}

}  // namespace clothsim::picture
