// Kim et al., method 1: reflect the velocity, leave the position alone.
#pragma once

#include "contact/contact.hpp"

namespace clothsim {

inline PointState respond_reflect(const Contact& contact, const PointState& point) {
    const Vec3 normal = outward_normal(point.position - contact.center);
    return {point.position, reflected(contact, point.velocity, normal)};
}

}  // namespace clothsim
